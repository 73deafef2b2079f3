"""A mesh at one place, or scaled to nothing, is hidden in that frame: the others go on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from dtrepair.pipeline import check_stage, repair_stage
from dtrepair.report.record import Report
from tests.meshes import Mesh, icosphere
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
    assert tuple(status) == TIMES and status[COLLAPSED].status == "clean"
    counted = [record.before for record in report.frames]
    assert [count is not None and count.pairs > 0 for count in counted] == [False] * 3 + [True]
    (text,) = [text for text in report.warnings if text.startswith("hidden")]
    assert text.endswith("/Root/Ball in frame 2")


def test_a_check_leaves_it_out(stage: Path) -> None:
    check_records(check_stage(stage, jobs=2))


def test_a_repair_leaves_it_and_solves_the_others(stage: Path, tmp_path: Path) -> None:
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
