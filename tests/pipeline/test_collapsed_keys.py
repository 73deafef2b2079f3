"""A frame that collapses ends neither a run over key poses nor a transfer."""

from __future__ import annotations

from pathlib import Path

import pytest
from pxr import Usd, UsdGeom

from dtrepair.pipeline import repair_keyposes
from dtrepair.pipeline.errors import FRAMES, exit_code
from dtrepair.report.record import Report
from tests.command_line import run
from tests.pipeline.test_collapsed_frames import BALL, COLLAPSED, TIMES, define_ball
from tests.usd_stages import new_stage, vec3f


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    """A ball that is at one place in a frame."""
    made = new_stage(tmp_path / "ball.usda")
    points = define_ball(made, "Ball", BALL).GetPointsAttr()
    for time in TIMES:
        points.Set(vec3f((0.0 if time == COLLAPSED else time) * BALL[0]), time)
    made.GetRootLayer().Save()
    return tmp_path / "ball.usda"


def check_records(report: Report) -> None:
    status = {record.time: record for record in report.frames}
    assert tuple(status) == TIMES and exit_code(report) == FRAMES
    assert status[COLLAPSED].before is None
    assert "20,480 triangles" in str(status[COLLAPSED].message)
    assert all(status[time].status == "clean" for time in TIMES if time != COLLAPSED)


def test_a_collapsed_key_has_no_in_betweens(stage: Path, tmp_path: Path) -> None:
    report = repair_keyposes(stage, tmp_path / "out.usda", jobs=1)
    check_records(report)
    assert report.keyposes is not None and report.keyposes.skipped == 2
    assert [(span.start, span.end) for span in report.keyposes.spans] == [(3.0, 4.0)]


def test_the_command_tells_it(stage: Path) -> None:
    done = run("keyposes", stage, "--verify-only")
    assert done.code == FRAMES and "2 spans with an unusable key" in done.err
    assert "Traceback" not in done.err and "3 of 4 keys clean" in done.out


@pytest.mark.parametrize("repaired", [False, True])
def test_a_transfer_leaves_it_out(stage: Path, tmp_path: Path, repaired: bool) -> None:
    output = tmp_path / "out.usda"
    target = new_stage(tmp_path / "target.usda")
    define_ball(target, "Ball", BALL)
    target.GetRootLayer().Save()
    done = run("transfer", stage, tmp_path / "target.usda", "-o", output, *["--repair"] * repaired)
    assert done.code == FRAMES and "frame 2: failed: too many of its 20,480" in done.err
    opened = Usd.Stage.Open(str(output))
    written = UsdGeom.Mesh(opened.GetPrimAtPath("/Root/Ball"))
    assert written.GetPointsAttr().GetTimeSamples() == [1.0, 3.0, 4.0]
