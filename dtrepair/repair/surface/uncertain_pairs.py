"""Pairs that floating point cannot settle, and the rest pose has not: settled exactly."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dtrepair.intersect.detector import Detector
from dtrepair.intersect.exact import settled
from dtrepair.numerics.geometry import IntArray, pair_keys

BoolArray = NDArray[np.bool_]


class UncertainPairs:
    """Decides which candidates of a detector count.

    Floating point leaves pairs uncertain that lie in one plane, such as the slivers of a flat cap.
    While contacts are being repaired they count. Those that are uncertain and clear in the rest
    pose are settled: what touches nothing, as a prop beside a character, must not be moved for an
    uncertain pair. So are those of which one has no area.

    Args:
        detector: The detector of the mesh.
        rest: Its rest pose (V, 3).
    """

    def __init__(self, detector: Detector, rest: NDArray[np.float32]) -> None:
        self._detector, self._rest = detector, rest

    def __call__(self, points: NDArray[np.float32], rows: IntArray) -> BoolArray:
        """Return which rows (K, 4) of `Detector.candidates` of poses (B, V, 3) to keep."""
        keep = np.ones(len(rows), dtype=bool)
        uncertain = rows[:, 3] > 1
        if uncertain.any():
            asked = rows[:, 3] == 3
            asked |= uncertain & np.isin(pair_keys(rows[:, 1:3]), self._clear_at_rest)
            keep[asked] = self._settled(points, rows[asked])
        return keep

    @cached_property
    def _clear_at_rest(self) -> NDArray[np.int64]:
        """Pairs that are uncertain in the rest pose and do not intersect there, as numbers."""
        rows = self._detector.candidates(self._rest[None])
        rows = rows[rows[:, 3] > 1]
        return pair_keys(rows[~self._settled(self._rest[None], rows), 1:3])

    def _settled(self, points: NDArray[np.float32], rows: IntArray) -> BoolArray:
        """Return which rows (K, 4) of poses (B, V, 3) intersect, exactly."""
        return settled(self._detector.mesh, points, rows[:, :3])
