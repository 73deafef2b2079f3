"""A frame that collapses, or is scaled to nothing, is that frame's fault and no other's."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from dtrepair.pipeline import check_stage, repair_stage
from dtrepair.report.record import Report
from tests.meshes import Mesh, icosphere
from tests.observers import Recorder
from tests.usd_stages import new_stage, vec3f

BALL = icosphere(5)  # each triangle with each other: 210 million pairs
OTHER = icosphere(1)[0] + [[3.0, 0.0, 0.0]], icosphere(1)[1]
TIMES = (1.0, 2.0, 3.0, 4.0)
COLLAPSED = 2.0


def define_ball(stage: Usd.Stage, name: str, ball: Mesh) -> UsdGeom.Mesh:
    points, faces = ball
    mesh = UsdGeom.Mesh.Define(stage, f"/Root/{name}")
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreateFaceVertexCountsAttr([3] * len(faces))
    mesh.CreateFaceVertexIndicesAttr(faces.ravel().tolist())
    mesh.CreatePointsAttr(vec3f(points))
    return mesh


@pytest.fixture(params=["points", "scale"])
def stage(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Two balls, apart but in the last frame; one is at one place in a frame."""
    made = new_stage(tmp_path / "balls.usda")
    ball, other = define_ball(made, "Ball", BALL), define_ball(made, "Other", OTHER)
    if request.param == "scale":
        scale = ball.AddScaleOp()
        for time in TIMES:
            scale.Set(Gf.Vec3f(0.0 if time == COLLAPSED else 1.0), time)
    for time in TIMES:
        if request.param == "points":
            size = 0.0 if time == COLLAPSED else 1.0
            ball.GetPointsAttr().Set(vec3f(size * BALL[0]), time)
        other.GetPointsAttr().Set(vec3f(OTHER[0] - [[0.0 if time < 4 else 1.1, 0.0, 0.0]]), time)
    made.GetRootLayer().Save()
    return tmp_path / "balls.usda"


def check_records(report: Report) -> None:
    status = {record.time: record for record in report.frames}
    assert tuple(status) == TIMES
    fault = status[COLLAPSED]
    assert fault.status == "failed" and fault.before is None
    assert "20,560 triangles" in str(fault.message)
    counted = [status[time].before for time in TIMES if time != COLLAPSED]
    assert [count is not None and count.pairs > 0 for count in counted] == [False, False, True]


def test_a_check_skips_it(stage: Path) -> None:
    check_records(check_stage(stage, jobs=2))


def test_a_repair_skips_it_and_solves_the_others(stage: Path, tmp_path: Path) -> None:
    output = tmp_path / "out.usda"
    report = repair_stage(stage, output, jobs=1)
    check_records(report)
    assert report.frames[-1].status == "clean"
    assert not any("alone" in warning for warning in report.warnings)
    stages = [Usd.Stage.Open(str(path)) for path in (stage, output)]
    before, after = (
        np.array(UsdGeom.Mesh(own.GetPrimAtPath("/Root/Ball")).GetPointsAttr().Get(COLLAPSED))
        for own in stages
    )
    assert np.array_equal(before, after)


def test_a_small_mesh_that_a_scale_hides_is_told(tmp_path: Path) -> None:
    made = new_stage(tmp_path / "hidden.usda")
    define_ball(made, "Other", OTHER)
    scale = define_ball(made, "Prop", icosphere(1)).AddScaleOp()
    for time in TIMES:
        scale.Set(Gf.Vec3f(0.0 if time == COLLAPSED else 1.0), time)
    made.GetRootLayer().Save()
    for run in (check_stage, partial(repair_stage, output=tmp_path / "out.usda")):
        observer = Recorder()
        report = run(tmp_path / "hidden.usda", jobs=1, observer=observer)
        # Of the other meshes everything is counted, so that the frame is no fault.
        assert [record.status for record in report.frames] == ["clean"] * len(TIMES)
        (text,) = [text for text in observer.warnings if "at one place" in text]
        assert text.startswith("/Root/Prop: all points are at one place in frame 2, so that")
        assert text in report.warnings
