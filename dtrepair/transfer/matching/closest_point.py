"""Closest points of a surface whose normals agree with those of the queries."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import FloatArray, IntArray, triangle_normals
from dtrepair.transfer.gradients import degenerate_triangles


class ClosestSurface:
    """Closest points of a surface whose normals agree; built once per target."""

    def __init__(self, points: FloatArray, faces: IntArray, neighbors: int) -> None:
        """`neighbors` centroids are looked at for each query.

        Degenerate triangles, which have no normal, are left out; ValueError if there are no others.
        """
        if neighbors < 1:
            raise ValueError(f"neighbors should be at least 1, got {neighbors}")
        usable = faces[~degenerate_triangles(points, faces)]
        if not len(usable):
            raise ValueError("the target should have triangles with an area, got none")
        self._corners = points[usable]
        self._normals = triangle_normals(points, usable)
        self._tree = cKDTree(self._corners.mean(axis=1))
        self._neighbors = np.arange(1, min(neighbors, len(usable)) + 1)

    def __call__(
        self, points: FloatArray, normals: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return closest points (V, 3), and which vertices (V,) have a compatible one."""
        near = self._tree.query(points, self._neighbors)[1]
        facing = np.einsum("vnj,vj->vn", self._normals[near], normals) > 0
        vertex, slot = np.nonzero(facing)
        candidates = closest_on_triangles(points[vertex], self._corners[near[vertex, slot]])
        squared = np.full(near.shape, np.inf)
        squared[vertex, slot] = ((candidates - points[vertex]) ** 2).sum(axis=1)
        positions = np.zeros((*near.shape, 3))
        positions[vertex, slot] = candidates
        best = squared.argmin(axis=1)
        return positions[np.arange(len(points)), best], facing.any(axis=1)


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
