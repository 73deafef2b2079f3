"""Marker pairs: their checks, and the similarity they define."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtrepair.geometry import FloatArray, IntArray
from dtrepair.transfer.arrays import Array, to_numpy


@dataclass(frozen=True)
class Similarity:
    """x -> scale * rotation @ x + translation; scale is target units per source unit."""

    scale: float
    rotation: FloatArray  # (3, 3)
    translation: FloatArray  # (3,)

    def __call__(self, points: FloatArray) -> FloatArray:
        """Points (V, 3) moved."""
        return self.scale * points @ self.rotation.T + self.translation

    @property
    def angle(self) -> float:
        """Angle of the rotation in degrees, 0 to 180."""
        return float(np.degrees(np.arccos(np.clip((np.trace(self.rotation) - 1) / 2, -1, 1))))


def similarity(source: FloatArray, target: FloatArray) -> Similarity:
    """Least-squares similarity that takes points (K, 3) to points (K, 3) (Umeyama 1991).

    Raises ValueError for fewer than three points, and for points on a line.
    """
    if len(source) < 3:
        raise ValueError(f"an alignment needs at least 3 markers, got {len(source)}: add markers")
    centres = source.mean(axis=0), target.mean(axis=0)
    first, second = source - centres[0], target - centres[1]
    for name, points in (("source", first), ("target", second)):
        spread = np.linalg.svd(points, compute_uv=False)
        if not spread[1] > 1e-6 * spread[0]:
            raise ValueError(
                f"the {name} markers lie on a line, which leaves the rotation open: "
                "add markers away from it"
            )
    left, sizes, right = np.linalg.svd(second.T @ first)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = (left * signs) @ right
    scale = float((sizes * signs).sum() / (first**2).sum())
    return Similarity(scale, rotation, centres[1] - scale * rotation @ centres[0])


def checked_markers(markers: Array, source_count: int, target_count: int) -> IntArray:
    """Markers (K, 2) int32 of (source vertex, target vertex).

    Raises ValueError for a wrong shape, indices out of range, and a vertex that occurs twice: a
    second marker at a vertex would move the result far without a sign of it.
    """
    rows = to_numpy(markers)
    if rows.ndim != 2 or rows.shape[1] != 2:
        raise ValueError(f"markers should have shape (K, 2), got {rows.shape}")
    if not np.issubdtype(rows.dtype, np.integer):
        raise ValueError(f"markers should be integers, got {rows.dtype}")
    for column, (name, count) in enumerate((("source", source_count), ("target", target_count))):
        values = rows[:, column]
        outside = np.flatnonzero((values < 0) | (values >= count))
        if len(outside):
            raise ValueError(
                f"markers should hold {name} vertices 0..{count - 1}, got index "
                f"{values[outside[0]]} in marker {outside[0]}: "
                "do markers and meshes belong together?"
            )
        vertices, occurrences = np.unique(values, return_counts=True)
        if (occurrences > 1).any():
            vertex = vertices[occurrences > 1][0]
            where = " and ".join(map(str, np.flatnonzero(values == vertex)[:2]))
            raise ValueError(
                f"each {name} vertex should have one marker, got vertex {vertex} in markers "
                f"{where}: remove one"
            )
    return rows.astype(np.int32)
