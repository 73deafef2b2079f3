"""What the reader makes of polygons: topology that changes, bad indices, holes, seams."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import UsdGeom

from tests.usd_reading import edited_cube, selection_of
from tests.usd_stages import CUBE, CUBE_QUADS, cube_file, define_cube
from usd_io import StageError


def test_topology_that_changes_is_refused_or_skipped(tmp_path: Path) -> None:
    def vary(mesh: UsdGeom.Mesh) -> None:
        indices = list(mesh.GetFaceVertexIndicesAttr().Get())
        mesh.GetFaceVertexIndicesAttr().Set(indices, 1.0)
        mesh.GetFaceVertexIndicesAttr().Set(indices, 2.0)
        mesh.GetFaceVertexIndicesAttr().Set(indices[::-1], 3.0)
        other = define_cube(mesh.GetPrim().GetStage(), "/Root/Other")
        other.GetHoleIndicesAttr().Set([1], 1.0)
        other.GetHoleIndicesAttr().Set([2], 2.0)
        define_cube(mesh.GetPrim().GetStage(), "/Root/Fine")

    path = edited_cube(tmp_path, vary)
    with pytest.raises(
        StageError, match=r"/Root/Cube: .*faceVertexIndices at frame 3.*--skip-varying"
    ):
        selection_of(path)
    with pytest.raises(StageError, match=r"/Root/Other: .*holeIndices at frame 2"):
        selection_of(path, prim="/Root/Other")
    selection = selection_of(path, skip_varying=True)
    assert [mesh.path for mesh in selection.meshes] == ["/Root/Fine"]
    assert "/Root/Cube" in selection.warnings[0] and "skipped" in selection.warnings[0]
    assert len(selection_of(path, exclude="/Root/Cube /Root/Other").meshes) == 1


def test_equal_topology_samples_are_no_change(tmp_path: Path) -> None:
    def repeat(mesh: UsdGeom.Mesh) -> None:
        for attribute in (mesh.GetFaceVertexIndicesAttr(), mesh.GetFaceVertexCountsAttr()):
            value = attribute.Get()
            attribute.Clear()
            for time in (1.0, 2.0):
                attribute.Set(value, time)

    assert selection_of(edited_cube(tmp_path, repeat)).meshes[0].faces.shape == (12, 3)


@pytest.mark.parametrize(
    "index, reason", [(8, "index 8 at corner 5 is out of range: expected 0 to 7"), (-1, "index -1")]
)
def test_indices_out_of_range_are_bad_input(tmp_path: Path, index: int, reason: str) -> None:
    def spoil(mesh: UsdGeom.Mesh) -> None:
        indices = list(mesh.GetFaceVertexIndicesAttr().Get())
        indices[5] = index
        mesh.GetFaceVertexIndicesAttr().Set(indices)

    with pytest.raises(StageError, match=rf"/Root/Cube: .*{reason}"):
        selection_of(edited_cube(tmp_path, spoil))
    # The same with samples only, where the number of points is that of the samples.
    with pytest.raises(StageError, match="/Root/Cube: "):
        selection_of(edited_cube(tmp_path, spoil, times=[1.0]))


def test_holes_and_degenerate_polygons_take_no_part(tmp_path: Path) -> None:
    polygons = [*CUBE_QUADS, [0, 1], [2, 2, 2], [5, 5, 6]]
    path = edited_cube(tmp_path, lambda mesh: mesh.GetHoleIndicesAttr().Set([2]), polygons=polygons)
    mesh = selection_of(path).meshes[0]
    assert sorted(set(mesh.polygons.tolist())) == [0, 1, 3, 4, 5]
    assert any("3 degenerate polygons" in text for text in mesh.warnings)


def test_left_handed_meshes_are_turned_inside_out(tmp_path: Path) -> None:
    right = selection_of(cube_file(tmp_path / "right.usda")).meshes[0]
    left = selection_of(
        edited_cube(tmp_path, lambda mesh: mesh.GetOrientationAttr().Set("leftHanded"))
    ).meshes[0]
    np.testing.assert_array_equal(left.faces, right.faces[:, [0, 2, 1]])


def test_concave_polygons_are_not_fans(tmp_path: Path) -> None:
    outline = [[0, 0, 0], [4, -2, 0], [2, 0, 0], [4, 2, 0], [1, 0.5, 0]]
    path = cube_file(tmp_path / "arrow.usda", points=outline, polygons=[[0, 1, 2, 3, 4]])
    corners = selection_of(path).meshes[0].rest[selection_of(path).meshes[0].faces]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0).all()


def test_nonmanifold_and_subdivided_meshes_are_warned_of(tmp_path: Path) -> None:
    path = edited_cube(
        tmp_path,
        lambda mesh: mesh.GetSubdivisionSchemeAttr().Set("catmullClark"),
        polygons=[*CUBE_QUADS, [0, 2, 7]],
    )
    selection = selection_of(path)
    # Edge 0-2 has three triangles now; 2-7 is a diagonal of a quad, 7-0 is new.
    assert any("non-manifold" in text for text in selection.warnings)
    assert any("subdivision surface (catmullClark)" in text for text in selection.warnings)


def test_seams_of_coincident_points_are_kept(tmp_path: Path) -> None:
    points = np.concatenate([CUBE, CUBE])
    polygons = [*CUBE_QUADS[:3], *[[corner + 8 for corner in quad] for quad in CUBE_QUADS[3:]]]
    mesh = selection_of(
        cube_file(tmp_path / "seams.usda", points=points, polygons=polygons)
    ).meshes[0]
    assert mesh.rest.shape == (16, 3) and mesh.faces.max() == 15
    np.testing.assert_array_equal(mesh.rest[:8], mesh.rest[8:])
