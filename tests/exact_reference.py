"""Intersecting pairs by testing every pair of triangles in integers: slow, and nothing to miss."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dtrepair import RepairResult
from tests.integer_arithmetic import integer_intersect


def exact_pairs(points: ArrayLike, faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Pairs (K, 2), i < j, sorted, of a pose (V, 3) as float32.

    Pairs with a common corner, by index or by position, do not count.
    """
    rounded = np.asarray(points, dtype=np.float32) + np.float32(0.0)
    corners = rounded[faces]
    low, high = corners.min(axis=1), corners.max(axis=1)
    i, j = np.triu_indices(len(faces), 1)
    for axis in range(3):
        near = (low[i, axis] <= high[j, axis]) & (low[j, axis] <= high[i, axis])
        i, j = i[near], j[near]
    same = (corners[i][:, :, None] == corners[j][:, None, :]).all(axis=3).any(axis=(1, 2))
    i, j = i[~same], j[~same]
    hit = integer_intersect(corners[i], corners[j])
    return np.stack([i[hit], j[hit]], axis=1).astype(np.int32)


def check_counts(result: RepairResult, pose: Any, faces: NDArray[np.int32]) -> None:
    """Counts of a result are those of an independent count in integers."""
    for points, count in ((pose, result.before), (result.points, result.after)):
        pairs = exact_pairs(points, faces)
        assert (len(np.unique(pairs)), len(pairs)) == (count.triangles, count.pairs)
