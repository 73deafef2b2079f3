from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.usd_stages import CUBE, cube_file
from usd_io import OutputError, OverrideWriter, open_stage, read_meshes
from usd_io.write.atomic_layer import FRAMES_BETWEEN_SAVES, AtomicLayer

REWRITE = """
import sys, numpy as np, usd_io
opened = usd_io.open_stage(sys.argv[1])
mesh = usd_io.read_meshes(opened).meshes[0]
for out in sys.argv[2:]:
    with usd_io.OverrideWriter(opened, out, settings={"a": 1, "b": "x"}) as writer:
        for time in mesh.times:
            writer.write(mesh, time, mesh.rest + time)
        writer.commit(record={"counts": {"z": 1, "y": 2}})
"""


def run(code: str, *arguments: object, seed: int = 0) -> subprocess.CompletedProcess[str]:
    """Run Python code in a process of its own, from the root of the checkout."""
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        env={**os.environ, "PYTHONHASHSEED": str(seed)},
        cwd=Path(__file__).resolve().parents[3],
        capture_output=True,
        text=True,
        timeout=60,
    )


def names_in(folder: Path) -> set[str]:
    return {item.name for item in folder.iterdir()}


def test_nothing_appears_before_commit(tmp_path: Path) -> None:
    target = tmp_path / "out.usdc"
    target.write_bytes(b"old")
    with AtomicLayer(target) as file:
        assert file.layer is not None
        file.layer.comment = "new"
        assert target.read_bytes() == b"old"
        file.commit()
        assert file.layer is None
    assert Sdf.Layer.FindOrOpen(str(target)).comment == "new"
    assert names_in(tmp_path) == {"out.usdc"}


@pytest.mark.parametrize("interruption", [ValueError, KeyboardInterrupt, SystemExit])
def test_interrupted_work_leaves_no_trace(
    tmp_path: Path, interruption: type[BaseException]
) -> None:
    opened = open_stage(cube_file(tmp_path / "in.usda", times=range(50)))
    mesh = read_meshes(opened).meshes[0]
    (tmp_path / "out.usdc").write_bytes(b"old")
    with pytest.raises(interruption):
        with OverrideWriter(opened, tmp_path / "out.usdc", settings={}) as writer:
            for time in range(25):
                writer.write(mesh, time, CUBE)
            raise interruption
    assert (tmp_path / "out.usdc").read_bytes() == b"old"
    assert names_in(tmp_path) == {"in.usda", "out.usdc"}


def test_full_disk_leaves_the_old_output(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usdc", times=range(400))
    (tmp_path / "out.usdc").write_bytes(b"old")
    limited = """
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (12000, 12000))
import usd_io
try:
    exec(REWRITE)
except usd_io.OutputError as error:
    print(error.exit_code, error)
"""
    done = run(f"REWRITE = {REWRITE!r}\n{limited}", path, tmp_path / "out.usdc")
    assert done.stdout.startswith("5 "), done.stderr
    assert "writing failed" in done.stdout and "an older file is unchanged" in done.stdout
    assert done.stdout.count("\n") == 1
    assert (tmp_path / "out.usdc").read_bytes() == b"old"
    assert names_in(tmp_path) == {"in.usdc", "out.usdc"}


def test_a_failing_move_is_an_output_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(source: str, target: str) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "replace", refuse)
    with AtomicLayer(tmp_path / "out.usdc") as file:
        with pytest.raises(OutputError, match="Permission denied"):
            file.commit()
    assert names_in(tmp_path) == set()


def test_readers_of_the_old_output_keep_it(tmp_path: Path) -> None:
    # A usdc is mapped while open; were it overwritten in place, this process would be killed.
    path = cube_file(tmp_path / "in.usdc", times=range(300))
    out = tmp_path / "out.usdc"
    assert run(REWRITE, path, out).returncode == 0
    reader = Usd.Stage.Open(str(out))
    points = UsdGeom.Mesh(reader.GetPrimAtPath("/Root/Cube")).GetPointsAttr()
    old = np.array(points.Get(0.0))
    assert run(REWRITE.replace("mesh.rest + time", "mesh.rest * 0"), path, out).returncode == 0
    np.testing.assert_array_equal(points.Get(0.0), old)
    np.testing.assert_array_equal(points.Get(299.0), old + 299)
    del points, reader
    fresh = Usd.Stage.Open(str(out))
    assert not np.any(UsdGeom.Mesh(fresh.GetPrimAtPath("/Root/Cube")).GetPointsAttr().Get(299.0))


def test_same_calls_same_bytes(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usdc", times=range(35))
    layer = Sdf.Layer.FindOrOpen(str(path))
    layer.startTimeCode, layer.endTimeCode, layer.framesPerSecond = 0.0, 34.0, 24.0
    for key, value in (("upAxis", "Z"), ("metersPerUnit", 0.01), ("kilogramsPerUnit", 2.0)):
        layer.pseudoRoot.SetInfo(key, value)
    layer.Save()
    extensions = ("usdc", "usd", "usda")
    digests = set()
    for seed in range(3):
        outputs = [tmp_path / f"out{seed}.{extension}" for extension in extensions]
        done = run(REWRITE, path, *outputs, seed=seed)
        assert done.returncode == 0, done.stderr
        digests |= {(o.suffix, hashlib.sha256(o.read_bytes()).hexdigest()) for o in outputs}
    assert len(digests) == len(extensions)


def test_memory_stays_flat(tmp_path: Path) -> None:
    code = """
import sys, numpy as np, resource, usd_io
path = sys.argv[1]
rest = np.random.default_rng(0).random((50_000, 3))
faces = np.arange(49_998).reshape(-1, 3)
usd_io.write_animation(path, usd_io.AuthoredMesh("/R/M", faces, rest=rest))
opened = usd_io.open_stage(path)
mesh = usd_io.read_meshes(opened).meshes[0]
with usd_io.OverrideWriter(opened, sys.argv[2], settings={}) as writer:
    for time in range(75):
        writer.write(mesh, time, rest + time)
        if time in (14, 74):
            print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    writer.commit()
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""
    done = run(code, tmp_path / "in.usdc", tmp_path / "out.usdc")
    assert done.returncode == 0, done.stderr
    few, many, committed = map(float, done.stdout.split())
    # 60 more frames of 0.6 MB: 36 MB if they stayed in memory.
    assert many - few < 12 and committed - few < 15


def test_the_file_has_usual_permissions(tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    plain.touch()
    with AtomicLayer(tmp_path / "out.usdc") as file:
        file.commit()
    assert (tmp_path / "out.usdc").stat().st_mode == plain.stat().st_mode


def test_a_removed_folder_does_not_come_back(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    with AtomicLayer(folder / "out.usdc") as file:
        shutil.rmtree(folder)
        for _ in range(FRAMES_BETWEEN_SAVES - 1):
            file.end_frame()
        with pytest.raises(OutputError, match="folder was removed"):
            file.end_frame()
    assert names_in(tmp_path) == set()
