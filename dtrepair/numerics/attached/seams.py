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
    """Return pairs (N, 2) of vertices on borders that lie at one place.

    A mesh that lies with every vertex on other ones has none with them: nothing of it would be
    left.

    Args:
        points: Positions (V, 3).
        faces: Triangles (F, 3), whose vertices at one position of a mesh are one.
        owner: The mesh (V,) of each vertex.
        within: What counts as one place, part of the diagonal.
    """
    border = np.unique(faces.ravel()[border_edges(faces, len(points))])
    if len(border) == 0:
        return np.zeros((0, 2), dtype=np.int32)
    near = cKDTree(points[border]).query_pairs(within * diagonal(points), output_type="ndarray")
    pairs = np.sort(border[near.reshape(-1, 2)], axis=1)
    across = owner[pairs[:, 0]] != owner[pairs[:, 1]]
    inner = np.setdiff1d(faces, pairs[across])
    left = np.isin(owner[pairs], owner[inner]).all(axis=1)
    return np.asarray(pairs[left | ~across], dtype=np.int32)


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
    ends = weld[seams[apart <= within * diagonal(points)]]
    shape = (len(weld), len(weld))
    graph = sparse.coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=shape)
    label = csgraph.connected_components(graph, directed=False)[1]
    first = np.full(int(label.max(initial=-1)) + 1, len(weld), dtype=np.int32)
    np.minimum.at(first, label, np.arange(len(weld), dtype=np.int32))
    return np.asarray(first[label][weld])
