"""Where a stage has whole frames: every time code of an ordinary stage that is a whole number."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

# More whole frames than these are not added between samples: 14 minutes at 24 frames per second.
# A key that was set at 1e9 by mistake would else take days.
MOST_ADDED_FRAMES = 20_000


@dataclass(frozen=True)
class FrameGrid:
    """Whole frames: the time codes origin + k step for all integers k."""

    step: float = 1.0
    origin: float = 0.0

    def filled(self, times: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return times (T,) and the whole frames between the first and the last, sorted, (N,).

        A time within rounding of a whole frame stands for it: composed layer offsets leave
        2.0000000000000004. None where more than `MOST_ADDED_FRAMES` frames would be added.
        """
        times = np.unique(times)
        if not len(times):
            return times
        first, last = self._number(times[0]), self._number(times[-1])
        if not np.isfinite([first, last]).all():
            return None
        numbers = np.round(self._number(times))
        on_grid = np.abs(times - self._time(numbers)) <= self._tolerance(times)
        ends = math.ceil(first - 1e-9), math.floor(last + 1e-9)
        if ends[1] - ends[0] + 1 - len(np.unique(numbers[on_grid])) > MOST_ADDED_FRAMES:
            return None
        missing = np.setdiff1d(np.arange(ends[0], ends[1] + 1.0), numbers[on_grid])
        return np.union1d(times, self._time(missing))

    def _number(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the number k of times, between whole frames a fraction."""
        return np.asarray((times - self.origin) / self.step)

    def _time(self, numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the times of numbers."""
        return np.asarray(self.origin + numbers * self.step)

    def _tolerance(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far from a whole frame a time may be to stand for it."""
        return np.maximum(1e-6 * min(self.step, 1.0), 1e-12 * np.abs(times))


def frame_grid(stage: Usd.Stage) -> FrameGrid:
    """Return where a stage has whole frames.

    They are one time code apart, or timeCodesPerSecond / framesPerSecond where both are authored
    and differ, counted from the start of the stage then, as usdview does.
    """
    rates = stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond()
    authored = [stage.HasAuthoredMetadata(n) for n in ("timeCodesPerSecond", "framesPerSecond")]
    if not all(authored) or rates[0] == rates[1]:
        return FrameGrid()
    if not all(math.isfinite(rate) and rate > 0.0 for rate in rates):
        return FrameGrid()
    start = float(stage.GetStartTimeCode()) if stage.HasAuthoredTimeCodeRange() else 0.0
    return FrameGrid(rates[0] / rates[1], start if math.isfinite(start) else 0.0)
