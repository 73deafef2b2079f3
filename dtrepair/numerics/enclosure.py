"""How far a surface with a border encloses a point."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.geometry import FloatArray, extent, lengths

# Distances of points from dipoles that are held at a time.
BLOCK = 200_000


class Dipoles:
    """Triangles (F, 3, 3), not none, as one dipole for each of the cells that hold any.

    cells: along the largest extent.
    """

    def __init__(self, corners: FloatArray, cells: int) -> None:
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2.0
        centres, weights = corners.mean(axis=1), lengths(areas)
        self._size = extent(corners.reshape(-1, 3)) / cells
        place = np.floor((centres - centres.min(axis=0)) / self._size).astype(np.int64)
        keys = (place[:, 0] * (cells + 1) + place[:, 1]) * (cells + 1) + place[:, 2]
        label = np.unique(keys, return_inverse=True)[1].reshape(-1)

        def summed(values: FloatArray) -> FloatArray:
            return np.stack([np.bincount(label, values[:, k]) for k in range(3)], axis=1)

        total = np.maximum(np.bincount(label, weights), np.finfo(float).tiny)
        self._centres = summed(centres * weights[:, None]) / total[:, None]
        self._areas = summed(areas)

    def enclose(self, points: FloatArray) -> FloatArray:
        """Return about how often the triangles go round points (P, 3): winding numbers (P,)."""
        result = np.zeros(len(points))
        rows = max(1, BLOCK // len(self._centres))
        for first in range(0, len(points), rows):
            away = self._centres - points[first : first + rows, None]
            far = np.maximum(np.sqrt(np.einsum("pck,pck->pc", away, away)), 0.5 * self._size)
            flux = np.einsum("pck,ck->pc", away, self._areas)
            result[first : first + rows] = (flux / far**3).sum(axis=1)
        return result / (4.0 * np.pi)


def enclosure(points: FloatArray, corners: FloatArray, cells: int = 12) -> FloatArray:
    """Return about how often triangles (F, 3, 3) go round points (P, 3): winding numbers.

    Of surfaces with a border they are no whole numbers (Jacobson et al. 2013). Triangles in one of
    so many cells along the largest extent count as one dipole (Barill et al. 2018).
    """
    return Dipoles(corners, cells).enclose(points)
