from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from tests.usd_stages import CUBE, CUBE_QUADS
from usd_io.polygons import nonmanifold_edges, triangulate

COUNTS = [len(quad) for quad in CUBE_QUADS]
INDICES = [corner for quad in CUBE_QUADS for corner in quad]
# Concave outlines in the plane, counter-clockwise.
ARROW: list[list[float]] = [[0, 0], [4, -2], [2, 0], [4, 2], [1, 0.5]]
COMB = [
    [0, 0],
    [7, 0],
    [7, 4],
    [6, 4],
    [6, 1],
    [4, 1],
    [4, 4],
    [3, 4],
    [3, 1],
    [1, 1],
    [1, 4],
    [0, 4],
]
SPIRAL = [
    [0, 0],
    [6, 0],
    [6, 6],
    [1, 6],
    [1, 2],
    [4, 2],
    [4, 4],
    [3, 4],
    [3, 3],
    [2, 3],
    [2, 5],
    [5, 5],
    [5, 1],
    [0, 1],
]


def vector_areas(points: NDArray[np.floating], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    corners = points[faces]
    return 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def turned(outline: ArrayLike) -> NDArray[np.float64]:
    """An outline somewhere in space, on no axis plane."""
    basis, _ = np.linalg.qr(np.array([[1.0, 2.0, 3.0], [0.0, 1.0, 4.0], [5.0, 6.0, 0.0]]))
    turned_points: NDArray[np.float64] = np.array(outline, dtype=float) @ basis[:2] + [
        3.0,
        -7.0,
        11.0,
    ]
    return turned_points


def test_quads_are_fans_from_their_first_vertex() -> None:
    result = triangulate(COUNTS, INDICES, CUBE)
    assert result.faces.dtype == np.int32 and result.polygons.dtype == np.int32
    assert result.faces[:2].tolist() == [[0, 2, 3], [0, 3, 1]]
    assert result.polygons.tolist() == np.repeat(np.arange(6), 2).tolist()
    outwards = np.einsum("ij,ij->i", vector_areas(CUBE, result.faces), CUBE[result.faces].mean(1))
    assert (outwards > 0).all()


def test_concave_quads_stay_fans() -> None:
    points = np.array([[0, 0, 0], [2, 1, 0], [0, 3, 0], [1, 1, 0]], dtype=float)
    assert triangulate([4], [0, 1, 2, 3], points).faces.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_convex_polygons_stay_fans() -> None:
    angles = np.arange(7) * 2 * np.pi / 7
    points = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    fan = [[0, k, k + 1] for k in range(1, 6)]
    assert triangulate([7], range(7), points).faces.tolist() == fan


@pytest.mark.parametrize("outline", [ARROW, COMB, SPIRAL, SPIRAL[3:] + SPIRAL[:3]])
def test_concave_polygons_are_covered_exactly_once(outline: list[list[float]]) -> None:
    points = turned(outline)
    faces = triangulate([len(points)], np.arange(len(points)), points).faces
    assert len(faces) == len(points) - 2
    whole = vector_areas(points, np.array([[0, k, k + 1] for k in range(1, len(points) - 1)]))
    normal = whole.sum(0) / np.linalg.norm(whole.sum(0))
    areas = vector_areas(points, faces) @ normal
    # All positive and summing up to the outline's area: no overlap, nothing outside.
    assert (areas > 1e-9).all()
    assert areas.sum() == pytest.approx(np.linalg.norm(whole.sum(0)), rel=1e-12)
    fan = whole @ normal
    assert (fan < 0).any(), "the fan would have done as well: not a test"


def test_a_touching_bridge_does_not_stop_the_ears() -> None:
    # A square with a square hole, joined by a bridge: corners 0 and 4 are used twice.
    points = np.array([[0, 0], [9, 0], [9, 9], [0, 9], [3, 3], [3, 6], [6, 6], [6, 3]], dtype=float)
    points = np.column_stack([points, np.zeros(8)])
    loop = [0, 1, 2, 3, 0, 4, 5, 6, 7, 4]
    areas = vector_areas(points, triangulate([10], loop, points).faces)[:, 2]
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(81 - 9)


def test_mixed_polygons_keep_their_places() -> None:
    arrow = turned(ARROW)
    points = np.concatenate([CUBE, arrow])
    counts = [4, 5, 3]
    indices = [0, 2, 3, 1, 8, 9, 10, 11, 12, 4, 5, 7]
    result = triangulate(counts, indices, points)
    assert result.polygons.tolist() == [0, 0, 1, 1, 1, 2]
    assert result.faces[-1].tolist() == [4, 5, 7]
    assert set(result.faces[2:5].ravel().tolist()) == {8, 9, 10, 11, 12}


def test_holes_take_no_part() -> None:
    result = triangulate(COUNTS, INDICES, CUBE, holes=[1, 4])
    assert sorted(set(result.polygons.tolist())) == [0, 2, 3, 5]
    assert result.holes == 2 and result.degenerate == 0


def test_degenerate_polygons_take_no_part() -> None:
    counts = [3, 2, 1, 0, 3, 4]
    indices = [0, 1, 2, 3, 4, 5, 6, 6, 7, 0, 1, 1, 2]
    result = triangulate(counts, indices, CUBE)
    assert result.faces.tolist() == [[0, 1, 2], [0, 1, 2]]
    assert result.polygons.tolist() == [0, 5]
    assert result.degenerate == 4


def test_flip_reverses_every_triangle() -> None:
    plain = triangulate(COUNTS, INDICES, CUBE).faces
    flipped = triangulate(COUNTS, INDICES, CUBE, flip=True).faces
    np.testing.assert_array_equal(vector_areas(CUBE, flipped), -vector_areas(CUBE, plain))
    # The same diagonals, so that counts do not depend on the orientation.
    np.testing.assert_array_equal(np.sort(flipped, axis=1), np.sort(plain, axis=1))


@pytest.mark.parametrize(
    "counts, indices, reason",
    [
        ([4], [0, 1, 2], "expected 4 face vertex indices .* got 3"),
        ([3], [0, 1, 9], "index 9 at corner 2 is out of range: expected 0 to 7"),
        ([3], [0, -1, 2], "index -1 at corner 1"),
        ([3, -1], [0, 1, 2], "polygon 1 has -1 corners"),
    ],
)
def test_topology_that_does_not_fit_is_refused(
    counts: list[int], indices: list[int], reason: str
) -> None:
    with pytest.raises(ValueError, match=reason):
        triangulate(counts, indices, CUBE)


def test_no_polygons_are_no_triangles() -> None:
    assert triangulate([], [], CUBE).faces.shape == (0, 3)


def test_nonmanifold_edges_are_counted() -> None:
    faces = triangulate(COUNTS, INDICES, CUBE).faces
    assert nonmanifold_edges(faces) == 0
    fin = np.array([[faces[0, 0], faces[0, 1], 8]], dtype=np.int32)
    assert nonmanifold_edges(np.concatenate([faces, fin])) == 1
    assert nonmanifold_edges(np.empty((0, 3), dtype=np.int32)) == 0
