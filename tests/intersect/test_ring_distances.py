"""Edge rings between triangles: those of a plain search, whoever asks, and in which order."""

from __future__ import annotations

from collections import deque
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.intersect.queries import RingDistances
from dtrepair.numerics.geometry import adjacency
from tests.meshes import Mesh, icosphere, joined, torus, tube

LIMIT = 20


def slow_rings(faces: NDArray[np.int32], count: int, first: int) -> NDArray[np.int64]:
    """Edge rings of every vertex from a triangle; far beyond the limit where unreachable."""
    indptr, indices = adjacency(faces, count)
    rings = np.full(count, 10 * LIMIT)
    rings[faces[first]] = 0
    queue = deque(faces[first].tolist())
    while queue:
        v = queue.popleft()
        for w in indices[indptr[v] : indptr[v + 1]].tolist():
            if rings[w] > rings[v] + 1:
                rings[w] = rings[v] + 1
                queue.append(w)
    return rings


@pytest.mark.parametrize("mesh", [torus(24, 8), tube(6, 40), joined(icosphere(1), icosphere(1))])
def test_ring_distances_are_those_of_a_plain_search(mesh: Mesh) -> None:
    points, faces = mesh
    random = np.random.default_rng(0)
    firsts = random.choice(len(faces), 12, replace=False)
    pairs = np.array([(i, j) for i in firsts for j in random.integers(0, len(faces), 40)])
    rings = {i: slow_rings(faces, len(points), i) for i in firsts.tolist()}
    expected = [min(int(rings[i][faces[j]].min()), LIMIT + 1) for i, j in pairs.tolist()]
    distance = RingDistances(faces, len(points), limit=LIMIT)
    # In any order, and again: what is remembered must be the same.
    for _ in range(2):
        assert distance(pairs.astype(np.int32)).tolist() == expected
    backward = distance(pairs[::-1].astype(np.int32))
    assert backward.tolist() == expected[::-1]
    assert distance(np.zeros((0, 2), np.int32)).shape == (0,)
    assert max(expected) > 5


def test_threads_may_share_what_is_remembered() -> None:
    points, faces = torus(24, 8)
    random = np.random.default_rng(0)
    asked = [random.integers(0, len(faces), (200, 2)).astype(np.int32) for _ in range(40)]
    expected = [RingDistances(faces, len(points))(pairs) for pairs in asked]
    shared = RingDistances(faces, len(points))
    with ThreadPoolExecutor(4) as pool:
        for found, wanted in zip(pool.map(shared, asked), expected, strict=True):
            assert np.array_equal(found, wanted)
