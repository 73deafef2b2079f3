"""Where a clip is cut, and which windows it is solved in: parts of it can be solved elsewhere."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from dtrepair.numerics.geometry import FloatArray, extent


@dataclass(frozen=True, kw_only=True)
class CutOptions:
    """What counts as a cut.

    Args:
        ratio: A jump between frames this many times faster than those before and after it is a cut
            ...
        least: ... unless the root mean square motion is below this, sizes of the mesh: a start from
            rest is no cut.
        always: Motion above which it always is one, sizes of the mesh: nothing is smooth over that.
        held: Frames that a pose may be held for before a jump counts as a start from rest: on twos
            and threes each step is one among others.
    """

    ratio: float = 5.0
    least: float = 0.05
    always: float = 0.5
    held: int = 4


def is_cut(
    before: float,
    jump: float,
    after: float,
    motion: float,
    *,
    options: CutOptions = CutOptions(),
) -> bool:
    """Return whether a jump between two frames starts a new shot.

    before, jump, after: speeds (size / time) across the gap before, this gap and the one after: a
    cut stands out from both, however fast the shots are. motion: the jump itself, in sizes.
    """
    alone = motion > options.least and jump > options.ratio * max(before, after)
    return alone or motion > options.always


def cuts_along(
    steps: Iterable[tuple[float, float]], *, options: CutOptions = CutOptions()
) -> Iterator[bool]:
    """Yield for each step of a clip, its speed (size / time) and motion (sizes), if it is a cut.

    It is compared with the last step before and the next one after it that move at all: reads on
    to that, at most `options.held` steps.
    """
    left = iter(steps)
    coming = deque(islice(left, 1))
    before, rested = 0.0, 0
    while coming:
        jump, motion = coming.popleft()
        while len(coming) < options.held and not (coming and coming[-1][0] > 0.0):
            if (step := next(left, None)) is None:
                break
            coming.append(step)
        after = coming[-1][0] if coming else 0.0
        yield is_cut(before, jump, after, motion, options=options)
        before, rested = (jump, 0) if jump > 0.0 else (before, rested + 1)
        if rested >= options.held:
            before = 0.0


def motion_between(first: FloatArray, second: FloatArray) -> float:
    """Return the root mean square motion of vertices (V, 3) between two poses; 0 of none.

    In sizes of the first pose. What is not a number in one of them is not there, and no vertex.
    """
    there = np.isfinite(first[:, 0]) & np.isfinite(second[:, 0])
    if not there.all():
        first, second = first[there], second[there]
    if len(first) == 0:
        return 0.0
    return float(np.sqrt(((second - first) ** 2).sum(axis=1).mean())) / (extent(first) or 1.0)


@dataclass(frozen=True, kw_only=True)
class LayoutOptions:
    """How clips are cut into windows.

    Args:
        window: Frames that are solved together: memory and time grow with them.
        overlap: Frames that two windows have in common, over which they are cross-faded.
        cuts: Where a clip is cut, whatever the windows.

    Raises:
        ValueError: windows that would overlap by more than half.
    """

    window: int = 60
    overlap: int = 12
    cuts: CutOptions = field(default_factory=CutOptions)

    def __post_init__(self) -> None:
        """Check the window."""
        if not 0 < 2 * self.overlap <= self.window:
            raise ValueError(
                f"window should be at least 2 x {self.overlap} frames, got {self.window}"
            )


class Window(NamedTuple):
    """Frames start..stop are solved together, first..stop - kept of them handed out by it.

    Indices of frames; `end` is where the frames handed out end. follows: it goes on from the
    window before, whose last frames fade into its first ones.
    """

    start: int
    stop: int
    end: int
    follows: bool


def motions_of(frames: Iterable[Any]) -> FloatArray:
    """Return the motion from each frame (V, 3) to the next one (T - 1,), in sizes of the mesh."""
    motions: list[float] = []
    last: FloatArray | None = None
    for frame in frames:
        points = np.asarray(frame, dtype=np.float64)
        if last is not None:
            motions.append(motion_between(last, points))
        last = points
    return np.array(motions)


def window_layout(
    times: Sequence[float], motions: FloatArray, *, options: LayoutOptions = LayoutOptions()
) -> list[Window]:
    """Return the windows of `ClipRepairer.stream` for frames at times (T,), motions (T - 1,)."""
    window, overlap = options.window, options.overlap
    if not len(times):
        return []
    starts = _starts(np.asarray(times, dtype=np.float64), motions, options.cuts)
    windows: list[Window] = []
    for first, end in zip(starts, [*starts[1:], len(times)], strict=True):
        start = first
        while start + window <= end:
            windows.append(Window(start, start + window, start + window - overlap, start > first))
            start += window - overlap
        if start < end:
            windows.append(Window(start, end, end, start > first))
    return windows


def frames_to_solve(
    times: Sequence[float],
    motions: FloatArray,
    chosen: tuple[int, int],
    *,
    options: LayoutOptions = LayoutOptions(),
) -> tuple[int, int]:
    """Return frames start..stop that give chosen windows (first, stop) the results of the whole.

    That is one window more before them, whose last frames fade into theirs, and the frames after
    them that tell whether a cut follows.
    """
    layout = window_layout(times, motions, options=options)
    first, stop = chosen
    needed = layout[first - layout[first].follows : stop]
    end = needed[-1].stop
    moving = np.flatnonzero(motions[end - 1 : end - 1 + options.cuts.held])
    last = min(end + (int(moving[0]) + 1 if len(moving) else options.cuts.held), len(times))
    for item in reversed(layout[: first + 1 - layout[first].follows]):
        own = window_layout(
            times[item.start : last], motions[item.start : last - 1], options=options
        )
        ranges = {(w.start + item.start, w.stop + item.start) for w in own}
        if all((w.start, w.stop) in ranges for w in needed):
            return item.start, last
    return 0, len(times)


def _starts(times: FloatArray, motions: FloatArray, cuts: CutOptions) -> list[int]:
    """Return the indices of the first frame and of those after a cut, as `read_frames` marks."""
    steps = zip((motions / np.diff(times)).tolist(), motions.tolist(), strict=True)
    return [0, *(k for k, cut in enumerate(cuts_along(steps, options=cuts), start=1) if cut)]
