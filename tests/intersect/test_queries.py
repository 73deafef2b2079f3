"""Folds, ring distances and ray crossings against slow definitions written here."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.intersect.detector import Detector
from dtrepair.intersect.queries import Queries, one_vertex_pairs
from tests.integer_arithmetic import as_integers, cross, dot, sign
from tests.meshes import Mesh, elbow, grid, icosphere, joined, overlapping_spheres, torus, tube

SPHERE = icosphere(2)


def queries_of(mesh: Mesh) -> Queries:
    return Queries(Detector(*mesh))


def rounded(points: NDArray[np.float64]) -> NDArray[np.float32]:
    return points.astype(np.float32)


def crumpled(mesh: Mesh, noise: float, seed: int = 0) -> Mesh:
    points, faces = mesh
    random = np.random.default_rng(seed)
    return points + noise * random.normal(size=points.shape), faces


def slow_one_vertex_pairs(faces: NDArray[np.int32]) -> list[tuple[int, int]]:
    corners = [set(face) for face in faces.tolist()]
    pairs = itertools.combinations(range(len(faces)), 2)
    return [(i, j) for i, j in pairs if len(corners[i] & corners[j]) == 1]


def slow_folds(points: NDArray[np.float32], faces: NDArray[np.int32]) -> set[tuple[int, int]]:
    """In integers: the edge opposite the shared vertex of one properly crosses the other."""
    exact = as_integers(points)

    def crosses(p: int, q: int, triangle: NDArray[np.int32]) -> bool:
        a, b, c = (exact[k] for k in triangle)
        normal = cross(b - a, c - a)
        sides = [int(sign(np.array([dot(normal, exact[k] - a)]))[0]) for k in (p, q)]
        if sides[0] * sides[1] >= 0:
            return False
        ends = [(a, b), (b, c), (c, a)]
        turns = [dot(cross(exact[q] - exact[p], u - exact[p]), v - exact[p]) for u, v in ends]
        return all(t >= 0 for t in turns) or all(t <= 0 for t in turns)

    found = set()
    for i, j in slow_one_vertex_pairs(faces):
        shared = set(faces[i]) & set(faces[j])
        opposite = [[k for k in faces[t] if k not in shared] for t in (i, j)]
        (p, q), (r, s) = opposite
        if crosses(p, q, faces[j]) or crosses(r, s, faces[i]):
            found.add((i, j))
    return found


@pytest.mark.parametrize("mesh", [SPHERE, grid(4, 3), joined(icosphere(1), tube(5, 3))])
def test_pairs_around_a_vertex_are_those_that_share_exactly_one(mesh: Mesh) -> None:
    points, faces = mesh
    rows = one_vertex_pairs(faces, len(points))
    pairs = np.sort(rows[:, [0, 2]], axis=1)
    assert sorted(map(tuple, pairs.tolist())) == slow_one_vertex_pairs(faces)
    shared = faces[rows[:, 0], rows[:, 1]]
    assert np.array_equal(shared, faces[rows[:, 2], rows[:, 3]])
    assert (np.diff(shared) >= 0).all()


def test_separate_triangles_have_no_pairs_around_a_vertex() -> None:
    faces = np.arange(9, dtype=np.int32).reshape(3, 3)
    assert one_vertex_pairs(faces, 9).shape == (0, 4)


@pytest.mark.parametrize("noise", [0.02, 0.06, 0.1, 0.3])
def test_folds_are_the_exact_ones(noise: float) -> None:
    points, faces = crumpled(icosphere(2), noise)
    found = queries_of((points, faces)).folds(rounded(points))
    assert (found[:, 0] < found[:, 1]).all()
    as_set = set(map(tuple, found.tolist()))
    assert len(as_set) == len(found)
    assert as_set == slow_folds(rounded(points), faces)


def test_folds_of_a_deep_crease_are_the_exact_ones() -> None:
    points, faces = elbow(2.6)
    found = queries_of((points, faces)).folds(rounded(points))
    expected = slow_folds(rounded(points), faces)
    assert len(expected) > 0
    assert set(map(tuple, found.tolist())) == expected


@pytest.mark.parametrize("mesh", [SPHERE, torus(), elbow(0.0), grid(6, 6)])
def test_smooth_surfaces_have_no_folds(mesh: Mesh) -> None:
    assert queries_of(mesh).folds(rounded(mesh[0])).shape == (0, 2)


def test_vertices_without_triangles_after_the_last_have_no_folds() -> None:
    points, faces = icosphere(1)
    # Far more than what lies behind the arrays of a small mesh by chance.
    unused = np.zeros((4000, 3))
    for corners in (faces, faces[:0]):
        every = np.concatenate([points, unused]).astype(np.float32)
        assert len(Queries(Detector(every, corners)).folds(every)) == 0


def test_active_folds_are_those_around_the_active_vertices() -> None:
    points, faces = crumpled(icosphere(2), 0.1)
    queries = queries_of((points, faces))
    every = queries.folds(rounded(points))
    active = np.random.default_rng(1).random(len(points)) < 0.5
    shared = [next(iter(set(faces[i]) & set(faces[j]))) for i, j in every]
    expected = every[active[shared]]
    found = queries.folds(rounded(points), active=active)
    assert 0 < len(expected) < len(every)
    assert set(map(tuple, found.tolist())) == set(map(tuple, expected.tolist()))
    assert queries.folds(rounded(points), active=np.zeros(len(points), bool)).shape == (0, 2)


def test_rays_of_a_closed_surface_balance() -> None:
    points, faces = overlapping_spheres(2, 1.2)
    queries = queries_of((points, faces))
    half = len(points) // 2
    random = np.random.default_rng(0)
    vertices = np.arange(len(points), dtype=np.int32)
    # Outward rays of a sphere meet only the other one: once from inside it, else not in balance.
    centre = np.repeat([[0.0, 0, 0], [1.2, 0, 0]], half, axis=0)
    outward = points - centre
    other = np.linalg.norm(points - centre[::-1], axis=1)
    rays = outward + 0.2 * random.normal(size=outward.shape)
    crossings = queries.crossings(rounded(points), vertices, rays)
    assert (crossings[other < 0.95] == 1).all() and (other < 0.95).sum() > 10
    assert (crossings[other > 1.0] == 0).all()


def test_rays_count_entries_down_and_exits_up() -> None:
    # Ray origins of their own triangle; the target triangle is met from behind, then from before.
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, -1, 2], [3, -1, 2], [-1, 3, 2]], float)
    up = np.array([[0.01, 0.02, 1.0], [0.01, 0.02, -1.0]])
    origins = np.zeros(2, dtype=np.int32)
    for order, sign_of in (([3, 4, 5], 1), ([3, 5, 4], -1)):
        faces = np.array([[0, 1, 2], order], dtype=np.int32)
        crossings = queries_of((points, faces)).crossings(rounded(points), origins, up)
        assert crossings.tolist() == [sign_of, 0]


def test_a_vertex_that_is_wound_twice_is_looked_at() -> None:
    # Sixteen triangles of 45 degrees go around the vertex twice, on a spiral that rises and drops:
    # all face up, and yet the two turns cross.
    angle = np.arange(16) * np.pi / 4
    height = 0.2 * np.sin(angle / 2)
    rim = np.stack([np.cos(angle), np.sin(angle), height], axis=1)
    points = np.concatenate([rim, np.zeros((1, 3))])
    faces = np.array([(16, k, (k + 1) % 16) for k in range(16)], dtype=np.int32)
    assert len(Queries(Detector(points, faces)).folds(points.astype(np.float32))) > 0
    flat = np.stack([np.cos(angle / 2), np.sin(angle / 2), height], axis=1)
    points = np.concatenate([flat, np.zeros((1, 3))])
    assert len(Queries(Detector(points, faces)).folds(points.astype(np.float32))) == 0


def test_vector_areas_are_those_of_the_triangles_around() -> None:
    points, faces = torus()
    corners = points[faces]
    area = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    expected = np.zeros_like(points)
    np.add.at(expected, faces.ravel(), np.repeat(area / 3.0, 3, axis=0))
    found = Queries(Detector(points, faces)).vector_areas(points)
    assert np.abs(found - expected).max() < 1e-15
