"""What lengths of a scene are measured in: the size of what moves in it, not of the set around.

A character is repaired the same on a floor of a hundred metres, and beside another one far away.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.geometry import FloatArray, IntArray, diagonal, extent

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class ScaleOptions:
    """What the size of a scene is taken from.

    Args:
        larger: What stands still is a set, by which nothing is measured, where its extent is more
            than so many times that of the largest thing that moves: boxes that overlap are one.
        apart: What counts is measured each for itself where it lies apart by more than so many
            times the extent of the larger one.
    """

    larger: float = 4.0
    apart: float = 1.0


class Scale(NamedTuple):
    """The vertices (N,) of each group of bodies that is measured for itself; none: all are one.

    The largest group counts.
    """

    groups: tuple[IntArray, ...] = ()

    def extent(self, points: FloatArray) -> float:
        """Return the longest side of the box of the largest group of points (V, 3)."""
        return self._largest(extent, points)

    def diagonal(self, points: FloatArray) -> float:
        """Return the diagonal of the box of the largest group of points (V, 3)."""
        return self._largest(diagonal, points)

    def counted(self, count: int) -> BoolArray:
        """Return which of so many vertices (count,) are measured at all: none of the set around."""
        mask = np.full(count, not self.groups)
        for group in self.groups:
            mask[group] = True
        return mask

    def among(self, kept: NDArray[np.integer]) -> Scale:
        """Return the same for some of the vertices (N,), ascending, numbered anew."""
        groups = (np.flatnonzero(np.isin(kept, group)) for group in self.groups)
        return Scale(tuple(group.astype(np.int32) for group in groups if len(group)))

    def _largest(self, size: Callable[[FloatArray], float], points: FloatArray) -> float:
        if not self.groups:
            return size(points)
        return max(size(points[group]) for group in self.groups)


# All vertices are one group.
WHOLE = Scale()


def scale_of(
    rest: FloatArray,
    starts: NDArray[np.integer],
    still: BoolArray,
    *,
    sets: BoolArray | None = None,
    options: ScaleOptions = ScaleOptions(),
) -> Scale:
    """Return what lengths of a scene are measured in.

    rest: rest positions (V, 3) of all bodies, each of which has some; starts: the first vertex of
    each, and V (B + 1,); still: which bodies (B,) never move; sets: which of them are sets anyway.
    """
    count = len(still)
    if count < 2 or still.all():
        return WHOLE
    boxes = boxes_of(rest, starts)
    counted = ~sets_among(boxes, still, options.larger)
    if sets is not None:
        counted &= ~(sets & still)
    group_of = np.full(count, -1)
    group_of[counted] = merged_boxes(boxes[counted], options.apart)[1]
    if counted.all() and group_of.max() == 0:
        return WHOLE
    label = np.repeat(group_of, np.diff(starts))
    return Scale(
        tuple(np.flatnonzero(label == own).astype(np.int32) for own in range(group_of.max() + 1))
    )


def boxes_of(points: FloatArray, starts: NDArray[np.integer]) -> FloatArray:
    """Return the lowest and the highest coordinates (B, 2, 3) of each of the bodies in points.

    points: positions (V, 3); starts: the first vertex of each body, and V (B + 1,).
    """
    low, high = (each.reduceat(points, starts[:-1], axis=0) for each in (np.minimum, np.maximum))
    return np.stack([low, high], axis=1)


def gaps_between(boxes: FloatArray) -> FloatArray:
    """Return how far apart boxes (B, 2, 3) are along the axis where that is most, (B, B).

    Negative where they overlap.
    """
    gaps = np.full((len(boxes),) * 2, -np.inf)
    for low, high in zip(boxes[:, 0].T, boxes[:, 1].T, strict=True):  # axis by axis: memory
        np.maximum(gaps, low[:, None] - high, out=gaps)
        np.maximum(gaps, low - high[:, None], out=gaps)
    return gaps


def sets_among(boxes: FloatArray, still: BoolArray, larger: float) -> BoolArray:
    """Return which bodies with boxes (B, 2, 3) are sets: still (B,), and much larger than others.

    larger: see `ScaleOptions`. None are where nothing moves.
    """
    if still.all():
        return np.zeros(len(still), dtype=bool)
    largest = longest_sides(merged_boxes(boxes[~still], 0.0)[0]).max()
    return np.asarray(still & (longest_sides(boxes) > larger * largest))


def longest_sides(boxes: FloatArray) -> FloatArray:
    """Return the longest side (B,) of each box (B, 2, 3)."""
    return np.asarray((boxes[:, 1] - boxes[:, 0]).max(axis=1))


def merged_boxes(boxes: FloatArray, apart: float) -> tuple[FloatArray, NDArray[np.integer]]:
    """Return the boxes (G, 2, 3) of groups of boxes (B, 2, 3), and the group (B,) of each.

    Groups lie apart by more than so many times the longest side of the larger one.
    """
    group_of = np.arange(len(boxes))
    while True:
        size = longest_sides(boxes)
        beside = gaps_between(boxes) <= apart * np.maximum(size[:, None], size)
        count, label = csgraph.connected_components(sparse.csr_matrix(beside), directed=False)
        if count == len(boxes):
            return boxes, group_of
        low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
        np.minimum.at(low, label, boxes[:, 0])
        np.maximum.at(high, label, boxes[:, 1])
        boxes, group_of = np.stack([low, high], axis=1), label[group_of]
