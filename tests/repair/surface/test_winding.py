"""Winding numbers against solid angles, and the cuts they rest on."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray, triangle_normals
from dtrepair.repair.surface.surface import Surface
from dtrepair.repair.surface.topology import Topology
from dtrepair.repair.surface.winding import crossing_edges, winding_numbers
from tests.integer_arithmetic import integer_intersect
from tests.meshes import (
    Mesh,
    armed_body,
    icosphere,
    joined,
    knot,
    overlapping_spheres,
    torus,
)


def solid_angle_winding(points: FloatArray, faces: IntArray, queries: FloatArray) -> FloatArray:
    """Generalised winding number (Q,): signed solid angles over 4 pi (Van Oosterom 1983)."""
    total = np.zeros(len(queries))
    for block in np.array_split(np.arange(len(queries)), max(1, len(queries) // 100)):
        a, b, c = (points[faces[:, k]][None] - queries[block][:, None] for k in range(3))
        la, lb, lc = (np.linalg.norm(u, axis=2) for u in (a, b, c))
        volume = np.einsum("ijk,ijk->ij", a, np.cross(b, c))
        ab, bc, ca = (np.einsum("ijk,ijk->ij", u, v) for u, v in ((a, b), (b, c), (c, a)))
        below = la * lb * lc + ab * lc + bc * la + ca * lb
        total[block] = 2 * np.arctan2(volume, below).sum(axis=1)
    return total / (4 * np.pi)


def just_outside(surface: Surface, distance: float) -> FloatArray:
    normals = surface.vector_areas(surface.rest)
    of_vertices: FloatArray = surface.rest + distance * normals / np.linalg.norm(
        normals, axis=1, keepdims=True
    )
    return of_vertices


def sure_winding(surface: Surface) -> tuple[IntArray, NDArray[np.bool_]]:
    """Winding just outside each vertex, and where it is the same at two distances."""
    two = [
        np.rint(
            solid_angle_winding(surface.rest, surface.faces, just_outside(surface, distance))
        ).astype(int)
        for distance in (1e-4, 1e-3)
    ]
    return two[0], two[0] == two[1]


def winding(surface: Surface) -> IntArray:
    return winding_numbers(surface, surface.rest, surface.contacts.pairs(surface.rest))


@pytest.mark.parametrize("distance", [0.7, 1.2, 1.7])
def test_two_spheres_bury_each_other_where_they_overlap(distance: float) -> None:
    points, faces = overlapping_spheres(3, distance)
    surface = Surface(points, faces)
    half = len(points) // 2
    centres = np.repeat([[distance, 0.0, 0.0], [0.0, 0.0, 0.0]], half, axis=0)
    other = np.linalg.norm(points - centres, axis=1)
    # The faceted sphere of level 3 is within 0.7 % of the round one.
    clear = np.abs(other - 1.0) > 0.01
    assert clear.mean() > 0.9 and (other < 0.99).sum() > 20
    assert np.array_equal(winding(surface)[clear], (other < 1.0)[clear].astype(int))


def moved(mesh: Mesh, *offset: float) -> Mesh:
    return mesh[0] + np.array(offset), mesh[1]


def standing(mesh: Mesh) -> Mesh:
    return mesh[0][:, [0, 2, 1]] * np.array([1.0, 1.0, -1.0]), mesh[1]


CLOSED = {
    "spheres": overlapping_spheres(2, 1.2),
    "knot": knot(),
    "arm": armed_body(5.0),
    "tori": joined(torus(), moved(standing(torus()), 0.2, 0.05, 0.02)),
    # Translated copies: edges meet edges exactly, and every triangle beside them just misses.
    "three spheres": joined(
        icosphere(2), moved(icosphere(2), 0.3, 0.013, 0.0), moved(icosphere(2), 0.1, 0.31, 0.017)
    ),
}


@pytest.mark.parametrize("name", CLOSED)
def test_winding_numbers_are_those_of_solid_angles(name: str) -> None:
    surface = Surface(*CLOSED[name])
    expected, sure = sure_winding(surface)
    found = winding(surface)
    assert sure.mean() > 0.95
    deepest = 2 if name == "three spheres" else 1
    assert (expected[sure] == deepest).sum() > 20
    # Pieces of one or two vertices beside the cut may be voted wrong.
    assert (found != expected)[sure].mean() < 0.005


def test_inside_out_spheres_count_down() -> None:
    points, faces = overlapping_spheres(2, 1.2)
    surface = Surface(points, np.ascontiguousarray(faces[:, ::-1]))
    expected, sure = sure_winding(surface)
    found = winding(surface)
    assert found.min() < 0
    assert (found != expected)[sure].mean() < 0.005


def test_without_pairs_nothing_is_buried() -> None:
    surface = Surface(*overlapping_spheres(1, 3.0))
    assert (winding(surface) == 0).all()


def test_the_same_pose_has_the_same_winding_numbers() -> None:
    surface = Surface(*knot())
    assert np.array_equal(winding(surface), winding(surface))


def test_crossing_edges_are_those_that_pass_through_the_other_triangle() -> None:
    surface = Surface(*overlapping_spheres())
    points, faces = surface.rest, surface.faces
    pairs = surface.contacts.pairs(points)
    found = set(map(tuple, crossing_edges(surface, points, pairs).tolist()))
    expected = set()
    normals = triangle_normals(points, faces)
    for mine, other in np.concatenate([pairs, pairs[:, ::-1]]).tolist():
        for corner in range(3):
            i, j = faces[mine][[corner, (corner + 1) % 3]].tolist()
            # An edge as a very thin triangle beside it.
            beside = points[j] + 1e-5 * np.cross(normals[other], points[j] - points[i])
            thin = np.array([[points[i], points[j], beside]], dtype=np.float32)
            if integer_intersect(thin, points[faces[other]][None].astype(np.float32))[0]:
                expected.add((min(i, j), max(i, j)))
    assert len(found) > 20
    assert found == expected


def test_an_edge_that_meets_an_edge_is_cut() -> None:
    # A roof of two triangles and an upright triangle, whose edge goes exactly through the ridge.
    roof = [[0, -1, 0], [1, 2, 0], [-1, 2, 0], [0.3, 0.7, 0.9], [0, 5, 0]]
    ridge = np.array(roof[0]) * 0.7 + np.array(roof[1]) * 0.3
    for seed in range(20):
        up = np.random.default_rng(seed).normal(size=3)
        points = np.array([*roof, ridge + up, ridge - up, ridge + np.array([5.0, 1, 3])])
        faces = np.array([[0, 1, 2], [1, 0, 3], [5, 6, 7]], dtype=np.int32)
        pairs = np.array([[0, 2], [1, 2]], dtype=np.int32)
        mesh = Topology(faces, len(points))
        assert (5, 6) in set(map(tuple, crossing_edges(mesh, points, pairs).tolist()))


def test_no_pairs_cross_no_edges() -> None:
    points, faces = icosphere(1)
    assert crossing_edges(
        Topology(faces, len(points)), points, np.zeros((0, 2), np.int32)
    ).shape == (0, 2)
