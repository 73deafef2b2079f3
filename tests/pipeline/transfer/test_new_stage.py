"""The stage that a transfer onto a mesh file makes."""

from __future__ import annotations

from pathlib import Path

import pytest
from pxr import Usd, UsdGeom

from tests.command_line import OPEN, run, tube_obj, tube_polygons, tube_pose, tube_stage
from usd_io import AuthoredMesh, write_animation


@pytest.mark.parametrize(
    ("source_up", "options", "expected"),
    [
        ("Z", (), "Z"),  # a mesh file is taken for what the source is
        ("Z", ("--target-up", "y"), "Y"),
        ("Y", ("--target-up", "z"), "Z"),
        ("Y", ("--source-up", "z"), "Z"),
    ],
)
def test_its_up_axis_is_that_of_the_target(
    tmp_path: Path, source_up: str, options: tuple[str, ...], expected: str
) -> None:
    source, out = tmp_path / "a.usda", tmp_path / "b.usda"
    poses = [tube_pose(angle) for angle in (0.0, 0.4)]
    mesh = AuthoredMesh("/Root/Tube", tube_polygons(), points=poses, rest=poses[0])
    write_animation(source, mesh, times=[1.0, 2.0], up=source_up)
    target = tube_obj(tmp_path / "t.obj", 0.0)
    assert run("transfer", source, target, "-o", out, *options).code == 0
    assert UsdGeom.GetStageUpAxis(Usd.Stage.Open(str(out))) == expected


def test_pose_files_have_the_axis_that_is_told(tmp_path: Path) -> None:
    rest, pose, target = (tube_obj(tmp_path / f"{name}.obj", OPEN) for name in ("r", "p", "t"))
    out = tmp_path / "b.usda"
    asked = ("--poses", pose, "--source-up", "z", "-o", out)
    assert run("transfer", rest, target, *asked).code == 0
    assert UsdGeom.GetStageUpAxis(Usd.Stage.Open(str(out))) == "Z"


def test_a_stage_keeps_its_own_axis(tmp_path: Path) -> None:
    source, target, out = (tmp_path / f"{name}.usda" for name in "abc")
    tube_stage(source, (OPEN, OPEN + 0.2))
    tube_stage(target, (), rest=OPEN)
    assert run("transfer", source, target, "-o", out, "--target-up", "z").code == 0
    assert UsdGeom.GetStageUpAxis(Usd.Stage.Open(str(out))) == "Y"
