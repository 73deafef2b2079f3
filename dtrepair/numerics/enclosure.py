"""How far a surface encloses a point, with a border or without."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    closed_parts,
    components,
    cross,
    dots,
    extent,
    lengths,
    weld_map,
)

# Distances of points from dipoles that are held at a time.
BLOCK = 200_000


class Dipoles:
    """Triangles (F, 3, 3), not none, as one dipole for each of the cells that hold any.

    cells: along the largest extent.
    """

    def __init__(self, corners: FloatArray, cells: int) -> None:
        areas = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2.0
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
        self._corners, self._order = corners, np.argsort(label, kind="stable")
        self._starts = np.searchsorted(label[self._order], np.arange(len(total) + 1))
        self._radius = np.full(len(total), self._size)
        reach = np.linalg.norm(corners - self._centres[label][:, None], axis=2).max(axis=1)
        np.maximum.at(self._radius, label, reach)

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

    def enclose_closely(self, points: FloatArray, near: float = 3.0) -> FloatArray:
        """Return how often the triangles go round points (P, 3): winding numbers (P,).

        Triangles of cells nearer than so many times the size of these, or of what they hold, count
        as themselves: close to a surface its dipoles may be off by more than a half.
        """
        result, rows = self.enclose(points), max(1, BLOCK // 1000)
        for first in range(0, len(points), rows):
            own = points[first : first + rows]
            found = cKDTree(own).query_ball_point(self._centres, near * self._radius)
            cell = np.repeat(np.arange(len(found)), list(map(len, found)))
            point = np.concatenate([np.zeros(0, dtype=np.intp), *map(np.asarray, found)])
            point = point.astype(np.intp)
            away = self._centres[cell] - own[point]
            far = np.maximum(lengths(away), 0.5 * self._size)
            change = -dots(away, self._areas[cell]) / far**3
            counts = self._starts[cell + 1] - self._starts[cell]
            begins = np.repeat(self._starts[cell] - (np.cumsum(counts) - counts), counts)
            triangle = self._order[begins + np.arange(int(counts.sum()))]
            of_triangle = np.repeat(point, counts)
            angles = solid_angles(own[of_triangle], self._corners[triangle])
            total = np.bincount(point, change, len(own))
            total += np.bincount(of_triangle, angles, len(own))
            result[first : first + len(own)] += total / (4.0 * np.pi)
        return result


def solid_angles(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Return the solid angle (N,) of a triangle each (N, 3, 3), seen from points (N, 3).

    It is positive from behind (Van Oosterom and Strackee 1983).
    """
    a, b, c = (corners[:, k] - points for k in range(3))
    long_a, long_b, long_c = lengths(a), lengths(b), lengths(c)
    volume = dots(a, cross(b, c))
    beside = dots(b, c) * long_a + dots(c, a) * long_b + dots(a, b) * long_c
    angle: FloatArray = 2.0 * np.arctan2(volume, long_a * long_b * long_c + beside)
    return angle


def enclosure(points: FloatArray, corners: FloatArray, cells: int = 12) -> FloatArray:
    """Return about how often triangles (F, 3, 3) go round points (P, 3): winding numbers.

    Of surfaces with a border they are no whole numbers (Jacobson et al. 2013). Triangles in one of
    so many cells along the largest extent count as one dipole (Barill et al. 2018).
    """
    return Dipoles(corners, cells).enclose(points)


def facing_away(points: FloatArray, faces: IntArray, seen_from: FloatArray) -> NDArray[np.bool_]:
    """Return which triangles (F,) of open parts face away from other points (N, 3).

    A part does whose winding numbers there are positive, of three in four by what it is seen under:
    what is seen from both sides faces either.
    """
    welded = weld_map(points)[faces]
    label = components(welded, len(points))[welded[:, 0]]
    _, part = np.unique(label, return_inverse=True)
    part = part.reshape(-1)
    count = int(part.max(initial=-1)) + 1
    behind, seen = np.zeros((2, count))
    for place in seen_from:
        angles = solid_angles(np.broadcast_to(place, (len(faces), 3)), points[faces])
        winding = np.bincount(part, angles, count)
        behind += winding
        seen += np.abs(winding)
    away = (behind > 0.5 * seen) & ~closed_parts(welded, part, count)
    return np.asarray(away[part])


def turned_over(faces: IntArray, turned: NDArray[np.bool_]) -> IntArray:
    """Return triangles (F, 3), some of them (F,) turned over."""
    return np.where(turned[:, None], faces[:, [0, 2, 1]], faces).astype(np.int32)
