"""Welding, parts, volumes, winding numbers and nearest points of known shapes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.measures.surfaces import (
    closest_weights,
    flooded,
    grown,
    make_surface,
    nearest_on_triangles,
    openings,
    volumes,
    winding_numbers,
)
from tests.meshes import grid, icosphere, joined, torus, tube

TRIANGLE = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]])


def split_sphere() -> tuple[np.ndarray, np.ndarray]:
    """A sphere every triangle of which has corners of its own."""
    points, faces = icosphere(1)
    return points[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)


def test_split_vertices_weld_into_one_closed_part() -> None:
    points, faces = split_sphere()
    surface = make_surface(points, faces)
    assert surface.parts == 1 and surface.closed.all()
    assert len(surface.point_of) == 42 and len(surface.edges) == 120
    assert np.array_equal(points[surface.point_of][surface.vertex_of], points)


def test_a_part_with_a_hole_is_open_and_has_no_volume() -> None:
    points, faces = joined(icosphere(2), torus(), tube())
    surface = make_surface(points, np.delete(faces, 5, axis=0).astype(np.int64))
    assert surface.parts == 3
    assert surface.closed.tolist() == [False, True, False]
    assert np.isnan(volumes(points[surface.point_of], surface)).tolist() == [True, False, True]


def test_openings_are_told_from_their_rims() -> None:
    # A tube of radius 0.2 and length 2 is open at two ends; a grid is its own opening.
    flat, squares = grid(6, 6)
    points, faces = joined(tube(64), (flat + 9.0, squares), torus())
    surface = make_surface(points, faces.astype(np.int64))
    share = openings(points[surface.point_of], surface)
    assert share == pytest.approx([0.2 / 2.0, 1.0, 0.0], abs=1e-3)


def test_parts_of_different_owners_at_one_place_stay_apart() -> None:
    points, faces = joined(icosphere(1), icosphere(1))
    owner = np.repeat([0, 1], len(points) // 2)
    assert make_surface(points, faces.astype(np.int64), owner).parts == 2
    assert make_surface(points, faces.astype(np.int64)).parts == 1


def test_volume_of_a_box_is_exact_and_turns_with_the_triangles() -> None:
    corners = np.array([[x, y, z] for x in (0, 2) for y in (0, 3) for z in (0, 5)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    surface = make_surface(corners, faces)
    assert surface.closed.all()
    assert volumes(corners[surface.point_of], surface) == pytest.approx([30.0])
    back = make_surface(corners, faces[:, ::-1])
    assert volumes(corners[back.point_of], back) == pytest.approx([-30.0])


def test_winding_number_counts_the_layers_around_a_point() -> None:
    points, faces = icosphere(2)
    inner, outer = points[faces], 3.0 * points[faces]
    queries = np.array([[0.1, 0.2, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 5.0]])
    both = np.concatenate([inner, outer])
    assert winding_numbers(queries, both) == pytest.approx([2.0, 1.0, 0.0], abs=1e-9)
    assert winding_numbers(queries, inner[:, ::-1]) == pytest.approx([-1.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize(
    ("query", "weights"),
    [
        ((1.0, 1.0, 7.0), (0.5, 0.25, 0.25)),  # above the inside
        ((2.0, -3.0, 1.0), (0.5, 0.5, 0.0)),  # beside an edge
        ((3.0, 3.0, 0.0), (0.0, 0.5, 0.5)),  # beyond the long edge
        ((-1.0, -2.0, 0.0), (1.0, 0.0, 0.0)),  # beyond a corner
    ],
)
def test_nearest_point_of_a_triangle(query: tuple[float, ...], weights: tuple[float, ...]) -> None:
    assert closest_weights(np.array([query]), TRIANGLE[None])[0] == pytest.approx(weights)


def test_a_triangle_of_no_area_is_a_segment() -> None:
    flat = np.array([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]])
    weights = closest_weights(np.array([[1.5, 1.0, 0.0]]), flat)
    assert weights @ flat[0] == pytest.approx(np.array([[1.5, 0.0, 0.0]]))


def test_nearest_of_many_triangles_is_that_of_all_looked_at_one_by_one() -> None:
    points, faces = torus(12, 8)
    triangles = points[faces]
    queries = np.random.default_rng(3).normal(size=(50, 3))
    index, weights, distance = nearest_on_triangles(queries, triangles)
    for k, query in enumerate(queries):
        every = closest_weights(np.tile(query, (len(triangles), 1)), triangles)
        away = np.linalg.norm(np.einsum("nk,nkd->nd", every, triangles) - query, axis=1)
        assert distance[k] == pytest.approx(away.min())
        assert weights[k] @ triangles[index[k]] == pytest.approx(
            every[away.argmin()] @ triangles[away.argmin()]
        )


def test_growing_and_flooding_follow_the_edges() -> None:
    points, faces = tube(8, 10, 0.2, 10.0)  # eleven rings of eight, one unit apart
    surface = make_surface(points, faces.astype(np.int64))
    z = points[surface.point_of][:, 2]
    bottom = np.flatnonzero(z == z.min())
    assert z[grown(surface, bottom, 3)].max() == pytest.approx(-2.0)
    reached = flooded(surface, bottom, lambda own: (z[own] < -2.5) | (z[own] > 2.5))
    assert sorted(set(z[reached].round(6))) == [-5.0, -4.0, -3.0]
    assert not len(flooded(surface, bottom, lambda own: z[own] > 0))
