"""Distances along a surface between triangles: known ones, bounds that change nothing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csgraph

from dtrepair import find_intersections
from dtrepair.numerics.geodesics import largest_geodesic, surface_graph
from tests.meshes import Mesh, armed_body, bent_tube, grid, icosphere, joined, knot


def test_a_flat_sheet_has_straight_diagonals() -> None:
    points, faces = grid(8, 8)
    distance = csgraph.dijkstra(surface_graph(points, faces), directed=False, indices=0)
    straight = np.linalg.norm(points - points[0], axis=1)
    # Four ways to go, in eighths of a turn: the worst between two of them is 1 / cos(22.5 degrees).
    assert (distance >= straight - 1e-12).all()
    assert (distance <= 1.0824 * straight + 1e-12).all()
    corner = np.abs(straight - straight.max()) < 1e-12
    assert distance[corner] == pytest.approx(straight[corner])


def test_opposite_triangles_of_a_sphere_are_half_a_turn_apart() -> None:
    points, faces = icosphere(3)
    middle = points[faces].mean(axis=1)
    pair = np.array([[middle[:, 2].argmax(), middle[:, 2].argmin()]], dtype=np.int32)
    # Of a sphere of size 1; nearest corners are an edge nearer than the centres.
    assert largest_geodesic(points, faces, pair) == pytest.approx(np.pi / 2, rel=0.1)
    assert largest_geodesic(7.0 * points - 3.0, faces, pair) == pytest.approx(
        largest_geodesic(points, faces, pair)
    )


CROSSING = {"knot": knot(), "tube": bent_tube(6.5), "arm": armed_body(4.2)}


@pytest.mark.parametrize("mesh", CROSSING.values(), ids=CROSSING)
def test_the_largest_is_that_of_a_search_from_every_triangle(mesh: Mesh) -> None:
    points, faces = mesh
    pairs = find_intersections(points, faces)
    graph, expected = surface_graph(points, faces), 0.0
    for first, second in pairs:
        away = csgraph.dijkstra(graph, directed=False, indices=faces[first], min_only=True)
        expected = max(expected, float(away[faces[second]].min()))
    assert largest_geodesic(points, faces, pairs) * np.ptp(points, axis=0).max() == pytest.approx(
        expected
    )
    assert expected > 0.5


def test_different_parts_and_no_pairs_have_no_distance() -> None:
    points, faces = joined(icosphere(1), icosphere(1))
    apart = np.array([[0, len(faces) - 1]], dtype=np.int32)
    assert largest_geodesic(points, faces, apart) == 0.0
    assert largest_geodesic(points, faces, apart[:0]) == 0.0
