"""Frames whose correction stands out from those before and after: they are seen to jump."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dtrepair.numerics.geometry import FloatArray, diagonal, lengths


@dataclass(frozen=True, kw_only=True)
class JumpOptions:
    """What counts as a jump.

    Args:
        farther: A vertex jumps by how much farther its displacement is from that between its
            neighbours in time than these are from the middle between them. A frame jumps where
            that is more than this fraction of the diagonal ...
        quantile: ... for all but this fraction of the vertices.
    """

    farther: float = 0.01
    quantile: float = 0.995


class JumpMeter:
    """Measures by how much the displacements of frames stand out, in memory for three frames.

    A correction that grows or fades, however fast, is no jump: the displacement between two others
    may be as far from both as they are from each other.
    """

    def __init__(self, *, options: JumpOptions = JumpOptions()) -> None:
        self.options = options
        self._last: list[tuple[float, FloatArray]] = []
        self._diagonal = 0.0
        # By how much frames jump, fractions of the diagonal of the first one, by their times.
        self.jumps: dict[float, float] = {}

    def add(self, time: float, before: ArrayLike, after: ArrayLike) -> None:
        """Take the next frame: its time, points (V, 3) of the input and of the result.

        What is not between two others in time is not measured.
        """
        original = np.asarray(before, dtype=np.float64)
        if not self._last:
            self._diagonal = diagonal(original) or 1.0
        self._last.append((time, np.asarray(after, dtype=np.float64) - original))
        if len(self._last) < 3:
            return
        (first, left), (middle, own), (last, right) = self._last
        self._last.pop(0)
        if not (len(own) and first < middle < last):
            return
        between = left + (middle - first) / (last - first) * (right - left)
        farther = lengths(own - between) - 0.5 * lengths(right - left)
        jump = float(np.quantile(farther, self.options.quantile)) / self._diagonal
        if jump > self.options.farther:
            self.jumps[middle] = jump
