"""Rays through closed surfaces: winding numbers, and the ways out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray

# Rays start this part of the size of the triangles beside their points.
ASIDE = np.array([0.0, 3.7e-7, 6.1e-7])
# Rays that lie side by side are looked at together, so many pairs of one and a triangle at most.
TOGETHER, BLOCK = 64, 2_000_000


def crossings(
    starts: FloatArray, corners: FloatArray
) -> tuple[NDArray[np.integer], FloatArray, NDArray[np.integer]]:
    """Return where rays along the first axis from points (P, 3) meet triangles (F, 3, 3).

    The ray (K,) of each crossing, its distance, and 1 for exits, -1 for entries: the sum of a ray
    is the winding number of its start.
    """
    first, second, third = corners[:, 0], corners[:, 1], corners[:, 2]
    low = np.minimum(np.minimum(first, second), third)
    high = np.maximum(np.maximum(first, second), third)
    if len(corners):
        # A ray of a regular mesh could run exactly through an edge, and miss both triangles.
        starts = starts + ASIDE * float((high.max(axis=0) - low.min(axis=0)).max())
    if len(starts):
        least, most = starts.min(axis=0), starts.max(axis=0)
        met = high[:, 0] > least[0]
        met &= ((low <= most) & (high >= least))[:, 1:].all(axis=1)
        corners, low, high = corners[met], low[met], high[met]
    rays, triangles = _near(starts, low, high)
    offsets = corners[triangles] - starts[rays][:, None]
    y, z = offsets[:, :, 1], offsets[:, :, 2]
    following = [1, 2, 0]
    # Twice the areas that the start spans with each edge, seen along the ray.
    spans = y * z[:, following] - z * y[:, following]
    signs = (spans > 0).all(axis=1).astype(np.int64) - (spans < 0).all(axis=1)
    weights = spans[:, [1, 2, 0]] / np.where(signs == 0, 1.0, spans.sum(axis=1))[:, None]
    ahead = (weights * offsets[:, :, 0]).sum(axis=1)
    hit = (signs != 0) & (ahead > 0)
    return rays[hit], ahead[hit], signs[hit]


def _near(
    starts: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Return rays (K,) along the first axis, and the boxes that each of them meets (K,).

    starts: of the rays (P, 3); low, high: corners of the boxes (F, 3).
    """
    side_by_side = np.argsort(starts[:, 1], kind="stable")
    step = max(1, min(TOGETHER, BLOCK // max(len(low), 1)))
    rays, boxes = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for begin in range(0, len(starts), step):
        some = side_by_side[begin : begin + step]
        own = starts[some]
        beside = (low[:, 1] <= own[-1, 1]) & (high[:, 1] >= own[0, 1])
        met = np.flatnonzero(beside & (high[:, 0] > own[:, 0].min()))
        hit = high[met, 0] > own[:, :1]
        for axis in (1, 2):
            place = own[:, axis, None]
            hit &= (low[met, axis] <= place) & (high[met, axis] >= place)
        ray, box = np.nonzero(hit)
        rays.append(some[ray])
        boxes.append(met[box])
    return np.concatenate(rays), np.concatenate(boxes)


def windings(points: FloatArray, corners: FloatArray) -> NDArray[np.integer]:
    """Return the winding numbers (P,) of triangles (F, 3, 3) at points (P, 3)."""
    rays, _, signs = crossings(points @ SKEW, _turned(corners, SKEW))
    return np.bincount(rays, signs, minlength=len(points)).astype(np.int64)


def exits_along(direction: FloatArray, points: FloatArray, corners: FloatArray) -> FloatArray:
    """Return how far points (P, 3) have to go along a unit direction to leave triangles (F, 3, 3).

    0 for those that are outside.
    """
    frame = frame_along(direction)
    rays, ahead, signs = crossings(points @ frame, _turned(corners, frame))
    result = np.zeros(len(points))
    order = np.lexsort((ahead, rays))
    rays, ahead, signs = rays[order], ahead[order], signs[order]
    totals = np.bincount(rays, signs, minlength=len(points))
    passed = np.cumsum(signs)
    before = np.concatenate([[0], passed])[np.searchsorted(rays, rays)]
    out = np.flatnonzero(totals[rays] - (passed - before) <= 0)
    first = out[np.unique(rays[out], return_index=True)[1]]
    inside = totals[rays[first]] > 0
    result[rays[first[inside]]] = ahead[first[inside]]
    return result


def frame_along(direction: FloatArray) -> FloatArray:
    """Return a rotation (3, 3): points @ it have their part along the unit direction first."""
    # The other axes are skew, so that rays from regular meshes do not meet edges exactly.
    helper = np.roll(direction, 1) * [0.3, -0.7, 0.5] + [0.12, 0.93, -0.41]
    second = np.cross(direction, helper)
    if np.linalg.norm(second) < 0.1 * np.linalg.norm(helper):
        second = np.cross(direction, np.roll(helper, 1))
    second /= np.linalg.norm(second)
    return np.stack([direction, second, np.cross(direction, second)], axis=1)


def _turned(corners: FloatArray, frame: FloatArray) -> FloatArray:
    """Return the corners (F, 3, 3) @ frame, as one product of many rows."""
    return (corners.reshape(-1, 3) @ frame).reshape(-1, 3, 3)


# A direction that regular meshes do not have.
SKEW = frame_along(
    np.array([0.61803, 0.55331, 0.55852]) / np.linalg.norm([0.61803, 0.55331, 0.55852])
)
