"""Stages with values of wrong types, transforms that are no numbers, and damaged binary files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, UsdGeom

from tests.usd_stages import CUBE, cube_file, define_cube, moved_cube, new_stage
from usd_io import (
    FrameError,
    SelectionError,
    StageError,
    open_stage,
    read_frame,
    read_meshes,
    read_points,
)
from usd_io.read.matrices import prim_matrix


def edited(path: Path, old: str, new: str) -> Path:
    """A text stage with one cube, changed."""
    text = cube_file(path).read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))
    return path


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("point3f[] points", "string[] points = ['a']\n point3f[] other", "point3f"),
        ("point3f[] points", "int points = 3\n point3f[] other", "points should be of type"),
        ("point3f[] points", "float2[] points = [(1, 2)]\n point3f[] other", "got Vec2fArray"),
        ("int[] faceVertexCounts", "float[] faceVertexCounts", "faceVertexCounts should be"),
        ("int[] faceVertexIndices", "double[] faceVertexIndices", "faceVertexIndices should be"),
        ("uniform token subd", 'string holeIndices = "x"\n uniform token subd', "holeIndices"),
    ],
)
def test_values_of_another_type_are_named(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(StageError, match=rf"/Root/Cube: .*{words}"):
        read_meshes(open_stage(edited(tmp_path / "in.usda", old, new)))


def test_an_unknown_up_axis_counts_as_y(tmp_path: Path) -> None:
    path = edited(tmp_path / "in.usda", 'defaultPrim = "Root"', 'defaultPrim = "Root"\n upAxis="Q"')
    assert read_meshes(open_stage(path)).meshes[0].up.tolist() == [0.0, 1.0, 0.0]


@pytest.mark.parametrize(
    ("order", "words"),
    [
        ('["xformOp:translate"]', "names 'xformOp:translate', which the prim does not have"),
        ('["xformOp:bogus"]', "bogus"),
        ('["xformOp:scale"]', "opType"),
    ],
)
def test_transforms_that_are_not_there_or_of_another_type(
    tmp_path: Path, order: str, words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    more = f'string xformOp:scale = "x"\n uniform token[] xformOpOrder = {order}\n uniform token'
    path = edited(tmp_path / "in.usda", "uniform token", more)
    with pytest.raises(StageError, match=rf"^/Root/Cube: .*{words}"):
        read_meshes(open_stage(path))
    assert capfd.readouterr() == ("", ""), "pxr printed its own warning"


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e300])
def test_transforms_that_are_no_numbers(tmp_path: Path, value: float) -> None:
    stage = new_stage(tmp_path / "in.usda")
    operation = UsdGeom.Xformable(define_cube(stage)).AddTranslateOp()
    operation.Set(Gf.Vec3d(value, 0.0, 0.0), 1.0)
    operation.Set(Gf.Vec3d(3.0, 0.0, 0.0), 2.0)
    prim = stage.GetPrimAtPath("/Root/Cube")
    assert prim_matrix(prim, 2.0)[3, 0] == 3.0
    with pytest.raises(FrameError, match=r"/Root/Cube at frame 1: the transform is NaN, infinite"):
        prim_matrix(prim, 1.0)


def test_expressions_take_ascii_only_and_say_how_to_name_others(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    define_cube(stage, "/Root/Käfer/M")
    stage.GetRootLayer().Save()
    opened = open_stage(tmp_path / "in.usda")
    with pytest.raises(SelectionError, match=r"write \* for the others, such as '//K\*fer//'"):
        read_meshes(opened, prim="//Käfer//")
    assert [mesh.path for mesh in read_meshes(opened, prim="//K*fer//").meshes] == ["/Root/Käfer/M"]
    with pytest.raises(SelectionError, match="ASCII"):
        read_meshes(opened, exclude="\udcff")


def with_count(path: Path, data: bytes, number: int) -> Path:
    """A binary file whose array of these bytes says that it has so many values."""
    whole = path.read_bytes()
    place = whole.index(data) - 8
    path.write_bytes(whole[:place] + number.to_bytes(8, "little") + whole[place + 8 :])
    return path


@pytest.mark.parametrize("number", [100, 2**20, 2**63 - 1])
def test_a_damaged_sample_is_the_fault_of_its_frame(tmp_path: Path, number: int) -> None:
    path = cube_file(tmp_path / "in.usdc", times=[1.0, 2.0])
    mesh = read_meshes(open_stage(with_count(path, moved_cube(2.0).tobytes(), number))).meshes[0]
    assert np.array_equal(read_points(mesh, [1.0])[0], moved_cube(1.0))
    wrong = r"/Root/Cube at frame 2: (cannot be read \(|points should be of type)"
    with pytest.raises(FrameError, match=wrong) as caught:
        read_frame(mesh, 2.0)
    assert "\n" not in str(caught.value)


def test_a_damaged_rest_pose_is_the_fault_of_its_mesh(tmp_path: Path) -> None:
    path = with_count(cube_file(tmp_path / "in.usdc"), CUBE.tobytes(), 2**20)
    with pytest.raises(StageError, match=r"^/Root/Cube: cannot be read \("):
        read_meshes(open_stage(path))
