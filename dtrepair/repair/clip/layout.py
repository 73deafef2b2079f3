"""Which windows an animation is solved in, so that parts of it can be solved elsewhere, alike."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from dtrepair.numerics.geometry import FloatArray, extent
from dtrepair.repair.clip.cuts import is_cut, motion_between


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
    """Motion from each frame (V, 3) to the next one (T - 1,), in sizes of the mesh."""
    motions: list[float] = []
    last: FloatArray | None = None
    for frame in frames:
        points = np.asarray(frame, dtype=np.float64)
        if last is not None:
            motions.append(motion_between(last, points, extent(last) or 1.0))
        last = points
    return np.array(motions)


def window_layout(
    times: Sequence[float], motions: FloatArray, *, window: int, overlap: int
) -> list[Window]:
    """The windows of `AnimationRepairer.stream` for frames at times (T,) with motions (T - 1,)."""
    if not len(times):
        return []
    starts = _shots(np.asarray(times, dtype=np.float64), motions)
    found: list[Window] = []
    for first, end in zip(starts, [*starts[1:], len(times)], strict=True):
        start = first
        while start + window <= end:
            found.append(Window(start, start + window, start + window - overlap, start > first))
            start += window - overlap
        if start < end:
            found.append(Window(start, end, end, start > first))
    return found


def frames_to_solve(
    times: Sequence[float],
    motions: FloatArray,
    chosen: tuple[int, int],
    *,
    window: int,
    overlap: int,
) -> tuple[int, int]:
    """Frames start..stop that give the chosen windows (first, stop) the results of the whole.

    That is one window more before them, whose last frames fade into theirs, and one frame after
    them, which tells whether a cut follows.
    """
    layout = window_layout(times, motions, window=window, overlap=overlap)
    first, stop = chosen
    needed = layout[first - layout[first].follows : stop]
    last = min(needed[-1].stop + 1, len(times))
    for item in reversed(layout[: first + 1 - layout[first].follows]):
        part = window_layout(
            times[item.start : last],
            motions[item.start : last - 1],
            window=window,
            overlap=overlap,
        )
        moved = {w._replace(start=w.start + item.start, stop=w.stop + item.start) for w in part}
        found = {(w.start, w.stop) for w in moved}
        if all((w.start, w.stop) in found for w in needed):
            return item.start, last
    return 0, len(times)


def _shots(times: FloatArray, motions: FloatArray) -> list[int]:
    """Indices of frames that start a shot, as `read_frames` marks them."""
    count = len(times)
    speeds = np.concatenate([[0.0], motions / np.diff(times), [0.0]])
    jumps = np.concatenate([[0.0], motions])
    return [
        k
        for k in range(count)
        if k == 0 or is_cut(speeds[k - 1], speeds[k], speeds[k + 1], jumps[k])
    ]
