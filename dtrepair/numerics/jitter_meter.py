"""Jitter of a correction, measured while the frames stream by."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dtrepair.numerics.geometry import diagonal


class JitterMeter:
    """Measures the root mean square second difference of the displacement, in diagonals.

    The same figure as `metrics.jitter`, in memory that does not grow with the number of frames.
    """

    def __init__(self) -> None:
        self._last: list[NDArray[np.float64]] = []
        self._diagonal = 0.0
        self._sum = 0.0
        self._count = 0

    def add(self, before: ArrayLike, after: ArrayLike) -> None:
        """Take the next frame: points (V, 3) of the input and of the result."""
        original = np.asarray(before, dtype=np.float64)
        if not self._last:
            self._diagonal = diagonal(original) or 1.0
        self._last.append(np.asarray(after, dtype=np.float64) - original)
        if len(self._last) == 3:
            first, middle, last = self._last
            second = first - 2 * middle + last
            self._sum += float((second**2).sum())
            self._count += len(second)
            self._last.pop(0)

    @property
    def value(self) -> float:
        """The jitter of the frames so far; 0 for fewer than three frames."""
        return float(np.sqrt(self._sum / self._count)) / self._diagonal if self._count else 0.0
