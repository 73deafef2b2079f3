"""Intersections by CGAL's exact predicates, the reference of the detector's tests."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray


def cgal_intersect(first: NDArray[np.float32], second: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Whether closed triangles (K, 3, 3) have a common point; zero-area triangles meet nothing."""
    kernel = pytest.importorskip("CGAL.CGAL_Kernel")

    def triangle(corners: list[list[float]]) -> Any:
        return kernel.Triangle_3(*(kernel.Point_3(*corner) for corner in corners))

    result = np.zeros(len(first), dtype=bool)
    low_first, high_first = first.min(axis=1), first.max(axis=1)
    low_second, high_second = second.min(axis=1), second.max(axis=1)
    near = ((low_first <= high_second) & (low_second <= high_first)).all(axis=1)
    for index in np.flatnonzero(near):
        a, b = triangle(first[index].tolist()), triangle(second[index].tolist())
        if not (a.is_degenerate() or b.is_degenerate()):
            result[index] = kernel.do_intersect(a, b)
    return result


def cgal_pairs(
    points: NDArray[np.float64], faces: NDArray[np.int32], weld: NDArray[np.int32] | None = None
) -> NDArray[np.int32]:
    """All intersecting pairs (K, 2) that share no (welded) vertex, sorted: tests every pair."""
    i, j = np.triu_indices(len(faces), 1)
    welded = faces if weld is None else weld[faces]
    share = (welded[i][:, :, None] == welded[j][:, None, :]).any(axis=(1, 2))
    i, j = i[~share], j[~share]
    corners = points.astype(np.float32)[faces]
    hit = cgal_intersect(corners[i], corners[j])
    return np.stack([i[hit], j[hit]], axis=1).astype(np.int32)
