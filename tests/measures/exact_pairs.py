"""Exact intersecting pairs of triangles: boxes, then certified planes, then CGAL's predicates."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.cgal_reference import cgal_hull
from tests.measures.surfaces import Floats, Ints, Mask

# Shewchuk 1997: a 3 x 3 determinant of differences has the sign that floating-point arithmetic
# gives it where it is larger than this many times the sum of its terms' absolute values.
SIGN_BOUND = (7.0 + 56.0 * 2.0**-53) * 2.0**-53
BOXES = 4_000_000  # pairs of boxes that are compared together


def intersecting_pairs(
    points: NDArray[Any], faces: Ints, vertex_of: Ints, owner: Ints | None = None
) -> Ints:
    """Pairs (K, 2) of triangles with a common point that share no vertex, sorted.

    Points (V, 3) are rounded to float32. Two corners are one vertex where `vertex_of` (V,) says so
    or where those of one owner (V,) are at one position. Without area a triangle is less.
    """
    single = points.astype(np.float32) + np.float32(0.0)
    keys = np.column_stack([single, np.zeros(len(single)) if owner is None else owner])
    place = np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)
    corners = single.astype(np.float64)[faces]
    pairs = _box_pairs(corners)
    for name in (vertex_of[faces], place[faces]):
        share = (name[pairs[:, 0]][:, :, None] == name[pairs[:, 1]][:, None, :]).any(axis=(1, 2))
        pairs = pairs[~share]
    for one, other in ((0, 1), (1, 0)):
        pairs = pairs[~_beside(corners[pairs[:, one]], corners[pairs[:, other]])]
    pairs = pairs[_by_cgal(corners, pairs)]
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def _box_pairs(corners: Floats) -> Ints:
    """Pairs (K, 2), first < second, whose axis-parallel boxes meet."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    axis = int(np.argmax(np.ptp(corners.reshape(-1, 3), axis=0)))
    order = np.argsort(low[:, axis], kind="stable")
    low, high = low[order], high[order]
    position = np.arange(len(order))
    count = np.searchsorted(low[:, axis], high[:, axis], side="right") - position - 1
    others = [k for k in range(3) if k != axis]
    found = [np.zeros((0, 2), dtype=np.int64)]
    for rows in np.split(position, np.flatnonzero(np.diff(np.cumsum(count) // BOXES)) + 1):
        first = np.repeat(rows, count[rows])
        start = np.repeat(np.cumsum(count[rows]) - count[rows], count[rows])
        second = first + 1 + np.arange(len(first)) - start
        for k in others:
            meet = (low[first, k] <= high[second, k]) & (low[second, k] <= high[first, k])
            first, second = first[meet], second[meet]
        found.append(np.sort(np.stack([order[first], order[second]], axis=1), axis=1))
    return np.concatenate(found)


def _beside(first: Floats, second: Floats) -> Mask:
    """Whether the second triangles (K, 3, 3) lie wholly on one side of the planes of the first."""
    a, b, c = (first[:, k] for k in range(3))
    u, v = b - a, c - a
    above, below = np.ones(len(first), dtype=bool), np.ones(len(first), dtype=bool)
    for k in range(3):
        w = second[:, k] - a
        value, size = np.zeros(len(first)), np.zeros(len(first))
        for x, y, z in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            value += w[:, x] * (u[:, y] * v[:, z] - u[:, z] * v[:, y])
            size += np.abs(w[:, x]) * (np.abs(u[:, y] * v[:, z]) + np.abs(u[:, z] * v[:, y]))
        above &= value > SIGN_BOUND * size
        below &= value < -SIGN_BOUND * size
    return np.asarray(above | below)


def _by_cgal(corners: Floats, pairs: Ints) -> Mask:
    """Whether the triangles of each pair have a common point. Raises ImportError without CGAL."""
    try:
        from CGAL import CGAL_Kernel as kernel
    except ImportError:
        raise ImportError("exact counts need CGAL: pip install cgal") from None
    made: dict[int, Any] = {}
    for index in np.unique(pairs).tolist():
        made[index] = cgal_hull(kernel, corners[index].tolist())
    result = np.zeros(len(pairs), dtype=bool)
    for row, (i, j) in enumerate(pairs.tolist()):
        result[row] = kernel.do_intersect(made[i], made[j])
    return result
