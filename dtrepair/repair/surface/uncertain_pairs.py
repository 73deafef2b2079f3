"""Pairs that floating point cannot settle, and the rest pose has not: settled exactly."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dtrepair.intersect.detector import Detector
from dtrepair.intersect.exact import intersect
from dtrepair.numerics.geometry import IntArray, pair_keys

BoolArray = NDArray[np.bool_]


class UncertainPairs:
    """Decides which candidates of a detector count; remembers its verdicts.

    Floating point leaves pairs uncertain that lie in one plane, such as the slivers of a flat cap.
    While contacts are being repaired they count, which saves exact arithmetic. Those that are
    uncertain and clear in the rest pose are settled: what touches nothing, as a prop beside a
    character, must not be moved for an uncertain pair.

    Args:
        detector: The detector of the mesh.
        rest: Its rest pose (V, 3).
        most_kept: Verdicts that are kept before all are forgotten, which bounds the memory; what
            stands still is asked about again and again.
    """

    def __init__(
        self, detector: Detector, rest: NDArray[np.float32], *, most_kept: int = 100_000
    ) -> None:
        self._detector, self._rest, self._most_kept = detector, rest, most_kept
        self._known: dict[tuple[int, int, bytes], bool] = {}

    def __call__(self, points: NDArray[np.float32], rows: IntArray) -> BoolArray:
        """Return which rows (K, 4) of `Detector.candidates` of poses (B, V, 3) to keep."""
        keep = np.ones(len(rows), dtype=bool)
        uncertain = rows[:, 3] == 2
        if uncertain.any():
            asked = uncertain & np.isin(pair_keys(rows[:, 1:3]), self._clear_at_rest)
            keep[asked] = self._settled(points, rows[asked])
        return keep

    @cached_property
    def _clear_at_rest(self) -> NDArray[np.int64]:
        """Pairs that are uncertain in the rest pose and do not intersect there, as numbers."""
        rows = self._detector.candidates(self._rest[None])
        rows = rows[rows[:, 3] == 2]
        corners = self._corners(self._rest[None], rows)
        return pair_keys(rows[~intersect(corners[:, 0], corners[:, 1])][:, 1:3])

    def _corners(self, points: NDArray[np.float32], rows: IntArray) -> NDArray[np.float32]:
        """Return the corners (K, 2, 3, 3) of both triangles of each row."""
        found: NDArray[np.float32] = points[
            rows[:, 0, None, None], self._detector.faces[rows[:, 1:3]]
        ]
        return found

    def _settled(self, points: NDArray[np.float32], rows: IntArray) -> BoolArray:
        corners = self._corners(points, rows)
        pairs = zip(rows[:, 1:3].tolist(), corners, strict=True)
        keys = [(i, j, at.tobytes()) for (i, j), at in pairs]
        verdicts = [self._known.get(key) for key in keys]
        new = [index for index, verdict in enumerate(verdicts) if verdict is None]
        if new:
            # Without area nothing intersects: what a repair flattens must not pass for clean.
            at_rest = without_area(self._rest[self._detector.faces[rows[new, 1:3]]])
            flattened = (without_area(corners[new]) & ~at_rest).any(axis=1)
            found = intersect(corners[new, 0], corners[new, 1]) | flattened
            if len(self._known) > self._most_kept:
                self._known.clear()
            for index, verdict in zip(new, found.tolist(), strict=True):
                verdicts[index] = self._known[keys[index]] = verdict
        return np.array(verdicts, dtype=bool)


def without_area(corners: NDArray[np.float32]) -> BoolArray:
    """Return which triangles (..., 3, 3) have no area: products of float32 are exact in float64."""
    exact = corners.astype(np.float64)
    sides = exact[..., 1:, :] - exact[..., :1, :]
    area: NDArray[np.float64] = np.cross(sides[..., 0, :], sides[..., 1, :])
    flat: BoolArray = (area == 0.0).all(axis=-1)
    return flat
