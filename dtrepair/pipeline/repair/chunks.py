"""Parts of a clip for a farm: chunks K/N, whose layers join to what one run would have written."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray
from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.stages.frames import read_frame
from dtrepair.pipeline.stages.sources import Source, StageSource

if TYPE_CHECKING:
    from dtrepair.repair.clip.layout import Window

Times = NDArray[np.float64]


@dataclass(frozen=True)
class Chunk:
    """Times (T,) of the frames to solve, and which of them (T,) are written."""

    times: Times
    written: NDArray[np.bool_]


def choose_chunk(source: Source, chunk: tuple[int, int] | None, *, alone: bool) -> Chunk:
    """The frames of a chunk; None is the whole.

    Frames that are repaired together are split between windows, or evenly where there are fewer
    windows than chunks. A chunk solves every window of which it writes a frame, and the one before:
    that one fades into its first frames.
    """
    if chunk is not None and not isinstance(source, StageSource):
        raise UsageError("--chunk: only for USD stages; leave it out")
    every = source.times
    if chunk is None:
        return Chunk(every, np.ones(len(every), dtype=bool))
    if alone or len(every) == 1:
        own = every[slice(*_share(len(every), *chunk))]
        return Chunk(own, np.ones(len(own), dtype=bool))
    times, motions = _read(source)
    layout = _layout(times, motions)
    if len(layout) < chunk[1]:
        own = every[slice(*_share(len(every), *chunk))]
    else:
        first, stop = _share(len(layout), *chunk)
        # Each window hands out the frames from where the one before it ended.
        ends = [-np.inf, *(times[window.end] for window in layout[:-1]), np.inf]
        own = every[(every >= ends[first]) & (every < ends[stop])]
    return _chunk_of(every, own, times, motions)


def worthwhile_chunks(source: Source, most: int, *, alone: bool) -> int:
    """How many of at most so many chunks have no window in common."""
    if alone:
        return min(most, len(source.times))
    return max(1, min(most, len(_layout(*_read(source)))))


def empty_chunk_warnings(chunk: Chunk, text: str | None) -> list[str]:
    """A warning where a chunk has nothing to do."""
    if chunk.written.any():
        return []
    return [
        f"--chunk {text}: has no frames: there are more chunks than frames; fewer chunks do as well"
    ]


def _read(source: Source) -> tuple[list[float], FloatArray]:
    """The times (T,) of the usable frames, and the motions (T - 1,) between them."""
    from dtrepair.repair.clip.layout import motions_of

    times: list[float] = []

    def poses() -> Iterator[NDArray[Any]]:
        for time in source.times:
            frame = read_frame(source, float(time))
            if frame.usable:
                times.append(float(time))
                yield np.concatenate(
                    [
                        np.full(own.shape, np.nan) if index in frame.hidden else own
                        for index, own in enumerate(frame.spaces)
                    ]
                )

    motions = motions_of(poses())
    return times, motions


def _layout(times: list[float], motions: FloatArray) -> list[Window]:
    from dtrepair.repair.clip import clip_options
    from dtrepair.repair.clip.layout import window_layout

    return window_layout(times, motions, options=clip_options.ClipOptions())


def _chunk_of(every: Times, own: Times, times: list[float], motions: FloatArray) -> Chunk:
    """The frames that must be solved for `own` ones to get what the whole gives them.

    times, motions: of the usable frames among `every`.
    """
    from dtrepair.repair.clip import clip_options
    from dtrepair.repair.clip.layout import frames_to_solve

    first, stop = np.searchsorted(times, own[:1]), np.searchsorted(times, own[-1:], side="right")
    if not (first < stop).any():
        return Chunk(own, np.ones(len(own), dtype=bool))
    ends = [window.end for window in _layout(times, motions)]
    one, other = np.searchsorted(ends, [first[0], stop[0] - 1], side="right").tolist()
    options = clip_options.ClipOptions()
    start, last = frames_to_solve(times, motions, (one, other + 1), options=options)
    if last - start == 1:  # a frame after a cut: alone it would be solved as a single pose
        start = max(start - 1, 0)
    low = min(times[start], own[0])
    high = times[last] if last < len(times) else np.inf
    solved = every[(every >= low) & (every < high)]
    return Chunk(solved, (solved >= own[0]) & (solved <= own[-1]))


def _share(count: int, number: int, of: int) -> tuple[int, int]:
    """The range of `count` things that share `number` (from 1) of `of` holds."""
    return count * (number - 1) // of, count * number // of
