"""Edge rings between triangles: those of a plain search, whoever asks, in which order, and how."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.device import Device
from dtrepair.intersect.topology.device_mesh import DeviceMesh
from dtrepair.intersect.topology.ring_distances import (
    RingDistances,
    rings_at_once,
    rings_in_turn,
)
from dtrepair.numerics.geometry import adjacency
from tests.meshes import Mesh, icosphere, joined, torus, tube

LIMIT = 20


def distances(mesh: Mesh, limit: int = LIMIT) -> RingDistances:
    points, faces = mesh
    return RingDistances(DeviceMesh(faces, len(points), device=Device()), limit=limit)


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
    distance = distances(mesh)
    # In any order, and again: what is remembered must be the same.
    for _ in range(2):
        assert distance(pairs.astype(np.int32)).tolist() == expected
    backward = distance(pairs[::-1].astype(np.int32))
    assert backward.tolist() == expected[::-1]
    assert distance(np.zeros((0, 2), np.int32)).shape == (0,)
    assert max(expected) > 5


def test_threads_may_share_what_is_remembered() -> None:
    mesh = torus(24, 8)
    faces, random = mesh[1], np.random.default_rng(0)
    asked = [random.integers(0, len(faces), (200, 2)).astype(np.int32) for _ in range(40)]
    expected = [distances(mesh)(pairs) for pairs in asked]
    shared = distances(mesh)
    with ThreadPoolExecutor(4) as pool:
        for found, wanted in zip(pool.map(shared, asked), expected, strict=True):
            assert np.array_equal(found, wanted)


def rings_by_scipy(mesh: Mesh, pairs: NDArray[np.int32], limit: int) -> NDArray[np.int64]:
    """Edge rings of pairs (K, 2) from the shortest paths between all vertices."""
    points, faces = mesh
    indptr, indices = adjacency(faces, len(points))
    graph = sparse.csr_matrix((np.ones(len(indices)), indices, indptr), shape=(len(points),) * 2)
    paths = csgraph.shortest_path(graph, unweighted=True)
    between = paths[faces[pairs[:, 0]][:, :, None], faces[pairs[:, 1]][:, None, :]]
    rings: NDArray[np.int64] = np.minimum(between.min(axis=(1, 2)), limit + 1).astype(np.int64)
    return rings


MESHES = {
    "torus": torus(24, 8),
    "tube": tube(6, 40),
    "two spheres": joined(icosphere(1), icosphere(1)),
}


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(sorted(MESHES)),
    st.integers(0, 2**32 - 1),
    st.integers(1, 200),
    st.integers(1, 400),
    st.integers(0, LIMIT),
    st.sampled_from([1, 500, 1 << 20]),
)
def test_frontiers_find_the_rings_of_searches_in_turn(
    name: str, seed: int, firsts: int, count: int, limit: int, words: int
) -> None:
    """Of few and many first triangles, and with room for all at once or for 64."""
    points, faces = MESHES[name]
    random = np.random.default_rng(seed)
    first = random.integers(0, len(faces), firsts)[random.integers(0, firsts, count)]
    pairs = np.stack([first, random.integers(0, len(faces), count)], axis=1).astype(np.int32)
    pairs = np.unique(pairs, axis=0)
    on_device = DeviceMesh(faces, len(points), device=Device())
    expected = rings_by_scipy((points, faces), pairs, limit)
    assert np.array_equal(rings_in_turn(on_device, pairs, limit), expected)
    assert np.array_equal(rings_at_once(on_device, pairs, limit, words=words), expected)


def test_no_pairs_need_no_search() -> None:
    points, faces = MESHES["torus"]
    on_device = DeviceMesh(faces, len(points), device=Device())
    none = np.zeros((0, 2), dtype=np.int32)
    assert rings_at_once(on_device, none, LIMIT).shape == (0,)
    assert rings_in_turn(on_device, none, LIMIT).shape == (0,)


def test_a_device_of_many_threads_searches_by_frontiers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    points, faces = MESHES["torus"]
    device = Device()
    device.serial = False
    distance = RingDistances(DeviceMesh(faces, len(points), device=device))
    launched: list[str] = []
    launch = device.launch

    def watched(kernel: Any, dim: int | tuple[int, ...], inputs: Sequence[Any]) -> None:
        launched.append(kernel.key)
        launch(kernel, dim, inputs)

    monkeypatch.setattr(device, "launch", watched)
    pairs = np.array([[0, 100], [3, 200]], dtype=np.int32)
    assert np.array_equal(distance(pairs), distances(MESHES["torus"])(pairs))
    assert "grow_frontiers" in launched and "ring_distances" not in launched
