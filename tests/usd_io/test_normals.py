from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from tests.present import present
from tests.usd_stages import CUBE, CUBE_QUADS, authored_properties, define_cube, new_stage, vec3f
from usd_io import OverrideWriter, open_stage, read_meshes
from usd_io.normals import Polygons, polygon_areas, recompute_normals

POLYGONS = Polygons(np.full(6, 4), np.array(CUBE_QUADS).reshape(-1), False)
CORNER_VERTICES = POLYGONS.indices
FACE_NORMALS = np.array(
    [[0, 0, -1], [0, 0, 1], [0, -1, 0], [0, 1, 0], [-1, 0, 0], [1, 0, 0]], dtype=float
)
TURN, _ = np.linalg.qr(np.array([[1.0, 2.0, 3.0], [0.0, 1.0, 4.0], [5.0, 6.0, 0.0]]))
TURN *= np.sign(np.linalg.det(TURN))


def test_polygon_areas_of_a_cube_far_away() -> None:
    np.testing.assert_array_equal(polygon_areas(POLYGONS, CUBE), 4 * FACE_NORMALS)
    far = CUBE.astype(np.float64) + 1e6
    np.testing.assert_array_equal(polygon_areas(POLYGONS, far), 4 * FACE_NORMALS)
    flipped = Polygons(POLYGONS.counts, POLYGONS.indices, True)
    np.testing.assert_array_equal(polygon_areas(flipped, CUBE), -4 * FACE_NORMALS)


def test_polygon_areas_of_empty_polygons() -> None:
    mixed = Polygons(np.array([0, 4, 0, 2, 0]), np.array([4, 5, 7, 6, 0, 1]), False)
    areas = polygon_areas(mixed, CUBE)
    np.testing.assert_array_equal(areas, [[0, 0, 0], [0, 0, 4], [0, 0, 0], [0, 0, 0], [0, 0, 0]])


@pytest.mark.parametrize(
    "interpolation, old",
    [
        ("vertex", CUBE / np.sqrt(3)),
        ("varying", CUBE / np.sqrt(3)),
        ("uniform", FACE_NORMALS),
        ("faceVarying", np.repeat(FACE_NORMALS, 4, axis=0)),
        ("faceVarying", (CUBE / np.sqrt(3))[CORNER_VERTICES]),
    ],
)
def test_normals_turn_with_the_points(interpolation: str, old: NDArray[np.float64]) -> None:
    # Hard edges stay hard and smooth ones smooth: the same normals, turned.
    new = recompute_normals(POLYGONS, CUBE @ TURN, old, interpolation)
    np.testing.assert_allclose(present(new), old @ TURN, atol=1e-6)


def test_smooth_and_hard_edges_side_by_side() -> None:
    # Faces 0, 2 and 4 are smooth around vertex 0, the rest is hard.
    old = np.repeat(FACE_NORMALS, 4, axis=0)
    old[CORNER_VERTICES == 0] = -1 / np.sqrt(3)
    new = recompute_normals(POLYGONS, CUBE * [1.0, 2.0, 4.0], old, "faceVarying")
    assert new is not None
    # Areas of the three faces: 2 * 4 across x, 1 * 4 across y, 1 * 2 across z, times 4.
    expected = -np.array([8.0, 4.0, 2.0]) / np.linalg.norm([8.0, 4.0, 2.0])
    np.testing.assert_allclose(new[CORNER_VERTICES == 0], np.tile(expected, (3, 1)), atol=1e-12)
    np.testing.assert_allclose(new[CORNER_VERTICES != 0], old[CORNER_VERTICES != 0], atol=1e-12)


def test_indexed_normals() -> None:
    smooth = recompute_normals(
        POLYGONS, CUBE @ TURN, CUBE / np.sqrt(3), "faceVarying", CORNER_VERTICES
    )
    np.testing.assert_allclose(present(smooth), CUBE @ TURN / np.sqrt(3), atol=1e-6)
    # One normal for a whole face is used by four vertices that may part.
    shared = np.repeat(np.arange(6), 4)
    assert recompute_normals(POLYGONS, CUBE, FACE_NORMALS, "faceVarying", shared) is None
    per_face = recompute_normals(POLYGONS, CUBE, FACE_NORMALS, "uniform", np.arange(6))
    np.testing.assert_allclose(present(per_face), FACE_NORMALS)
    assert recompute_normals(POLYGONS, CUBE, FACE_NORMALS, "uniform", np.zeros(6, int)) is None


@pytest.mark.parametrize(
    "interpolation, count, slots",
    [
        ("constant", 1, None),
        ("vertex", 7, None),
        ("faceVarying", 8, None),
        ("vertex", 8, np.arange(7)),
        ("vertex", 8, np.arange(8) + 1),
        ("vertex", 8, np.arange(8) - 1),
        ("vertex", 0, None),
    ],
)
def test_normals_that_do_not_fit_are_not_recomputed(
    interpolation: str, count: int, slots: NDArray[np.int64] | None
) -> None:
    old = np.ones((count, 3))
    assert recompute_normals(POLYGONS, CUBE, old, interpolation, slots) is None


def test_points_without_area_keep_their_normals() -> None:
    old = CUBE / np.sqrt(3)
    np.testing.assert_array_equal(recompute_normals(POLYGONS, CUBE * 0, old, "vertex"), old)


def written_over(
    tmp_path: Path, name: str, values: NDArray[np.float64], interpolation: str
) -> Usd.Stage:
    """A cube with normals at frames 1 to 3, turned at frame 2 by the writer."""
    stage = new_stage(tmp_path / "in.usda")
    cube = define_cube(stage, times=[1.0, 2.0, 3.0])
    for time in (1.0, 2.0, 3.0):
        cube.GetPointsAttr().Set(vec3f(CUBE), time)
    if name == "normals":
        cube.CreateNormalsAttr().Set(vec3f(values))
        cube.SetNormalsInterpolation(interpolation)
    else:
        primvar = UsdGeom.PrimvarsAPI(cube).CreatePrimvar(
            "normals", Sdf.ValueTypeNames.Normal3fArray, interpolation
        )
        primvar.Set(vec3f(values))
    stage.GetRootLayer().Save()
    opened = open_stage(tmp_path / "in.usda")
    mesh = read_meshes(opened).meshes[0]
    with OverrideWriter(opened, tmp_path / "out.usda", settings={}) as writer:
        writer.write(mesh, 2.0, CUBE @ TURN)
        writer.commit()
    assert authored_properties(tmp_path / "out.usda") == {
        "/Root/Cube.points",
        "/Root/Cube.extent",
        f"/Root/Cube.{name}",
    }
    return Usd.Stage.Open(str(tmp_path / "out.usda"))


@pytest.mark.parametrize("name", ["normals", "primvars:normals"])
def test_written_frames_get_new_normals_and_kept_ones_the_old(tmp_path: Path, name: str) -> None:
    old = np.repeat(FACE_NORMALS, 4, axis=0)
    stage = written_over(tmp_path, name, old, "faceVarying")
    attribute = stage.GetAttributeAtPath(f"/Root/Cube.{name}")
    assert attribute.GetTimeSamples() == [1.0, 2.0, 3.0]
    np.testing.assert_array_equal(attribute.Get(1.0), old)
    np.testing.assert_allclose(attribute.Get(2.0), old @ TURN, atol=1e-6)
    np.testing.assert_array_equal(attribute.Get(3.0), old)
    interpolation = UsdGeom.Primvar(attribute).GetInterpolation()
    if name == "primvars:normals":
        assert interpolation == "faceVarying"


def test_normals_that_cannot_follow_are_blocked_at_all_times(tmp_path: Path) -> None:
    stage = written_over(tmp_path, "normals", FACE_NORMALS[:1], "constant")
    attribute = stage.GetAttributeAtPath("/Root/Cube.normals")
    assert not attribute.HasValue() and attribute.GetTimeSamples() == []


def test_blocking_after_some_frames_drops_their_normals(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    cube = define_cube(stage, times=[1.0, 2.0, 3.0])
    cube.SetNormalsInterpolation("vertex")
    for time, count in ((1.0, 8), (2.0, 3), (3.0, 8)):
        cube.CreateNormalsAttr().Set(vec3f(CUBE[:count]), time)
    stage.GetRootLayer().Save()
    opened = open_stage(tmp_path / "in.usda")
    mesh = read_meshes(opened).meshes[0]
    with OverrideWriter(opened, tmp_path / "out.usdc", settings={}) as writer:
        for time in (1.0, 2.0, 3.0):
            writer.write(mesh, time, CUBE)
        assert writer.warnings == ["/Root/Cube: normals cannot follow the points and are blocked"]
        writer.commit()
    out = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    assert not out.GetAttributeAtPath("/Root/Cube.normals").HasValue()


def test_indexed_primvar_keeps_its_indices(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    cube = define_cube(stage)
    primvar = UsdGeom.PrimvarsAPI(cube).CreatePrimvar(
        "normals", Sdf.ValueTypeNames.Normal3fArray, "faceVarying"
    )
    primvar.Set(vec3f(CUBE / np.sqrt(3)))
    primvar.SetIndices(Vt.IntArray(CORNER_VERTICES.tolist()))
    stage.GetRootLayer().Save()
    opened = open_stage(tmp_path / "in.usda")
    mesh = read_meshes(opened).meshes[0]
    with OverrideWriter(opened, tmp_path / "out.usdc", settings={}) as writer:
        writer.write(mesh, float("nan"), CUBE @ TURN)
        writer.commit()
    out = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    result = UsdGeom.PrimvarsAPI(out.GetPrimAtPath("/Root/Cube")).GetPrimvar("normals")
    np.testing.assert_allclose(
        result.ComputeFlattened(), (CUBE @ TURN / np.sqrt(3))[CORNER_VERTICES], atol=1e-6
    )
