"""All frames of a window pushed together: at once, or from every third one on."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.temporal import gaussian_kernel
from dtrepair.repair.clip.mend_frames import LendFramesOptions, is_hopeless
from dtrepair.repair.clip.window_state import WindowState


class Phase(NamedTuple):
    """Sweeps: the step in units of the size, how many, and the width in frames of what is added."""

    step: float
    sweeps: int
    width: float


@dataclass(frozen=True, kw_only=True)
class PushFramesOptions:
    """Numbers of the push of a window.

    Args:
        phases: Frames that stay dirty in a wide kernel get a narrower one: their neighbours stay
            clean.
        block: Sweeps are judged in blocks of this many: single ones go up and down.
        patience: After so many blocks in which no frame got better a phase ends.
        work: Fraction of the usual work on a window that pushing is, for the progress that is told.
    """

    phases: tuple[Phase, ...] = (Phase(0.01, 20, 3.5), Phase(0.006, 8, 1.75))
    block: int = 2
    patience: int = 3
    work: float = 0.4


@dataclass(frozen=True, kw_only=True)
class KeyWindowOptions:
    """Numbers of windows of single skins that are solved at keys first, and then in between.

    Contacts that stay for the whole window, as of thighs that walk, change little from frame to
    frame: what lies between two keys moves as they do, and is steadier than what was pushed.

    Args:
        stride: Every so many frames is a key.
        frames: Windows of fewer are solved as a whole.
        share: The keys that intersect are more than this share of them: contacts that come and go
            begin between keys.
        push: Numbers of the push of what is then left in all frames.
        agreement: See `RelaxFramesOptions`: of the keys, ...
        agreement_between: ... and of all frames.
    """

    stride: int = 3
    frames: int = 24
    share: float = 0.9
    push: PushFramesOptions = field(
        default_factory=lambda: PushFramesOptions(
            phases=(Phase(0.003, 10, 2.0), Phase(0.003, 8, 1.0))
        )
    )
    agreement: tuple[float, ...] = (0.5,) * 10 + (3.0,) * 2
    agreement_between: tuple[float, ...] = (0.5,) * 8 + (3.0,) * 3 + (8.0,) * 2


def push_frames(
    state: WindowState,
    *,
    lend: LendFramesOptions | None = None,
    options: PushFramesOptions = PushFramesOptions(),
) -> None:
    """Sweep in phases until all frames are clean; the state with the fewest pairs is kept.

    A phase goes on as long as any frame gets better, whatever the others do. lend: when the frames
    are better solved one from the other; None: never.
    """
    best = (state.remaining, state.snapshot())
    fewest = np.array([len(pairs) for pairs in state.pairs])
    swept, sweeps, hopeless = 0, sum(phase.sweeps for phase in options.phases), False
    for phase in options.phases:
        stalled = 0
        kernel = gaussian_kernel(state.frames, phase.width)
        for index in range(phase.sweeps):
            if not state.dirty:
                return
            state.sweep(kernel, phase.step)
            swept += 1
            state.tell_progress(options.work * swept / sweeps)
            if index % options.block != options.block - 1:
                continue
            counts = np.array([len(pairs) for pairs in state.pairs])
            stalled = 0 if (counts < fewest).any() else stalled + 1
            fewest = np.minimum(fewest, counts)
            if state.remaining < best[0]:
                best = (state.remaining, state.snapshot())
            hopeless = lend is not None and is_hopeless(state, swept, options=lend)
            if stalled == options.patience or hopeless:
                break
        if state.remaining > best[0]:
            state.restore(best[1])
        if hopeless:
            return


def keys_of(count: int, options: KeyWindowOptions) -> list[int]:
    """Return which of so many frames are keys; the first and the last are."""
    return sorted({*range(0, count, options.stride), count - 1})


def between_keys(
    original: FloatArray, times: FloatArray, keys: list[int], solved: FloatArray
) -> FloatArray:
    """Return poses (T, V, 3) at times (T,) that move as those solved (K, V, 3) at keys do.

    What two keys leave where it is stays there between them.
    """
    moved = solved - original[keys]
    result: FloatArray = original + CubicSpline(times[keys], moved)(times)
    still = (moved == 0.0).all(axis=2)
    held = still[:-1] & still[1:]
    for own, (first, last) in zip(held, pairwise(keys), strict=True):
        result[first + 1 : last, own] = original[first + 1 : last, own]
    result[keys] = solved
    return result
