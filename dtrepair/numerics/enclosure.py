"""How far a surface with a border encloses a point."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.geometry import FloatArray, extent, lengths


def enclosure(points: FloatArray, corners: FloatArray, cells: int = 12) -> FloatArray:
    """Return about how often triangles (F, 3, 3) go round points (P, 3): winding numbers.

    Of surfaces with a border they are no whole numbers (Jacobson et al. 2013). Triangles in one of
    so many cells along the largest extent count as one dipole (Barill et al. 2018).
    """
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2.0
    centres, weights = corners.mean(axis=1), lengths(areas)
    size = extent(corners.reshape(-1, 3)) / cells
    place = np.floor((centres - centres.min(axis=0)) / size).astype(np.int64)
    label = np.unique(place, axis=0, return_inverse=True)[1].reshape(-1)

    def summed(values: FloatArray) -> FloatArray:
        return np.stack([np.bincount(label, values[:, k]) for k in range(3)], axis=1)

    total = np.maximum(np.bincount(label, weights), np.finfo(float).tiny)
    centres, areas = summed(centres * weights[:, None]) / total[:, None], summed(areas)
    result = np.zeros(len(points))
    for centre, area in zip(centres, areas, strict=True):
        away = centre - points
        result += away @ area / np.maximum(lengths(away), 0.5 * size) ** 3
    return result / (4.0 * np.pi)
