"""Parts of a clip for a farm: chunks K/N, whose layers join to what one run would have written."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.stages.frames import read_frame
from dtrepair.pipeline.stages.sources import Source, StageSource


@dataclass(frozen=True)
class Chunk:
    """Times (T,) of the frames to solve, and which of them (T,) are written."""

    times: NDArray[np.float64]
    written: NDArray[np.bool_]


def choose_chunk(source: Source, chunk: tuple[int, int] | None, *, alone: bool) -> Chunk:
    """The frames of a chunk; None is the whole.

    Frames that are repaired together are split between windows, and solved from one window before
    the chunk on: that one fades into its first frames.
    """
    if chunk is not None and not isinstance(source, StageSource):
        raise UsageError("--chunk: only for USD stages; leave it out")
    every = source.times
    if chunk is None:
        return Chunk(every, np.ones(len(every), dtype=bool))
    from dtrepair.repair.clip import window_stream
    from dtrepair.repair.clip.layout import frames_to_solve, motions_of, window_layout

    if alone or len(every) == 1:
        first, stop = _share(len(every), *chunk)
        return Chunk(every[first:stop], np.ones(stop - first, dtype=bool))
    times: list[float] = []

    def poses() -> Iterator[NDArray[Any]]:
        for time in every:
            frame = read_frame(source, float(time))
            if frame.usable:
                times.append(float(time))
                yield np.concatenate(frame.spaces)

    motions = motions_of(poses())
    clip = window_stream.ClipOptions()
    layout = window_layout(times, motions, options=clip)
    first, stop = _share(len(layout), *chunk)
    if first == stop:
        return Chunk(every[:0], np.zeros(0, dtype=bool))
    # Each window hands out the frames from where the one before it ended.
    ends = [-np.inf, *(times[window.end] for window in layout[:-1]), np.inf]
    start, last = frames_to_solve(times, motions, (first, stop), options=clip)
    low = min(times[start], ends[first]) if first == 0 else times[start]
    high = times[last] if last < len(times) else np.inf
    solved = (every >= low) & (every < high)
    chosen = every[solved]
    return Chunk(chosen, (chosen >= ends[first]) & (chosen < ends[stop]))


def empty_chunk_warnings(chunk: Chunk, text: str | None) -> list[str]:
    """A warning where a chunk has nothing to do."""
    if chunk.written.any():
        return []
    return [
        f"--chunk {text}: has no frames: there are more chunks than windows of frames that are "
        "solved together (60 frames, and ended by cuts); fewer chunks do as well"
    ]


def _share(count: int, number: int, of: int) -> tuple[int, int]:
    """The range of `count` things that share `number` (from 1) of `of` holds."""
    return count * (number - 1) // of, count * number // of
