"""Doubtful contacts of what touches nothing: settled exactly, so that it is left alone."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dtrepair.geometry import IntArray
from dtrepair.intersect.exact import intersect
from dtrepair.intersect.queries import link_labels

BoolArray = NDArray[np.bool_]

# Verdicts kept; what stands still is asked about again and again.
MOST_KEPT = 100_000


class Doubts:
    """Says which candidates of a detector count; one for each surface, with a memory.

    Floating point leaves pairs in doubt that lie in one plane, such as the slivers of a flat cap.
    Where contacts are being repaired they count, which saves exact arithmetic. A part that nothing
    is sure to meet must not be moved for the sake of a doubt: there they are settled.
    """

    def __init__(self, rest: NDArray[np.float32], faces: IntArray, edges: IntArray) -> None:
        """Take rest points (V, 3), triangles (F, 3) and edges (E, 2)."""
        self.faces, self._edges, self._count = faces, edges, len(rest)
        self._flat_at_rest = without_area(rest[faces])
        self._known: dict[tuple[int, int, bytes], bool] = {}

    @cached_property
    def part_of(self) -> IntArray:
        """Label of the connected part of each triangle (F,)."""
        return link_labels(self._edges, self._count)[self.faces[:, 0]]

    def __call__(
        self,
        points: NDArray[np.float32],
        rows: IntArray,
        counts: Callable[[IntArray], BoolArray],
    ) -> BoolArray:
        """Which rows (K, 4) of `Detector.candidates` of poses (B, V, 3) to keep.

        counts: tells of rows (K, 3), frame and pair, which contacts are to be repaired at all.
        """
        sure = rows[:, 3] == 1
        keep = np.ones(len(rows), dtype=bool)
        if sure.all():
            return keep
        met = sure.copy()
        met[sure] = counts(rows[sure, :3])
        of_part = rows[:, :1].astype(np.int64) * self._count + self.part_of[rows[:, 1:3]]
        alone = ~sure & ~np.isin(of_part, of_part[met]).any(axis=1)
        keep[alone] = self._settled(points, rows[alone])
        return keep

    def _settled(self, points: NDArray[np.float32], rows: IntArray) -> BoolArray:
        corners = points[rows[:, :1, None], self.faces[rows[:, 1:3]].reshape(len(rows), 1, 6)]
        corners = np.ascontiguousarray(corners.reshape(len(rows), 2, 3, 3))
        pairs = zip(rows[:, 1:3].tolist(), corners, strict=True)
        keys = [(i, j, at.tobytes()) for (i, j), at in pairs]
        verdicts = [self._known.get(key) for key in keys]
        new = [index for index, verdict in enumerate(verdicts) if verdict is None]
        if new:
            # Without area nothing intersects: what a repair flattens must not pass for clean.
            flattened = without_area(corners[new]) & ~self._flat_at_rest[rows[new, 1:3]]
            found = intersect(corners[new, 0], corners[new, 1]) | flattened.any(axis=1)
            if len(self._known) > MOST_KEPT:
                self._known.clear()
            for index, verdict in zip(new, found.tolist(), strict=True):
                verdicts[index] = self._known[keys[index]] = verdict
        return np.array(verdicts, dtype=bool)


def without_area(corners: NDArray[np.float32]) -> BoolArray:
    """Which triangles (..., 3, 3) have no area at all; products of float32 are exact in float64."""
    exact = corners.astype(np.float64)
    sides = exact[..., 1:, :] - exact[..., :1, :]
    area: NDArray[np.float64] = np.cross(sides[..., 0, :], sides[..., 1, :])
    flat: BoolArray = (area == 0.0).all(axis=-1)
    return flat
