"""Key poses from a script: the command line's bytes, ended by an observer, silent."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from dtrepair.keyposes.options import KeyOptions
from dtrepair.pipeline.errors import Cancelled, UsageError, exit_code
from dtrepair.pipeline.keyposes.settings import KeyposeSettings
from dtrepair.pipeline.keyposes.stage import plan_keyposes, repair_keyposes
from dtrepair.pipeline.observer import FrameDone, SpansDone
from dtrepair.pipeline.selection import Selection
from dtrepair.report.record import read_report
from tests.command_line import run, tube_obj, tube_stage
from tests.meshes import elbow, icosphere
from tests.observers import Recorder
from tests.swinging_arm import arm_stage
from usd_io import AuthoredMesh, write_animation


@pytest.fixture
def swing(tmp_path: Path) -> str:
    """An arm that swings through the body between two keys."""
    return str(arm_stage(tmp_path / "arm.usda", (1.0, -1.0, -0.8)))


def names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_script_writes_the_bytes_of_the_command_line(
    swing: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    outputs = [tmp_path / "a.usda", tmp_path / "b.usda", tmp_path / "c.usda"]
    told = tmp_path / "r.json"
    done = run("keyposes", swing, "-o", outputs[0], "--samples", 2, "--report", told)
    capsys.readouterr()
    report = repair_keyposes(swing, str(outputs[1]), keys=KeyOptions(samples=2), jobs=1)
    captured = capsys.readouterr()
    assert captured.out == captured.err == ""
    assert exit_code(report) == done.code == 0
    settings = KeyposeSettings.from_report(read_report(told)["settings"])
    assert settings == KeyposeSettings.from_report(report.settings)
    assert settings.keys == KeyOptions(samples=2)
    repair_keyposes(swing, str(outputs[2]), settings)
    assert outputs[0].read_bytes() == outputs[1].read_bytes() == outputs[2].read_bytes()
    assert report.document()["keyposes"] == read_report(told)["keyposes"]


def test_without_an_output_it_counts(swing: str, tmp_path: Path) -> None:
    before = names_in(tmp_path)
    report = repair_keyposes(swing)
    assert report.output is None and exit_code(report) == 1
    assert report.keyposes is not None and report.keyposes.spans[0].left
    assert report.frames[0].before == report.frames[0].after
    assert names_in(tmp_path) == before


@pytest.mark.parametrize("end_at", [1, 3, 5, 8, 12])
def test_a_cancelled_run_leaves_the_old_output(swing: str, tmp_path: Path, end_at: int) -> None:
    output = tmp_path / "out.usda"
    output.write_text("old")
    before = names_in(tmp_path)
    observer = Recorder(end_at)
    with pytest.raises(Cancelled, match="no output was written"):
        repair_keyposes(swing, str(output), observer=observer)
    assert output.read_text() == "old" and names_in(tmp_path) == before
    assert observer.ends == len(observer.phases)
    # The last ones end it amid the search between the keys.
    assert ("in-betweens" in dict(observer.phases)) is (end_at > 8)


def test_an_observer_hears_of_keys_and_spans(swing: str, tmp_path: Path) -> None:
    observer = Recorder()
    report = repair_keyposes(swing, str(tmp_path / "out.usda"), observer=observer)
    assert observer.phases == [("keys", 3), ("in-betweens", 2)]
    keys = [remark.record for remark in observer.remarks if isinstance(remark, FrameDone)]
    spans = [remark for remark in observer.remarks if isinstance(remark, SpansDone)]
    assert [key.time for key in keys] == [1.0, 11.0, 21.0]
    assert spans == [SpansDone(1, 2), SpansDone(2, 2)]
    assert observer.warnings == list(report.warnings)


def test_a_plan_writes_nothing(swing: str, tmp_path: Path) -> None:
    before = names_in(tmp_path)
    plan = plan_keyposes(swing, str(tmp_path / "out.usda"), selection=Selection(frames="1:11"))
    assert plan.times == (1.0, 11.0) and [mesh.path for mesh in plan.meshes] == ["/Root/Arm"]
    assert plan_keyposes(swing).output is None
    assert names_in(tmp_path) == before


def test_only_stages_with_samples_have_keys(tmp_path: Path) -> None:
    still = str(tube_stage(tmp_path / "still.usda", (), rest=5.0))
    with pytest.raises(UsageError, match="no mesh has time samples"):
        repair_keyposes(still)
    with pytest.raises(UsageError, match="only stages have keys"):
        repair_keyposes(str(tube_obj(tmp_path / "a.obj")))


def test_of_several_meshes_each_is_told_how_far_it_moved(tmp_path: Path) -> None:
    """In its own size in the world: a large one that hardly moves, and a small one."""
    arm, (ball, faces) = elbow(0.1), icosphere(2, 0.1)
    side = arm[0][np.abs(arm[0][:, 2] - 0.6) < 0.1, 0].max()
    shift = np.repeat(np.diag([2.0, 2.0, 2.0, 1.0])[None], 2, axis=0)
    shift[:, 3, 0], shift[:, 3, 2] = side + np.array([0.5, 0.15]), 0.6
    path, out = tmp_path / "a.usda", tmp_path / "b.usdc"
    meshes = [
        AuthoredMesh("/Shot/Arm", arm[1], rest=arm[0]),
        AuthoredMesh("/Shot/Ball/Ball", faces, rest=ball, transforms=shift),
    ]
    write_animation(path, meshes, times=[1.0, 5.0])
    report = repair_keyposes(path, out)
    (frame,) = (own for own in report.frames if own.time == 5.0)
    stages = [Usd.Stage.Open(str(own)) for own in (path, out)]
    for prim in frame.prims:
        old, new = (world_points(stage, prim.path, 5.0) for stage in stages)
        far = float(np.linalg.norm(new - old, axis=1).max())
        size = prim.size or 0.0
        assert size == pytest.approx(float(np.linalg.norm(np.ptp(old, axis=0))), rel=1e-5)
        moved = 0.0 if prim.motion is None else prim.motion.displacement_max * size
        assert moved == pytest.approx(far, rel=1e-4, abs=1e-6)
    assert frame.displacement_max > 0.0


def world_points(stage: Usd.Stage, path: str, time: float) -> NDArray[np.float64]:
    """Points (V, 3) of a mesh in the world."""
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(path))
    matrix = np.array(UsdGeom.XformCache(time).GetLocalToWorldTransform(mesh.GetPrim()))
    points = np.array(mesh.GetPointsAttr().Get(time), dtype=np.float64)
    return np.asarray(points @ matrix[:3, :3] + matrix[3, :3])
