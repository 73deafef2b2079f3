"""Closest points of triangles, and where on a triangle a point lies."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import FloatArray, IntArray, cross

# Triangles that are looked at for a point: those whose centroids are nearest.
NEIGHBORS = 12


class NearestTriangles:
    """Triangles (F, 3, 3), F at least 1, in a tree of their centroids."""

    def __init__(self, corners: FloatArray) -> None:
        self.corners, self._tree = corners, cKDTree(corners.mean(axis=1))

    def nearest(
        self, points: FloatArray, *, neighbors: int = NEIGHBORS
    ) -> tuple[IntArray, FloatArray]:
        """Return the triangle (Q,) nearest to each point (Q, 3), and the place on it (Q, 3).

        Exact among the `neighbors` triangles whose centroids are nearest.
        """
        corners = self.corners
        near = self._tree.query(points, np.arange(1, min(neighbors, len(corners)) + 1))[1]
        queries = np.repeat(points, near.shape[1], axis=0)
        closest = closest_on_triangles(queries, corners[near.ravel()]).reshape(*near.shape, 3)
        best = ((closest - points[:, None]) ** 2).sum(axis=2).argmin(axis=1)
        rows = np.arange(len(points))
        return near[rows, best].astype(np.int32), closest[rows, best]


def nearest_triangles(
    points: FloatArray, corners: FloatArray, *, neighbors: int = NEIGHBORS
) -> tuple[IntArray, FloatArray]:
    """Return the triangle (Q,) nearest to each point (Q, 3), of corners (F, 3, 3), and the place.

    Exact among the `neighbors` triangles whose centroids are nearest. The closest points (Q, 3) are
    in the length unit of the points. F is at least 1.
    """
    return NearestTriangles(corners).nearest(points, neighbors=neighbors)


def barycentric(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Return barycentric weights (K, 3) of points (K, 3) in the triangles (K, 3, 3) they lie on.

    Weights are at least 0 and sum to 1; a triangle without area gives its nearest corner.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = cross(b - a, c - a)
    squared = _dots(normal, normal)
    flat = squared <= 0.0
    squared = np.where(flat, 1.0, squared)
    weights = np.stack(
        [
            _dots(cross(second - first, points - first), normal) / squared
            for first, second in ((b, c), (c, a), (a, b))
        ],
        axis=1,
    )
    nearest = ((corners - points[:, None]) ** 2).sum(axis=2).argmin(axis=1)
    weights[flat] = np.eye(3)[nearest[flat]]
    weights = np.clip(weights, 0.0, 1.0)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True), dtype=np.float64)


def closest_on_triangles(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Return the closest point (K, 3) of triangle k, corners (K, 3, 3), to point k (K, 3).

    The projection where it falls inside, else the closest point of the three edges.
    """
    a, edge_b, edge_c = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    bb, bc, cc = (_dots(u, v) for u, v in ((edge_b, edge_b), (edge_b, edge_c), (edge_c, edge_c)))
    offset = points - a
    pb, pc = _dots(offset, edge_b), _dots(offset, edge_c)
    determinant = bb * cc - bc * bc
    # A triangle without area has no projection; its edges hold its closest point.
    flat = determinant <= 1e-12 * bb * cc
    determinant = np.where(flat, 1.0, determinant)
    s, t = (cc * pb - bc * pc) / determinant, (bb * pc - bc * pb) / determinant
    inside = (s >= 0) & (t >= 0) & (s + t <= 1) & ~flat
    best = a + s[:, None] * edge_b + t[:, None] * edge_c
    distance = np.where(inside, 0.0, np.inf)
    for start in range(3):
        origin, edge = corners[:, start], corners[:, (start + 1) % 3] - corners[:, start]
        length = np.maximum(_dots(edge, edge), np.finfo(float).tiny)
        along = np.clip(_dots(points - origin, edge) / length, 0.0, 1.0)
        candidate = origin + along[:, None] * edge
        squared = _dots(candidate - points, candidate - points)
        closer = squared < distance
        best = np.where(closer[:, None], candidate, best)
        distance = np.where(closer, squared, distance)
    return best


def _dots(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the scalar products (K,) of vectors (K, 3)."""
    products: FloatArray = np.einsum("kj,kj->k", first, second)
    return products
