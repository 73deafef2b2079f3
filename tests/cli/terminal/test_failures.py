"""How runs end: with which code, and with which line."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dtrepair.repair.parallel.process_pool import can_fork
from dtrepair.report.record import read_report
from tests.command_line import CLOSED, OPEN, assert_fails, read_samples, run, tube_pose, tube_stage


def spoil(path: Path, *times: float) -> None:
    """Put the points of the tube at some times to NaN."""
    from pxr import Sdf

    layer = Sdf.Layer.FindOrOpen(str(path))
    for time in times:
        broken = np.full_like(tube_pose(OPEN), np.nan, dtype=np.float32)
        layer.SetTimeSample("/Root/Tube.points", time, broken)
    layer.Save()


@pytest.mark.parametrize(
    "arguments",
    [
        ["check"],
        ["repair", "-o", "{out}"],
        ["repair", "-o", "{out}", "--alone"],
        ["keyposes", "-o", "{out}"],
        ["keyposes", "--verify-only"],
        ["transfer", "{rest}", "-o", "{out}"],
        ["transfer", "{rest}", "-o", "{out}", "--repair"],
    ],
)
def test_no_usable_frame_is_an_unusable_input(tmp_path: Path, arguments: list[str]) -> None:
    path, out = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED, OPEN)), tmp_path / "b.usdc"
    rest = tube_stage(tmp_path / "rest.usda", (OPEN,))
    spoil(path, 1.0, 2.0)
    filled = [word.format(out=out, rest=rest) for word in arguments]
    done = run(filled[0], path, *filled[1:], "--frames", "1:2", "-q")
    assert_fails(done, 3, "a.usda: no frame could be used", "NaN")
    assert not out.exists()
    # With a frame that is fine the others are told, and the rest is done.
    assert run(filled[0], path, *filled[1:], "-q").code == 4


def test_a_chunk_without_a_usable_frame_is_written_for_join(tmp_path: Path) -> None:
    path, parts = tube_stage(tmp_path / "a.usda", (CLOSED, OPEN)), []
    spoil(path, 2.0)
    for number, code in ((1, 0), (2, 4)):
        parts.append(tmp_path / f"{number}.usdc")
        done = run("repair", path, "-o", parts[-1], "--alone", "--chunk", f"{number}/2")
        assert done.code == code
    assert run("join", *parts, "-o", tmp_path / "whole.usdc").code == 0
    assert np.isnan(read_samples(tmp_path / "whole.usdc")[2.0]).all()


def test_a_flat_transform_fails_without_the_name_of_an_exception(tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom

    path = tube_stage(tmp_path / "a.usda", (CLOSED, CLOSED))
    stage = Usd.Stage.Open(str(path))
    cube = tube_pose(OPEN).astype(np.float32)
    other = UsdGeom.Mesh.Define(stage, "/Root/Other")
    other.CreatePointsAttr(cube)
    other.CreateFaceVertexCountsAttr([3])
    other.CreateFaceVertexIndicesAttr([0, 1, 2])
    UsdGeom.Xformable(stage.GetPrimAtPath("/Root/Tube")).AddScaleOp().Set((1, 0, 1))
    stage.Save()
    del stage, other
    done = run("repair", path, "-o", tmp_path / "b.usdc", "-q")
    assert_fails(done, 3, "no frame could be used: /Root/Tube at frame 1: ", "zero or infinite")


def test_an_interrupt_inside_the_demo_is_no_internal_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("dtrepair.pipeline.repair.stage.repair_here", interrupted)
    done = run("demo", tmp_path / "demo", "-q", "--frames", 3)
    assert_fails(done, 130, "interrupted; no output was written")
    assert [path.name for path in (tmp_path / "demo").iterdir()] == ["demo.usda"]


def test_an_output_is_not_called_an_input(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda")
    out = ["-o", tmp_path / "b.usdc", "--report"]
    assert_fails(run("repair", path, *out, path), 2, "a.usda: is an input of this run")
    assert_fails(run("repair", path, *out, out[1]), 2, "b.usdc: is another output of this run")


@pytest.mark.skipif(not can_fork(), reason="processes cannot be forked here")
def test_a_trace_reaches_into_the_workers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:

    def deep_inside(*arguments: object, **options: object) -> None:
        raise ArithmeticError("no factor")

    path = tube_stage(tmp_path / "a.usda", (CLOSED, CLOSED, CLOSED))
    out = ["-o", tmp_path / "b.usdc", "--chunk", "1/1", "--jobs", 2]
    monkeypatch.setattr("dtrepair.repair.repairer.repair_poses", deep_inside)
    told = run("repair", path, *out, "--alone", "-vv")
    assert told.code == 4 and "Traceback" in told.err
    assert told.err.count("in deep_inside") == 3  # one of each frame
    assert "deep_inside" not in run("repair", path, *out, "--alone").err


def test_a_trace_tells_why_frames_are_not_repaired_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dtrepair.repair.clip.clip_repairer import ClipRepairer

    def deep_inside(self: object, poses: object, **options: object) -> None:
        raise ArithmeticError("no window")

    path = tube_stage(tmp_path / "a.usda", (CLOSED, CLOSED, CLOSED))
    monkeypatch.setattr(ClipRepairer, "stream", deep_inside)
    report = tmp_path / "r.json"
    told = run("repair", path, "-o", tmp_path / "b.usdc", "-vv", "--report", report)
    assert told.code == 6 and "in deep_inside" in told.err
    assert read_report(report)["alone_from"] == 1.0 and (tmp_path / "b.usdc").exists()
    assert "the frames are repaired alone: ArithmeticError: no window" in told.err


@pytest.mark.skipif(os.name != "posix", reason="limits of POSIX")
@pytest.mark.parametrize("megabytes", [300, 1024])
def test_little_address_space_is_an_error_and_no_crash(tmp_path: Path, megabytes: int) -> None:
    path = tube_stage(tmp_path / "in.usda", (OPEN,))
    done = subprocess.run(
        [
            "sh",
            "-c",
            f'ulimit -v {1024 * megabytes}; "$0" -m dtrepair check "$1"',
            sys.executable,
            path,
        ],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[3],
        check=False,
    )
    assert done.returncode == 2, done
    assert done.stderr.startswith("dtrepair: error: the limit of address space is")
    assert done.stderr.count("\n") == 1
