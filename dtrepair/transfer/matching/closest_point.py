"""Closest points of a surface whose normals agree with those of the queries."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dtrepair.numerics.closest_point import closest_on_triangles
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
