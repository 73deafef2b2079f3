"""Intersections by CGAL's exact predicates, the reference of the detector's tests."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray


def cgal_intersect(first: NDArray[np.float32], second: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Whether closed triangles (K, 3, 3) have a common point; without area they are less."""
    kernel = pytest.importorskip("CGAL.CGAL_Kernel")
    result = np.zeros(len(first), dtype=bool)
    low_first, high_first = first.min(axis=1), first.max(axis=1)
    low_second, high_second = second.min(axis=1), second.max(axis=1)
    near = ((low_first <= high_second) & (low_second <= high_first)).all(axis=1)
    for index in np.flatnonzero(near):
        a, b = (cgal_hull(kernel, own[index].tolist()) for own in (first, second))
        result[index] = kernel.do_intersect(a, b)
    return result


def cgal_hull(kernel: Any, corners: list[list[float]]) -> Any:
    """What three corners span: a triangle, a segment or a point."""
    points = [kernel.Point_3(*corner) for corner in corners]
    triangle = kernel.Triangle_3(*points)
    if not triangle.is_degenerate():
        return triangle
    # Of points on one line the least and the greatest are the ends, whatever comes first.
    order = sorted(range(3), key=corners.__getitem__)
    ends = [points[order[0]], points[order[2]]]
    return ends[0] if corners[order[0]] == corners[order[2]] else kernel.Segment_3(*ends)


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
