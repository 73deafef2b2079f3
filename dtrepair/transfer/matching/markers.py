"""Marker pairs and their checks."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.geometry import IntArray
from dtrepair.transfer.arrays import Array, to_numpy


def checked_markers(markers: Array, source_count: int, target_count: int) -> IntArray:
    """Return markers (K, 2) int32 of (source vertex, target vertex).

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
