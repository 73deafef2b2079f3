"""`dtrepair transfer --shapes`: blend shapes of files and of stages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import usd_io
from dtrepair import find_intersections
from dtrepair.report.record import read_report
from tests.command_line import (
    CLOSED,
    OPEN,
    assert_fails,
    read_samples,
    run,
    tube_obj,
    tube_polygons,
    tube_pose,
    tube_stage,
    write_obj,
)
from tests.present import present
from usd_io import AuthoredMesh, write_animation

ShapeFiles = tuple[Path, Path, list[Path]]


def test_closed_and_open_tubes_are_what_the_tests_need() -> None:
    assert OPEN < 2 * np.pi < CLOSED


@pytest.fixture
def shape_files(tmp_path: Path) -> ShapeFiles:
    """A straight tube, a thicker one, and two shapes of the first."""
    rest = tube_obj(tmp_path / "rest.obj", 0.0)
    write_obj(tmp_path / "thick.obj", tube_pose(0.0) * (1.3, 1.3, 1.0), tube_polygons())
    return (
        rest,
        tmp_path / "thick.obj",
        [
            tube_obj(tmp_path / "bent a.obj", 0.6),
            tube_obj(tmp_path / "9.obj", 1.2),
        ],
    )


def test_shapes_become_blend_shapes(shape_files: ShapeFiles, tmp_path: Path) -> None:
    rest, thick, shapes = shape_files
    output, clip = tmp_path / "o.usda", tmp_path / "clip.usda"
    arguments = ("transfer", rest, thick, "--poses", *shapes, "-o")
    assert run(*arguments, output, "--shapes", "--report", tmp_path / "r.json").code == 0
    assert run(*arguments, clip).code == 0
    text = output.read_text()
    assert '"bent_a", "_9"' in text and "SkelRoot" in text
    expected = read_samples(clip, "/thick/Mesh")
    opened = usd_io.open_stage(output)
    mesh = usd_io.read_meshes(opened).meshes[0]
    assert mesh.skinned and mesh.times.tolist() == [1.0, 2.0]
    for time in (1.0, 2.0):
        assert np.abs(present(usd_io.read_frame(mesh, time)) - expected[time]).max() < 1e-5
    assert read_report(tmp_path / "r.json")["settings"]["shapes"] is True


def test_blend_shapes_of_a_stage_keep_their_weights(
    shape_files: ShapeFiles, tmp_path: Path
) -> None:
    from pxr import Usd, UsdSkel

    rest, thick, shapes = shape_files
    face, output = tmp_path / "face.usda", tmp_path / "o.usda"
    assert run("transfer", rest, rest, "--poses", *shapes, "-o", face, "--shapes").code == 0
    stage = Usd.Stage.Open(str(face))
    animation = UsdSkel.Animation(stage.GetPrimAtPath("/rest/ShapeAnimation"))
    weights = animation.GetBlendShapeWeightsAttr()
    weights.Clear()
    weights.Set([0.0, 0.5], 3.0)
    weights.Set([1.0, 0.25], 4.5)
    stage.GetRootLayer().Save()
    hero = AuthoredMesh("/Hero/Tube", tube_polygons(), rest=tube_pose(0.0) * (1.3, 1.3, 1.0))
    write_animation(tmp_path / "hero.usda", hero)
    done = run("transfer", face, tmp_path / "hero.usda", "-o", output, "--shapes")
    assert done.code == 0, done
    opened = usd_io.open_stage(output)
    mesh = usd_io.read_meshes(opened).meshes[0]
    assert mesh.path == "/Hero/Tube" and mesh.skinned
    animation = UsdSkel.Animation(opened.stage.GetPrimAtPath("/Hero/ShapeAnimation"))
    values = animation.GetBlendShapeWeightsAttr()
    assert values.GetTimeSamples() == [3.0, 4.5]
    assert list(values.Get(4.5)) == [1.0, 0.25]
    # The blended target: offsets of both shapes by their weights.
    run("transfer", rest, thick, "--poses", *shapes, "-o", tmp_path / "clip.usda")
    full = read_samples(tmp_path / "clip.usda", "/thick/Mesh")
    blended = mesh.rest + (full[1.0] - mesh.rest) + 0.25 * (full[2.0] - mesh.rest)
    assert np.abs(present(usd_io.read_frame(mesh, 4.5)) - blended).max() < 1e-5


def test_shapes_can_be_repaired(shape_files: ShapeFiles, tmp_path: Path) -> None:
    rest, thick, shapes = shape_files
    closed = tube_obj(tmp_path / "closed.obj", CLOSED)
    output, told = tmp_path / "o.usdc", tmp_path / "r.json"
    arguments = ("transfer", rest, thick, "--poses", shapes[0], closed, "--shapes", "-o", output)
    assert run(*arguments).code == 1
    assert run(*arguments, "--repair", "--report", told).code == 0
    frames = read_report(told)["frames"]
    assert [frame["before"]["pairs"] > 0 for frame in frames] == [False, True]
    assert [frame["after"]["pairs"] for frame in frames] == [0, 0]
    mesh = usd_io.read_meshes(usd_io.open_stage(output)).meshes[0]
    for time in (1.0, 2.0):
        posed = present(usd_io.read_frame(mesh, time))
        assert len(find_intersections(posed, mesh.faces)) == 0


def test_shapes_that_cannot_be_are_told(shape_files: ShapeFiles, tmp_path: Path) -> None:
    rest, thick, shapes = shape_files
    source = target = tube_stage(tmp_path / "a.usda", (1.0, 2.0, CLOSED), rest=0.0)
    output = tmp_path / "c.usdc"
    arguments = ("transfer", rest, thick, "--poses", *shapes, "--shapes", "-o")
    assert_fails(run("transfer", source, target, "--shapes", "-o", output), 3, "no blend shapes")
    assert_fails(run(*arguments, tmp_path / "o.obj"), 2, "need USD")
    assert_fails(run(*arguments, output, "--repair", "--together"), 2, "--together", "--shapes")
    assert_fails(run(*arguments, output, "--pin", "a.npz"), 2, "--pin", "--shapes")
    assert_fails(run(*arguments, output, "--frames", "1"), 2, "--frames", "--shapes")
    assert_fails(run(*arguments[:3], "--poses", source, *arguments[-2:], output), 2, "mesh files")
    write_animation(tmp_path / "r.usda", AuthoredMesh("/Tube", tube_polygons(), rest=tube_pose(0)))
    alone = ("transfer", rest, tmp_path / "r.usda", "--poses", *shapes, "--shapes", "-o", output)
    assert_fails(run(*alone), 3, "put it under an Xform")
    assert not output.exists()
