from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pxr import Gf, UsdGeom

from tests.usd_stages import CUBE, cube_file, define_cube, new_stage
from usd_io import (
    AnimatedMesh,
    FrameError,
    WorldMatrices,
    inverse_matrix,
    local_points,
    open_stage,
    read_meshes,
    transform_points,
    transform_times,
    world_faces,
    world_matrix,
)
from usd_io.read import transforms

NAN = float("nan")


def cube_under(
    tmp_path: Path, *matrices: NDArray[np.float64], name: str = "chain.usda"
) -> AnimatedMesh:
    """The cube below a chain of fixed transforms, outermost first."""
    stage = new_stage(tmp_path / name)
    path = "/Root"
    for number, matrix in enumerate(matrices):
        path += f"/T{number}"
        UsdGeom.Xform.Define(stage, path).MakeMatrixXform().Set(Gf.Matrix4d(matrix.tolist()))
    define_cube(stage, f"{path}/Cube")
    stage.GetRootLayer().Save()
    return read_meshes(open_stage(tmp_path / name)).meshes[0]


def scaled(factors: tuple[float, float, float], offset: float = 0.0) -> NDArray[np.float64]:
    matrix = np.diag([*factors, 1.0])
    matrix[3, :3] = offset
    return matrix


def turned(angle: float) -> NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    return matrix


def test_row_vectors_innermost_transform_first(tmp_path: Path) -> None:
    mesh = cube_under(tmp_path, scaled((2, 2, 2), 5.0), turned(np.pi / 2))
    world = transform_points([[1.0, 0.0, 0.0]], world_matrix(mesh, NAN))
    # Turned from x to y, doubled, moved.
    np.testing.assert_allclose(world, [[5.0, 7.0, 5.0]], atol=1e-12)
    assert transform_points([1 / 3, 0.1, 1e9 / 7], np.eye(4)).tolist() == [1 / 3, 0.1, 1e9 / 7]


def test_far_and_uneven_transforms_keep_their_digits(tmp_path: Path) -> None:
    mesh = cube_under(tmp_path, scaled((100.0, 0.01, 3.0), 1e6), turned(0.7))
    world = transform_points(mesh.rest, world_matrix(mesh, NAN))
    back = local_points(mesh, NAN, world)
    # One unit in the last place of 1e6 is 1e-10, over the smallest scale: 1e-8.
    assert np.abs(back - mesh.rest).max() < 5e-8
    single = world.astype(np.float32)
    assert np.abs(local_points(mesh, NAN, single) - mesh.rest).max() > 1.0


def test_shear_is_inverted(tmp_path: Path) -> None:
    shear = np.eye(4)
    shear[0, 1] = 3.0
    mesh = cube_under(tmp_path, shear, scaled((1e-4, 1e-4, 1e-4)))
    world = transform_points(mesh.rest, world_matrix(mesh, NAN))
    np.testing.assert_allclose(local_points(mesh, NAN, world), mesh.rest, atol=1e-11)


@pytest.mark.parametrize("factors", [(1, 0, 1), (0, 0, 0), (1e-200, 1, float("inf"))])
def test_zero_scale_is_an_error(tmp_path: Path, factors: tuple[float, float, float]) -> None:
    with pytest.raises(FrameError, match="zero or infinite scale"):
        inverse_matrix(scaled(factors))


def test_flattening_shear_is_an_error_that_names_mesh_and_time(tmp_path: Path) -> None:
    flat = np.eye(4)
    flat[1] = flat[0]
    mesh = cube_under(tmp_path, flat)
    with pytest.raises(FrameError, match=r"/Root/T0/Cube at frame 3: .*flattens space") as caught:
        local_points(mesh, 3.0, CUBE)
    assert caught.value.exit_code == 4
    assert caught.value.path == mesh.path and caught.value.time == 3.0


def test_tiny_scale_is_fine() -> None:
    matrix = scaled((1e-12, 1e-12, 1e-12), 4.0)
    np.testing.assert_allclose(inverse_matrix(matrix) @ matrix, np.eye(4), atol=1e-10)


def test_mirroring_transform_flips_world_faces(tmp_path: Path) -> None:
    plain = cube_under(tmp_path, scaled((2, 3, 4)))
    assert world_faces(plain, NAN) is plain.faces
    mirrored = cube_under(tmp_path, scaled((-2, 3, 4)), name="mirrored.usda")
    faces = world_faces(mirrored, NAN)
    corners = transform_points(mirrored.rest, world_matrix(mirrored, NAN))[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ij->i", normals, corners.mean(axis=1)) > 0).all()
    np.testing.assert_array_equal(mirrored.faces, plain.faces)


def test_transform_times_are_the_union_of_the_chain(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "shot.usda")
    outer = UsdGeom.Xform.Define(stage, "/Root/Outer").AddTranslateOp()
    inner = UsdGeom.Xform.Define(stage, "/Root/Outer/Inner")
    turn = inner.AddRotateYOp()
    for time in (1.0, 5.0):
        outer.Set(Gf.Vec3d(time, 0, 0), time)
    for time in (2.5, 5.0):
        turn.Set(10.0 * time, time)
    define_cube(stage, "/Root/Outer/Inner/Cube")
    define_cube(stage, "/Root/Still")
    stage.GetRootLayer().Save()
    still, cube = sorted(
        read_meshes(open_stage(tmp_path / "shot.usda")).meshes, key=lambda m: len(m.path)
    )
    assert transform_times(cube).tolist() == [1.0, 2.5, 5.0]
    assert transform_times(still).tolist() == []
    # Linear in between: translation 3 at frame 3.
    assert world_matrix(cube, 3.0)[3, 0] == pytest.approx(3.0)
    # The default time has no values of its own.
    assert world_matrix(cube, NAN)[3, 0] == 1.0
    stage.GetPrimAtPath("/Root/Outer/Inner").GetAttribute("xformOpOrder").Set(
        ["!resetXformStack!", "xformOp:rotateY"]
    )
    stage.GetRootLayer().Save()
    reset = read_meshes(open_stage(tmp_path / "shot.usda"), prim="//Inner//").meshes[0]
    assert transform_times(reset).tolist() == [2.5, 5.0]


@pytest.mark.parametrize("samples", [{}, {3.0: 7.0, 9.0: 8.0}])
def test_default_time_is_the_earliest_sample_of_what_is_animated(
    tmp_path: Path, samples: dict[float, float]
) -> None:
    stage = new_stage(tmp_path / "default.usda")
    UsdGeom.Xform.Define(stage, "/Root/Still").AddTranslateOp().Set((1.0, 0.0, 0.0))
    moved = UsdGeom.Xform.Define(stage, "/Root/Still/Moved").AddTranslateOp()
    moved.Set((5.0, 0.0, 0.0))
    for time, place in samples.items():
        moved.Set((place, 0.0, 0.0), time)
    define_cube(stage, "/Root/Still/Moved/Cube")
    stage.GetRootLayer().Save()
    mesh = read_meshes(open_stage(tmp_path / "default.usda")).meshes[0]
    assert world_matrix(mesh, NAN)[3, 0] == (8.0 if samples else 6.0)


def test_matrices_are_kept_up_to_a_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transforms, "MOST_KEPT", 2)
    mesh = read_meshes(open_stage(cube_file(tmp_path / "a.usda"))).meshes[0]
    matrices = WorldMatrices()
    for time in (1.0, 2.0, 3.0, NAN, NAN):
        found = matrices(mesh, time)
        assert (found == world_matrix(mesh, time)).all() and not found.flags.writeable
        assert matrices(mesh, time) is found
        assert len(matrices._kept) <= 2
