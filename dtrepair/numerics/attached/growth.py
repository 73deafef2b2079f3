"""Grows sets of vertices over the surface that they lie on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.geometry import FloatArray, dots

BoolArray = NDArray[np.bool_]


def grown(
    graph: sparse.csr_matrix,
    points: FloatArray,
    seeds: BoolArray,
    reach: float,
    least: FloatArray | None = None,
) -> BoolArray:
    """Return the seeds (V,) and what is within the reach of each of their clusters.

    Args:
        graph: Lengths of edges (V, V).
        points: Positions (V, 3).
        seeds: Which vertices (V,) to begin with.
        reach: Geodesic growth, in rms sizes of a cluster.
        least: Of a cluster by the mean of these lengths (V,) at least.
    """
    zone = seeds.copy()
    inner = np.flatnonzero(seeds)
    label = csgraph.connected_components(graph[inner][:, inner], directed=False)[1]
    for cluster in range(label.max(initial=-1) + 1):
        own = inner[label == cluster]
        centred = points[own] - points[own].mean(axis=0)
        limit = reach * float(np.sqrt(dots(centred, centred).mean()))
        if least is not None:
            limit = max(limit, float(least[own].mean()))
        zone |= within(graph, own, limit)
    return zone


def ringed(graph: sparse.csr_matrix, seeds: BoolArray, rings: int) -> BoolArray:
    """Return the seeds (V,) and what is within so many edges of them."""
    zone = seeds.copy()
    for _ in range(rings):
        zone[graph[np.flatnonzero(zone)].indices] = True
    return zone


def within(graph: sparse.csr_matrix, seeds: NDArray[np.integer], limit: float) -> BoolArray:
    """Return the vertices (V,) that are no farther from seeds (N,) than a limit, along edges."""
    distance = csgraph.dijkstra(graph, indices=seeds, min_only=True, limit=limit)
    return np.asarray(np.isfinite(distance))
