"""Frames of a window that pushing left dirty, one by one."""

from __future__ import annotations

from dataclasses import dataclass

from dtrepair.numerics.temporal import gaussian_kernel
from dtrepair.repair.clip.frame_options import Chain
from dtrepair.repair.clip.window_state import WindowState


@dataclass(frozen=True, kw_only=True)
class MendFramesOptions:
    """Numbers of the mending of dirty frames.

    Args:
        widths: Over which the corrections of single frames are spread, frames, pass by pass: ever
            narrower, as a neighbour may be what makes a frame dirty.
        step: Largest motion in an iteration of the push, units of the size.
        lending: From this pass on frames may start from the displacements of clean frames around
            them, which change more than their own.
    """

    widths: tuple[float, ...] = (2.0, 2.0, 1.5, 1.5, 1.2, 1.2, 1.0, 1.0, 0.8, 0.8, 0.6, 0.0, 0.0)
    step: float = 0.004
    lending: int = 4


def mend_frames(
    state: WindowState,
    *,
    alone: bool = True,
    options: MendFramesOptions = MendFramesOptions(),
) -> None:
    """Solve frames that are still dirty one by one from this state, and spread it in time.

    Neighbouring frames are solved one after the other, forwards and backwards in turn. After some
    passes they may take the displacements of clean frames around them; with `alone` those that even
    then stay dirty are solved from their input.
    """
    widths = options.widths
    for index, width in enumerate(widths):
        if not state.dirty:
            return
        chains = _chains(state, backwards=index % 2 == 1, lend=index >= options.lending)
        last = alone and index == len(widths) - 1
        state.mend(chains, gaussian_kernel(state.frames, width), options.step, last=last)


def _chains(state: WindowState, *, backwards: bool, lend: bool) -> list[Chain]:
    """Return dirty frames, split where they are not neighbours: each chain is mended in order."""
    runs: list[list[int]] = []
    for frame in state.dirty:
        if runs and frame == runs[-1][-1] + 1:
            runs[-1].append(frame)
        else:
            runs.append([frame])
    clean = [frame for frame, pairs in enumerate(state.pairs) if not len(pairs)]
    chains = []
    for run in runs:
        around = [max((f for f in clean if f < run[0]), default=None)]
        around.append(min((f for f in clean if f > run[-1]), default=None))
        lenders = [frame for frame in around if frame is not None] if lend else []
        chains.append(Chain(run[::-1] if backwards else run, lenders))
    return chains
