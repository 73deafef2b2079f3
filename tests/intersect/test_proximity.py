"""Close pairs against distances of every pair, written here in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.intersect.detector import Detector
from dtrepair.intersect.proximity import close_pairs, face_each_other
from dtrepair.numerics.geometry import FloatArray
from tests.meshes import Mesh, armed_body, icosphere, joined


def triangle_distances(first: FloatArray, second: FloatArray) -> FloatArray:
    """Distances (K,) of triangles that do not intersect, by many points on their boundaries.

    An upper bound, too large by at most the spacing of the points.
    """
    steps = np.linspace(0, 1, 17)[:, None]
    best = np.full(len(first), np.inf)
    for one, other in ((first, second), (second, first)):
        for k in range(3):
            p, q = one[:, k], one[:, (k + 1) % 3]
            samples = p[:, None] + steps * (q - p)[:, None]
            best = np.minimum(best, point_distances(samples, other).min(axis=1))
    return best


def point_distances(points: FloatArray, triangle: FloatArray) -> FloatArray:
    """Distances (K, n) of points (K, n, 3) from triangles (K, 3, 3)."""
    a, b, c = (triangle[:, None, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal = normal / np.linalg.norm(normal, axis=2, keepdims=True)
    height = ((points - a) * normal).sum(axis=2)
    inside = np.ones(height.shape, dtype=bool)
    best = np.full(height.shape, np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        inside &= (np.cross(q - p, points - p) * normal).sum(axis=2) >= 0
        along = ((points - p) * (q - p)).sum(axis=2) / ((q - p) ** 2).sum(axis=2)
        foot = p + np.clip(along, 0, 1)[..., None] * (q - p)
        best = np.minimum(best, np.linalg.norm(points - foot, axis=2))
    return np.where(inside, np.abs(height), best)


def two_balls(gap: float) -> Mesh:
    ball, faces = icosphere(2)
    return joined((ball, faces), (ball[:, [1, 2, 0]] + np.array([2.0 + gap, 0.1, 0.05]), faces))


@pytest.mark.parametrize(
    "mesh, distance",
    [(two_balls(0.0), 0.04), (two_balls(0.0), 0.12), (armed_body(3.2, 24, 8), 0.12)],
    ids=["balls 0.04", "balls 0.12", "arm"],
)
def test_close_pairs_are_those_within_the_distance(mesh: Mesh, distance: float) -> None:
    points, faces = mesh
    rounded = points.astype(np.float32)
    i, j = np.triu_indices(len(faces), 1)
    corners = rounded.astype(np.float64)[faces]
    low, high = corners.min(axis=1) - distance, corners.max(axis=1) + distance
    near = ((low[i] <= high[j]) & (low[j] <= high[i])).all(axis=1)
    i, j = i[near], j[near]
    share = (faces[i][:, :, None] == faces[j][:, None, :]).any(axis=(1, 2))
    i, j = i[~share], j[~share]
    measured = triangle_distances(corners[i], corners[j])
    found = close_pairs(Detector(points, faces), rounded, distance)
    assert np.array_equal(found, np.unique(found, axis=0)) and (found[:, 0] < found[:, 1]).all()
    chosen = set(map(tuple, found.tolist()))
    # Two samples are at most 1/16 edge apart: the true distance is smaller by half of that at most.
    slack = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max() / 32
    sure = set(zip(i[measured < distance].tolist(), j[measured < distance].tolist(), strict=True))
    maybe = measured < distance + slack
    assert sure <= chosen <= set(zip(i[maybe].tolist(), j[maybe].tolist(), strict=True))
    assert len(sure) > 3


def test_active_pairs_have_an_active_triangle() -> None:
    points, faces = two_balls(0.02)
    detector, rounded = Detector(points, faces), points.astype(np.float32)
    every = close_pairs(detector, rounded, 0.1)
    active = np.random.default_rng(0).random(len(faces)) < 0.3
    found = close_pairs(detector, rounded, 0.1, active=active)
    assert 0 < len(found) < len(every)
    assert np.array_equal(found, every[active[every].any(axis=1)])


def test_no_distance_and_no_triangles_have_no_pairs() -> None:
    points, faces = two_balls(0.02)
    assert close_pairs(Detector(points, faces), points.astype(np.float32), 0.0).shape == (0, 2)
    empty = Detector(points, faces[:0])
    assert close_pairs(empty, points.astype(np.float32), 0.1).shape == (0, 2)


def test_sides_of_a_gap_face_each_other_and_sides_of_a_wall_do_not() -> None:
    # Squares at heights 0, 1 and 2, normals up, down, up: a gap between the first two.
    square = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    points = np.concatenate([square + np.array([0, 0, height]) for height in range(3)])
    faces = np.array([[0, 1, 2], [3, 5, 4], [6, 7, 8]], dtype=np.int32)
    pairs = np.array([[0, 1], [1, 2], [0, 2]], dtype=np.int32)
    assert face_each_other(points, faces, pairs).tolist() == [True, False, False]
