"""Topology: masks and rings follow the edges, and links besides them."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from dtrepair.numerics.geometry import adjacency
from dtrepair.repair.surface.topology import Topology
from tests.meshes import icosphere, joined, torus


def test_dilation_and_rings_follow_the_edges() -> None:
    points, faces = torus(20, 8)
    mesh = Topology(faces, len(points))
    indptr, indices = adjacency(faces, len(points))
    seed = np.zeros(len(points), dtype=bool)
    seed[[0, 77]] = True
    expected = np.where(seed, 0, 6)
    reached = seed
    for ring in range(1, 6):
        wider = reached.copy()
        for v in np.flatnonzero(reached):
            wider[indices[indptr[v] : indptr[v + 1]]] = True
        expected[wider & ~reached] = ring
        assert np.array_equal(mesh.dilate(seed, ring), wider)
        reached = wider
    assert np.array_equal(mesh.rings_from(seed, 6), expected)
    nothing = np.zeros(len(points), dtype=bool)
    assert (mesh.rings_from(nothing, 4) == 4).all()
    assert np.array_equal(mesh.dilate(seed, 0), seed)


def test_masks_and_components() -> None:
    points, faces = joined(icosphere(1), icosphere(1))
    mesh = Topology(faces, len(points))
    half = len(points) // 2
    labels = mesh.components(np.ones(len(points), dtype=bool))
    assert len(np.unique(labels)) == 2 and (labels[:half] == labels[0]).all()
    alone = mesh.components(np.zeros(len(points), dtype=bool))
    assert len(np.unique(alone)) == len(points)
    mask = mesh.vertices_of(np.array([[0, 3]]))
    assert set(np.flatnonzero(mask)) == set(faces[[0, 3]].ravel())
    assert np.array_equal(mesh.triangles_at(mask), np.isin(faces, faces[[0, 3]]).any(axis=1))


def test_links_make_neighbours_of_vertices_that_share_no_edge() -> None:
    points, faces = joined(icosphere(1), icosphere(1))
    half, count = len(points) // 2, len(points)
    links = sparse.csr_matrix(([0.1, 0.1], ([0, half], [half, 0])), shape=(count, count))
    mesh, plain = Topology(faces, count, links=links), Topology(faces, count)
    seed = np.arange(count) == 0
    assert not plain.dilate(seed, count)[half:].any() and mesh.dilate(seed, count).all()
    assert mesh.rings_from(seed, 9)[half] == 1
    assert np.array_equal(mesh.edges, plain.edges)


def test_edges_within_a_mask_have_both_ends_there() -> None:
    points, faces = torus(20, 8)
    mesh = Topology(faces, len(points))
    mask = points[:, 0] > 0.3
    within = {tuple(edge) for edge in mesh.edges.tolist() if mask[edge].all()}
    assert 0 < len(within) < len(mesh.edges)
    assert {tuple(edge) for edge in mesh.edges_within(mask).tolist()} == within
