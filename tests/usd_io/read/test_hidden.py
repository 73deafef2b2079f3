"""A mesh is hidden by its visibility, or by a scale; its matrix is where it would be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, UsdGeom

from tests.usd_stages import cube_file, define_cube, new_stage
from usd_io import (
    AnimatedMesh,
    FrameError,
    StageError,
    WorldMatrices,
    open_stage,
    read_meshes,
    world_faces,
    world_matrix,
)

NAN = float("nan")
TIMES = (1.0, 2.0, 3.0, 4.0)


def hand_with_cube(path: Path, *sizes: float, matrix: bool = False) -> AnimatedMesh:
    """A cube of these sizes in time, in a hand that moves on by one a frame and is turned."""
    stage = new_stage(path)
    hand = UsdGeom.Xform.Define(stage, "/Root/Hand")
    moved = hand.AddTranslateOp()
    for time in TIMES:
        moved.Set((time, 0.0, 0.0), time)
    hand.AddRotateZOp().Set(90.0)
    cube = define_cube(stage, "/Root/Hand/Cube")
    if matrix:
        placed = UsdGeom.Xformable(cube).AddTransformOp()
        for time, size in zip(TIMES, sizes, strict=True):
            placed.Set(Gf.Matrix4d().SetScale(size).SetTranslateOnly((0.0, time, 0.0)), time)
    else:
        scale = UsdGeom.Xformable(cube).AddScaleOp()
        for time, size in zip(TIMES, sizes, strict=True):
            scale.Set(Gf.Vec3f(size), time)
    stage.GetRootLayer().Save()
    return read_meshes(open_stage(path)).meshes[0]


@pytest.mark.parametrize("nothing", [0.0, 1e-3])
def test_a_scale_hides_it_where_its_hand_is(tmp_path: Path, nothing: float) -> None:
    mesh, matrices = (
        hand_with_cube(tmp_path / "a.usda", 2.0, 2.0, nothing, nothing),
        WorldMatrices(),
    )
    assert [matrices.hidden(mesh, time) for time in TIMES] == [False, False, True, True]
    for time in TIMES:
        expected = world_matrix(mesh, 1.0)
        expected[3, 0] = time
        assert np.allclose(matrices(mesh, time), expected, atol=1e-12)
    assert not matrices.hidden(mesh, NAN)


def test_a_matrix_that_hides_it_keeps_its_place(tmp_path: Path) -> None:
    mesh, matrices = (
        hand_with_cube(tmp_path / "a.usda", 0.0, 1.0, 3.0, 4.0, matrix=True),
        WorldMatrices(),
    )
    assert [matrices.hidden(mesh, time) for time in (NAN, *TIMES)] == [True, True] + [False] * 3
    # 1 is less than half of 4, as where it only begins to grow.
    assert np.allclose(matrices(mesh, 1.0)[:3, :3], world_matrix(mesh, 3.0)[:3, :3])
    assert np.allclose(matrices(mesh, 1.0)[3, :3], (0.0, 0.0, 0.0))
    assert np.allclose(matrices(mesh, 4.0), world_matrix(mesh, 4.0))


def test_faces_of_a_mirrored_mesh_are_turned_where_it_is_hidden(tmp_path: Path) -> None:
    mesh = hand_with_cube(tmp_path / "a.usda", 0.0, -1.0, -1.0, -1.0)
    assert np.array_equal(world_faces(mesh, 1.0), world_faces(mesh, 2.0))
    assert not np.array_equal(world_faces(mesh, 2.0), mesh.faces)


def test_what_only_shrinks_is_seen(tmp_path: Path) -> None:
    mesh, matrices = hand_with_cube(tmp_path / "a.usda", 1.0, 0.5, 0.1, 0.02), WorldMatrices()
    assert not any(matrices.hidden(mesh, time) for time in TIMES)
    assert np.array_equal(matrices(mesh, 4.0), world_matrix(mesh, 4.0))


def test_visibility_hides_what_is_below(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "a.usda")
    seen = UsdGeom.Imageable(UsdGeom.Xform.Define(stage, "/Root/Hand")).CreateVisibilityAttr()
    for time in TIMES:
        seen.Set("invisible" if time == 2.0 else "inherited", time)
    define_cube(stage, "/Root/Hand/Cube")
    define_cube(stage, "/Root/Cube")
    stage.GetRootLayer().Save()
    below, beside = read_meshes(open_stage(tmp_path / "a.usda")).meshes
    matrices = WorldMatrices()
    assert [matrices.hidden(below, time) for time in TIMES] == [False, True, False, False]
    assert not any(matrices.hidden(beside, time) for time in TIMES)
    assert not WorldMatrices(visibility=False).hidden(below, 2.0)


def test_what_no_frame_shows_takes_no_part(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "a.usda")
    define_cube(stage, "/Root/Cube")
    spare = UsdGeom.Xformable(define_cube(stage, "/Root/Spare"))
    spare.AddScaleOp().Set((0.0, 0.0, 0.0))
    stage.GetRootLayer().Save()
    found = read_meshes(open_stage(tmp_path / "a.usda"))
    assert [mesh.path for mesh in found.meshes] == ["/Root/Cube"]
    assert any("/Root/Spare: scaled to nothing at all times" in text for text in found.warnings)
    with pytest.raises(StageError, match="scaled to nothing"):
        read_meshes(open_stage(tmp_path / "a.usda"), prim="/Root/Spare")


def test_still_meshes_are_never_hidden(tmp_path: Path) -> None:
    mesh = read_meshes(open_stage(cube_file(tmp_path / "a.usda"))).meshes[0]
    assert not WorldMatrices().hidden(mesh, NAN) and not WorldMatrices().hidden(mesh, 5.0)


def test_a_transform_that_is_inverted_hides_nothing(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "a.usda")
    cube = UsdGeom.Xformable(define_cube(stage, "/Root/Cube"))
    scale = cube.AddScaleOp(opSuffix="back")
    for time in TIMES:
        scale.Set(Gf.Vec3f(time < 3.0), time)
    cube.SetXformOpOrder([cube.AddScaleOp(opSuffix="back", isInverseOp=True)])
    stage.GetRootLayer().Save()
    mesh = read_meshes(open_stage(tmp_path / "a.usda")).meshes[0]
    matrices = WorldMatrices()
    assert not matrices.hidden(mesh, 1.0) and np.array_equal(matrices(mesh, 1.0), np.eye(4))
    with pytest.raises(FrameError, match="infinite"):
        matrices(mesh, 3.0)


def test_what_is_above_a_reset_hides_nothing(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "a.usda")
    scale = UsdGeom.Xform.Define(stage, "/Root/Hand").AddScaleOp()
    for time in TIMES:
        scale.Set(Gf.Vec3f(time < 3.0), time)
    cube = UsdGeom.Xformable(define_cube(stage, "/Root/Hand/Cube"))
    cube.AddTranslateOp().Set((7.0, 0.0, 0.0))
    cube.SetResetXformStack(True)
    stage.GetRootLayer().Save()
    mesh = read_meshes(open_stage(tmp_path / "a.usda")).meshes[0]
    assert not any(WorldMatrices().hidden(mesh, time) for time in TIMES)


def test_the_nearest_time_at_which_it_is_large_tells(tmp_path: Path) -> None:
    mesh, matrices = hand_with_cube(tmp_path / "a.usda", 2.0, 0.0, 0.0, 3.0), WorldMatrices()
    sizes = [np.linalg.norm(matrices(mesh, time)[0, :3]) for time in TIMES]
    assert np.allclose(sizes, [2.0, 2.0, 3.0, 3.0])
