"""Normals of changed points, with the hard edges the input's normals had (numpy only)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Polygons:
    """Polygon topology for normals.

    Attributes:
        counts: corners of each polygon (P,) int64.
        indices: vertex of each corner (C,) int64.
        flip: left-handed winding.
    """

    counts: NDArray[np.int64]
    indices: NDArray[np.int64]
    flip: bool

    @property
    def corner_polygons(self) -> NDArray[np.int64]:
        """The polygon of each corner (C,)."""
        return np.repeat(np.arange(len(self.counts)), self.counts)


def polygon_areas(polygons: Polygons, points: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return vector areas (P, 3): normal times area, right-handed unless `flip` (Newell's sum)."""
    corners = np.asarray(points, dtype=np.float64)[polygons.indices]
    starts = np.cumsum(polygons.counts) - polygons.counts
    owner = polygons.corner_polygons
    # Relative to the first corner: no digits are lost far from the origin.
    corners = corners - corners[starts[owner]]
    following = np.arange(len(corners)) + 1
    ends = (starts + polygons.counts - 1)[polygons.counts > 0]
    following[ends] = starts[polygons.counts > 0]
    crosses = 0.5 * np.cross(corners, corners[following])
    areas = _sum_by(owner, crosses, len(polygons.counts))
    return -areas if polygons.flip else areas


def recompute_normals(
    polygons: Polygons,
    points: NDArray[np.floating],
    old: NDArray[np.floating],
    interpolation: str,
    slots: NDArray[np.int64] | None = None,
) -> NDArray[np.float64] | None:
    """Return unit normals (N, 3) for new points (V, 3), smooth and hard as the old ones (N, 3).

    A normal becomes the mean of the vector areas of the polygons it belongs to. Corners of one
    vertex that share a normal in the old ones keep sharing one (smooth), others stay apart (hard).

    Args:
        polygons: the topology.
        points: new points (V, 3).
        old: normals of the old points (N, 3).
        interpolation: vertex, varying, uniform or faceVarying.
        slots: primvar indices into the old normals, if they are indexed.

    Returns:
        Normals (N, 3), or None where they cannot be recomputed: constant interpolation, a count
        that does not fit, or an indexed normal used at several places.
    """
    if interpolation in ("vertex", "varying"):
        places, place_count = polygons.indices, len(points)
    elif interpolation == "uniform":
        places, place_count = polygons.corner_polygons, len(polygons.counts)
    elif interpolation == "faceVarying":
        places, place_count = np.arange(len(polygons.indices)), len(polygons.indices)
    else:
        return None
    elements = len(old) if slots is None else len(slots)
    if elements != place_count or not len(old):
        return None
    corner_slots = places if slots is None else slots[places]
    if corner_slots.min(initial=0) < 0 or corner_slots.max(initial=0) >= len(old):
        return None
    if slots is not None and _shared(corner_slots, polygons, interpolation):
        return None
    areas = polygon_areas(polygons, points)[polygons.corner_polygons]
    if interpolation == "faceVarying" and slots is None:
        groups = _smoothing_groups(polygons.indices, old)
        summed = _sum_by(groups, areas, len(old))[groups]
    else:
        summed = _sum_by(corner_slots, areas, len(old))
    lengths = np.linalg.norm(summed, axis=1, keepdims=True)
    # Without area there is no direction: the old normal is as good as any.
    return np.where(lengths > 0.0, summed / np.where(lengths > 0.0, lengths, 1.0), old)


def _sum_by(
    owner: NDArray[np.int64], values: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Return the sum (count, 3) of the values (C, 3) of each owner (C,)."""
    columns = [np.bincount(owner, weights=column, minlength=count) for column in values.T]
    return np.stack(columns, axis=1)


def _smoothing_groups(
    vertices: NDArray[np.int64], normals: NDArray[np.floating]
) -> NDArray[np.int64]:
    """Return the group number (C,) of each corner: same vertex and normal, same group."""
    key = np.empty((len(vertices), 4), dtype=np.float64)
    key[:, 0] = vertices
    key[:, 1:] = np.round(np.asarray(normals, dtype=np.float64), 5)
    _, groups = np.unique(key + 0.0, axis=0, return_inverse=True)
    return groups.reshape(-1)


def _shared(corner_slots: NDArray[np.int64], polygons: Polygons, interpolation: str) -> bool:
    """Return whether one indexed normal is used by several vertices (or polygons, if uniform)."""
    owner = polygons.corner_polygons if interpolation == "uniform" else polygons.indices
    pairs = np.unique(np.stack([corner_slots, owner], axis=1), axis=0)
    return bool((np.diff(pairs[:, 0]) == 0).any())
