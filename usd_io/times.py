"""Time codes and frame specifications.

A time code is a plain float everywhere in this package; NaN stands for the default time, which is
how `Usd.TimeCode.Default()` itself is stored.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pxr import Usd

from usd_io.errors import FrameSpecError

# Largest number of frames that `FrameSpec.values` lists; a mask has no such limit.
MOST_FRAMES = 10_000_000
# So many frames that lie apart are named in a message, of so many that are sought at most.
_MOST_TOLD = 8
_MOST_SOUGHT = 10_000

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_PART = re.compile(rf"({_NUMBER})(?::({_NUMBER})(?:x({_NUMBER}))?)?")
_HELP = "write frames as 7, 1:10, -5:10, 1:100x2 or several of them with commas"


def time_code(time: float) -> Usd.TimeCode:
    """Return the `Usd.TimeCode` of a float; NaN gives the default time."""
    return Usd.TimeCode.Default() if math.isnan(time) else Usd.TimeCode(float(time))


@dataclass(frozen=True)
class FrameRange:
    """Frames start, start + step, ... up to and including stop (within rounding).

    exact: each of them was meant, as a frame by itself, a stride or a start between whole frames
    says; else they are those of the stage.
    """

    start: float
    stop: float
    step: float
    exact: bool

    @property
    def count(self) -> int:
        """The number of frames."""
        return math.floor((self.stop - self.start) / self.step + 1e-6) + 1

    @property
    def last(self) -> float:
        """The last frame."""
        return self.start + (self.count - 1) * self.step

    def numbers(self, first: float, last: float) -> range:
        """Return the numbers, from 0 on, of the frames from `first` to `last`."""
        low = max((first - self.start) / self.step, 0.0)
        high = min((last - self.start) / self.step, self.count - 1.0)
        return range(math.ceil(low - 1e-6), math.floor(high + 1e-6) + 1)

    def select(self, times: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which of the time codes (T,) are frames of this range, (T,)."""
        steps = np.round((times - self.start) / self.step)
        nearest = self.start + steps * self.step
        # Composed layer offsets leave rounding errors: 0.30000000000000004 is frame 0.3.
        tolerance = 1e-6 * np.minimum(abs(self.step), 1.0)
        tolerance = np.maximum(tolerance, 1e-12 * np.abs(times))
        selected: NDArray[np.bool_] = (
            (steps >= 0) & (steps < self.count) & (np.abs(times - nearest) <= tolerance)
        )
        return selected


@dataclass(frozen=True)
class FrameSpec:
    """A parsed frame specification; see `parse_frames`."""

    text: str
    ranges: tuple[FrameRange, ...]

    @property
    def one_by_one(self) -> FrameSpec | None:
        """The part that names frames one by one, see `FrameRange.exact`; None for no such part."""
        exact = tuple(part for part in self.ranges if part.exact)
        return FrameSpec(self.text, exact) if exact else None

    def select(self, times: ArrayLike, *, require: bool = False) -> NDArray[np.bool_]:
        """Return which of the time codes (T,) the specification names, as a mask (T,).

        Time codes between the frames of a range are not named: 1:3 is 1, 2, 3 and not 1.5 (that
        is 1:3x0.5). The default time (NaN) is never named. With `require`, a FrameSpecError is
        raised if no time code is named.
        """
        times = np.asarray(times, dtype=np.float64).reshape(-1)
        known = ~np.isnan(times)
        mask = np.zeros(len(times), dtype=bool)
        for frame_range in self.ranges:
            mask[known] |= frame_range.select(times[known])
        if require and not mask.any():
            raise FrameSpecError(_none_in_range(self.text, times[known]))
        return mask

    def beyond(self, times: NDArray[np.float64]) -> str:
        """Return what to say of frames before and after all time codes (T,), sorted; else ""."""
        first = min(part.start for part in self.ranges)
        last = max(part.last for part in self.ranges)
        # As far as `select` takes for the same frame.
        if first > times[0] - 1e-6 and last < times[-1] + 1e-6:
            return ""
        return (
            f"frames {self.text!r} go beyond those of the stage, {times[0]:.10g} to "
            f"{times[-1]:.10g}; what is beyond is left out"
        )

    def left_out(self, times: NDArray[np.float64], what: str) -> str:
        """Return what to say of exact frames between time codes (T,), sorted, that are not theirs.

        what: what they are then, such as "no key"; "" where there is nothing to say.
        """
        try:
            missing = self.missing_from(times, most=_MOST_SOUGHT)
        except FrameSpecError:
            return f"frames {self.text!r}: those that are {what} are left out"
        if not len(missing):
            return ""
        are = "is" if len(missing) == 1 else "are"
        return f"frames {self.text!r}: {_first(missing)} {are} {what}, and {are} left out"

    def missing_from(self, times: NDArray[np.float64], *, most: int) -> NDArray[np.float64]:
        """Return the exact frames that sorted time codes (T,) lack, from first to last, (N,).

        Raises FrameSpecError for more than `most`.
        """
        meant = self.one_by_one
        named = np.zeros(0) if meant is None else meant.between(times[0], times[-1], most=most)
        if named is None:
            raise FrameSpecError(f"frames {self.text!r}: more than {most} frames; name fewer")
        # As far as `FrameRange.select` takes for the same frame.
        within = np.maximum(1e-6, 1e-12 * np.abs(named))
        first = np.diff(named, prepend=-np.inf) > within
        named, within = named[first], within[first]
        taken = np.concatenate([[-np.inf], times[self.select(times)], [np.inf]])
        after = np.searchsorted(taken, named)
        off = np.minimum(taken[after] - named, named - taken[after - 1])
        apart: NDArray[np.bool_] = off > within
        return named[apart]

    def values(self) -> NDArray[np.float64]:
        """Return all frames, sorted and without repetition, (N,)."""
        found = self.between(-math.inf, math.inf, most=MOST_FRAMES)
        if found is None:
            raise FrameSpecError(f"frames {self.text!r}: more than {MOST_FRAMES} frames")
        return found

    def between(self, first: float, last: float, *, most: int) -> NDArray[np.float64] | None:
        """Return the frames from `first` to `last`, sorted, (N,); None for more than `most`."""
        parts = [part.numbers(first, last) for part in self.ranges]
        # Of a range of 1e300 frames Python knows no length.
        if sum(max(part.stop - part.start, 0) for part in parts) > most:
            return None
        both = zip(self.ranges, parts, strict=True)
        frames = [part.start + np.array(numbers) * part.step for part, numbers in both]
        return np.unique(np.concatenate(frames))


def parse_frames(spec: str) -> FrameSpec:
    """Parse a frame specification as usdrecord's `--frames` takes it.

    Parts are separated by commas; a part is a frame (`7`), a range (`-5:10`) or a range with a
    stride (`1:100x2`). A descending range is accepted, as in usdrecord, and names the frames it
    would visit: `10:1` the same as `1:10`, `10:1x-2` is 10, 8, 6, 4, 2. Anything else raises
    FrameSpecError: no frames at all, infinite frames, a zero stride, or a stride whose sign leads
    away from the end.
    """
    parts = [part.strip() for part in str(spec).split(",")]
    if not any(parts):
        raise FrameSpecError(f"frames {spec!r}: no frames given; {_HELP}")
    return FrameSpec(str(spec), tuple(_parse_part(spec, part) for part in parts))


def _parse_part(spec: str, part: str) -> FrameRange:
    """Return the range of one part of a specification. Raises FrameSpecError."""
    match = _PART.fullmatch(part)
    if match is None:
        raise FrameSpecError(f"frames {spec!r}: cannot read {part!r}; {_HELP}")
    start = float(match[1])
    stop = start if match[2] is None else float(match[2])
    downwards = stop < start
    step = (-1.0 if downwards else 1.0) if match[3] is None else float(match[3])
    exact = match[2] is None or match[3] is not None or not start.is_integer()
    if not all(math.isfinite(value) for value in (start, stop, step)):
        raise FrameSpecError(f"frames {spec!r}: {part!r} is not finite; {_HELP}")
    if step == 0.0:
        raise FrameSpecError(f"frames {spec!r}: the stride of {part!r} is zero; leave it out")
    if (stop - start) * step < 0.0:
        raise FrameSpecError(
            f"frames {spec!r}: the stride of {part!r} leads away from its end; change its sign"
        )
    if not downwards:
        return FrameRange(start, stop, abs(step), exact)
    last = start + math.floor((stop - start) / step + 1e-6) * step
    return FrameRange(last, start, -step, exact)


def _none_in_range(text: str, times: NDArray[np.float64]) -> str:
    """Return the message for a specification that names none of the frames."""
    if not len(times):
        none = "the selected meshes have no time samples of their own; leave the frames out"
        return f"frames {text!r}: {none}"
    return f"frames {text!r}: none of the frames, {_told(np.unique(times))}, is among them"


def _told(times: NDArray[np.float64]) -> str:
    """Return time codes (T,) in words: the ends where each frame is there, else the first few."""
    if len(times) > 1 and np.diff(times).max() < 1.0 + 1e-6:
        return f"{times[0]:.15g} to {times[-1]:.15g}"
    return _first(times)


def _first(times: NDArray[np.float64]) -> str:
    """Return the first few of some time codes (T,) in words, and how many more there are."""
    words = ", ".join(f"{time:.15g}" for time in times[:_MOST_TOLD])
    left = len(times) - _MOST_TOLD
    return f"{words} and {left} more up to {times[-1]:.15g}" if left > 0 else words
