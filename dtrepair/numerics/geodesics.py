"""Distances along a surface between the triangles of intersecting pairs."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    components,
    extent,
    lengths,
    shared_edges,
    unique_edges,
)


def surface_graph(points: FloatArray, faces: IntArray) -> sparse.csr_matrix:
    """Return the lengths (V, V) of edges, and of the diagonals across two unfolded triangles.

    Paths in it are a little longer than geodesics: with the diagonals, by some per cent at most. A
    diagonal that would leave its two triangles is left out.
    """
    edges = unique_edges(faces)
    both = shared_edges(faces)
    first, second = faces[both[:, 0]], faces[both[:, 1]]
    # The corner of each triangle that the other one does not have.
    opposite = [
        own[np.arange(len(own)), (own[:, :, None] != other[:, None]).all(axis=2).argmax(axis=1)]
        for own, other in ((first, second), (second, first))
    ]
    common = (first[:, :, None] == second[:, None]).any(axis=2)
    proper = common.sum(axis=1) == 2
    hinge = first[proper][common[proper]].reshape(-1, 2)
    tips = [corner[proper] for corner in opposite]
    a, b = points[hinge[:, 0]], points[hinge[:, 1]]
    base = lengths(b - a)
    sides = [_in_plane(points[tip] - a, b - a, base) for tip in tips]
    rise = sides[0][1] + sides[1][1]
    crossing = sides[0][0] + (sides[1][0] - sides[0][0]) * np.divide(
        sides[0][1], rise, out=np.zeros_like(rise), where=rise > 0
    )
    inside = (crossing > 0) & (crossing < base)
    across = np.hypot(sides[1][0] - sides[0][0], rise)[inside]
    rows = np.concatenate([edges[:, 0], tips[0][inside]])
    columns = np.concatenate([edges[:, 1], tips[1][inside]])
    values = np.concatenate([lengths(points[edges[:, 1]] - points[edges[:, 0]]), across])
    # Edges of no length would be none to the graph search.
    values = np.maximum(values, np.finfo(np.float64).tiny)
    keep = np.unique(np.sort(np.stack([rows, columns]), axis=0), axis=1, return_index=True)[1]
    graph = sparse.coo_matrix(
        (values[keep], (rows[keep], columns[keep])), shape=(len(points), len(points))
    )
    return graph.tocsr()


def largest_geodesic(points: FloatArray, faces: IntArray, pairs: IntArray) -> float:
    """Return the largest distance along the surface between two triangles of a pair, no unit.

    Of a mesh (V, 3), (F, 3) scaled to a largest coordinate range of 1, over intersecting pairs
    (K, 2): the measure MGD of Jang et al. 2025, where near ones are creases. Pairs of different
    connected parts have no such distance and are left out; 0 where no others are. Two triangles are
    as far apart as their nearest corners. Most pairs need no search of their own: the triangle
    inequality with one that was made bounds them.
    """
    part = components(faces, len(points))[faces[:, 0]]
    pairs = pairs[part[pairs[:, 0]] == part[pairs[:, 1]]]
    if not len(pairs):
        return 0.0
    graph = surface_graph(points, faces)
    corners = points[faces]
    size = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    largest, bound = 0.0, np.full(len(pairs), np.inf)
    while bound.max() > largest:
        chosen = int(bound.argmax())
        source = pairs[chosen, 0]
        distance = csgraph.dijkstra(
            graph, directed=False, indices=faces[source].astype(np.int64), min_only=True
        )
        away = distance[faces].min(axis=1)[pairs]
        bound = np.minimum(bound, away.sum(axis=1) + size[source])
        own = (pairs == source).any(axis=1)
        largest = max(largest, float(away[own].sum(axis=1).max()))
        bound[own] = 0.0
    return largest / (extent(points) or 1.0)


def _in_plane(
    tip: FloatArray, base: FloatArray, length: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return how far along the base, and how far from it, tips (K, 3) lie."""
    along = np.einsum("ij,ij->i", tip, base) / np.maximum(length, np.finfo(np.float64).tiny)
    return along, np.sqrt(np.maximum(np.einsum("ij,ij->i", tip, tip) - along**2, 0.0))
