"""Seams: where a skin is cut, within a mesh or into several, and its borders lie on each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import FloatArray, IntArray, border_edges, diagonal, lengths

# Vertices of a seam are at one place up to this part of the diagonal: what float32 may round.
WITHIN = 1e-6


def find_seams(
    points: FloatArray, faces: IntArray, owner: NDArray[np.integer], *, within: float = WITHIN
) -> IntArray:
    """Return pairs (N, 2) of vertices at one place of borders that continue each other.

    Each edge of such a border lies on one of another, which runs the other way: a skin goes on
    there. Shells that lie on each other end at one place too, but run the same way. A mesh that
    lies with every vertex on others has no seams with them: nothing of it would be left.

    Args:
        points: Positions (V, 3).
        faces: Triangles (F, 3), whose vertices at one position of a mesh are one.
        owner: The mesh (V,) of each vertex.
        within: What counts as one place, part of the diagonal.
    """
    edges = faces.ravel()[border_edges(faces, len(points))]
    border = np.unique(edges)
    if len(border) == 0:
        return np.zeros((0, 2), dtype=np.int32)
    near = cKDTree(points[border]).query_pairs(within * diagonal(points), output_type="ndarray")
    first, second = _facing_edges(_labels(border[near.reshape(-1, 2)], len(points))[edges])
    ends = np.concatenate([edges[first], edges[second][:, ::-1]], axis=1).reshape(-1, 2, 2)
    pairs = np.unique(np.sort(ends.transpose(0, 2, 1).reshape(-1, 2), axis=1), axis=0)
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    across = owner[pairs[:, 0]] != owner[pairs[:, 1]]
    inner = np.setdiff1d(faces, pairs[across])
    left = np.isin(owner[pairs], owner[inner]).all(axis=1)
    return np.asarray(pairs[left | ~across], dtype=np.int32)


def _facing_edges(edges: IntArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the numbers (N,), (N,) of directed edges (E, 2) that run against each other.

    Only where there are no others at their place: else nobody knows which go together.
    """
    there = edges.astype(np.int64) @ [int(edges.max()) + 1, 1]
    back = edges[:, ::-1].astype(np.int64) @ [int(edges.max()) + 1, 1]
    keys, place, uses = np.unique(there, return_index=True, return_counts=True)
    found = np.minimum(np.searchsorted(keys, back), len(keys) - 1)
    alone = uses[np.searchsorted(keys, there)] == 1
    first = np.flatnonzero((keys[found] == back) & (uses[found] == 1) & alone)
    return first, place[found[first]]


def _labels(pairs: NDArray[np.integer], count: int) -> IntArray:
    """Return the least vertex (count,) that each is joined to by pairs (N, 2)."""
    graph = sparse.coo_matrix((np.ones(len(pairs)), tuple(pairs.T)), shape=(count, count))
    label = csgraph.connected_components(graph, directed=False)[1]
    first = np.full(int(label.max(initial=-1)) + 1, count, dtype=np.int32)
    np.minimum.at(first, label, np.arange(count, dtype=np.int32))
    return np.asarray(first[label])


def sewn(
    weld: IntArray, seams: IntArray, points: FloatArray, *, within: float = WITHIN
) -> IntArray:
    """Return the vertex (V,) that stands for each where seams that are closed are one.

    Args:
        weld: The vertex (V,) that stands for each within its own mesh.
        seams: Pairs (N, 2) of vertices, as of `find_seams`.
        points: A pose (V, 3), in which some may be open.
        within: What counts as one place, part of the diagonal.
    """
    if len(seams) == 0:
        return weld
    apart = lengths(points[seams[:, 0]] - points[seams[:, 1]])
    joined = seams[apart <= within * diagonal(points)]
    return np.asarray(_labels(weld[joined], len(weld))[weld])
