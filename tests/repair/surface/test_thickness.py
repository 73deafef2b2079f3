"""Thickness: that of plates, balls and tubes is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.repair.surface.thickness import thinnest
from tests.meshes import Mesh, bent_tube, grid, icosphere, joined, subdivided, tube


def plate(thickness: float) -> Mesh:
    """A closed box of 1 x 1 x thickness, of small triangles."""
    import trimesh

    box = trimesh.creation.box((1.0, 1.0, thickness))
    mesh = np.asarray(box.vertices, np.float64), np.asarray(box.faces, np.int32)
    for _ in range(3):
        mesh = subdivided(*mesh)
    return mesh


@pytest.mark.parametrize(
    ("mesh", "thickness"),
    [
        (plate(0.1), 0.1),
        (plate(0.01), 0.01),
        (icosphere(3, 0.5), 1.0),
        (tube(radius=0.2), 0.4),
        (bent_tube(4.0, radius=0.1), 0.2),
    ],
)
def test_shapes_of_known_thickness(mesh: Mesh, thickness: float) -> None:
    points, faces = mesh
    assert thinnest(points, faces, 10.0) == pytest.approx(thickness, rel=0.05)
    assert thinnest(points, faces, 0.9 * thickness) == np.inf
    # The same inside out, elsewhere, turned and in other units.
    turn = np.linalg.qr(np.array([[1.0, 2.0, 3.0], [0.0, 1.0, 4.0], [5.0, 6.0, 0.0]]))[0]
    assert thinnest(points, faces[:, ::-1], 10.0) == pytest.approx(thickness, rel=0.05)
    moved = 100.0 * points @ turn + 1e4
    assert thinnest(moved, faces, 1e3) == pytest.approx(100.0 * thickness, rel=0.05)


def test_the_thinnest_part_counts_and_parts_are_no_walls_of_each_other() -> None:
    ball, sheet = icosphere(3), plate(0.05)
    apart: NDArray[np.float64] = sheet[0] + [3.0, 0.0, 0.0]
    assert thinnest(*joined(ball, (apart, sheet[1])), 10.0) == pytest.approx(0.05, rel=0.05)
    inner = icosphere(3, 0.9)
    assert thinnest(*joined(ball, inner), 10.0) == pytest.approx(1.8, rel=0.05)


def test_what_has_no_other_side_is_not_thin() -> None:
    points, faces = grid(8, 8)
    assert thinnest(points, faces, 10.0) == np.inf
    assert thinnest(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32), 1.0) == np.inf
