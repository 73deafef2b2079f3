"""Frames of a window that pushing left dirty: mended one by one, or solved from neighbours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.temporal import gaussian_kernel
from dtrepair.repair.clip.window_state import WindowState
from dtrepair.repair.frame.frame_options import Chain
from dtrepair.repair.frame.lending import Loan, disagreement
from dtrepair.repair.scene.bodies import STIFF
from dtrepair.repair.surface.surface import Surface


@dataclass(frozen=True, kw_only=True)
class MendFramesOptions:
    """Numbers of the mending of dirty frames.

    Args:
        widths: Over which the corrections of single frames are spread, frames, pass by pass: ever
            narrower, as a neighbour may be what makes a frame dirty.
        step: Largest motion in an iteration of the push, units of the size.
        lending: From this pass on frames may start from the displacements of clean frames around
            them, which change more than their own.
        work, work_a_triangle: No pass begins after so much work for each dirty frame, and so much
            for each triangle, times the effort (units of `numerics.work`).
    """

    widths: tuple[float, ...] = (2.0, 2.0, 1.5, 1.5, 1.2, 1.2, 1.0, 1.0, 0.8, 0.8, 0.6, 0.0, 0.0)
    step: float = 0.004
    lending: int = 4
    work: float = 2e6
    work_a_triangle: float = 60.0


def mend_frames(
    state: WindowState,
    *,
    alone: bool = True,
    effort: float = 1.0,
    options: MendFramesOptions = MendFramesOptions(),
) -> None:
    """Solve frames that are still dirty one by one from this state, and spread it in time.

    Neighbouring frames are solved one after the other, forwards and backwards in turn. After some
    passes they may take the displacements of clean frames around them; with `alone` those that even
    then stay dirty are solved from their input. effort: factor of the work after which it ends.
    """
    widths, work = options.widths, 0.0
    a_frame = options.work + options.work_a_triangle * len(state.surface.faces)
    enough = effort * a_frame * len(state.dirty)
    for index, width in enumerate(widths):
        if not state.dirty or work > enough:
            return
        chains = _chains(state, backwards=index % 2 == 1, lend=index >= options.lending)
        last = alone and index == len(widths) - 1
        work += state.mend(chains, gaussian_kernel(state.frames, width), options.step, last=last)


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


@dataclass(frozen=True, kw_only=True)
class LendFramesOptions:
    """When frames lend, and how often.

    Args:
        share: Of the frames that intersect, pushing left so many dirty: it squeezes there what it
            cannot lead apart, in its clean frames too.
        apart: Displacements of neighbours that differ by more, rms, units of the size, may be of
            two ways out: the one that distorts less is tried in both.
        rounds: Times that every second frame is looked at for that.
        nearer: Clothes whose push came clean are relaxed all the same, where they then move by less
            than this part of it on average.
        stiff: Diffusion from which on a body is stiff.
        hopeless, hopeless_after: Pushing ends where after so many sweeps more than this share is
            dirty: little of it would come clean.
    """

    share: float = 0.2
    apart: float = 0.004
    rounds: int = 4
    nearer: float = 0.7
    stiff: float = STIFF
    hopeless: float = 0.5
    hopeless_after: int = 14


def is_stuck(state: WindowState, *, options: LendFramesOptions = LendFramesOptions()) -> bool:
    """Return whether pushing failed in too many frames to be mended one by one.

    Stiff bodies, which turn as wholes, are no better off alone, nor are attached parts.
    """
    return _lends(state.surface, options) and dirty_share(state.pairs, state.found) > options.share


def lend_nearer(state: WindowState, *, options: LendFramesOptions = LendFramesOptions()) -> bool:
    """Relax frames of open layers over bodies as after a stuck push; return whether that is kept.

    Pushing leads clothes along as wholes. What does not end clearly nearer to the input, as hair
    that nothing pulls back, stays as it was pushed.
    """
    surface = state.surface
    clothes = surface.covering is not None and surface.clusters > 1
    if not (clothes and _lends(surface, options)) or surface.direction is not None:
        return False
    pushed, moved = state.snapshot(), _moved(state)
    if moved == 0.0:
        return False
    lend_frames(state, options=options)
    if state.dirty or _moved(state) > options.nearer * moved:
        state.restore(pushed)
        return False
    return True


def _lends(surface: Surface, options: LendFramesOptions) -> bool:
    """Return whether frames may be solved each for itself."""
    soft = not any(body.rigid or body.diffusion >= options.stiff for body in surface.bodies)
    return surface.ties is None and (surface.clusters == 1 or soft)


def _moved(state: WindowState) -> float:
    """Return how far vertices are from the input on average, units of the size."""
    return float(np.linalg.norm(state.poses - state.original, axis=2).mean())


def is_hopeless(state: WindowState, sweeps: int, *, options: LendFramesOptions) -> bool:
    """Return whether so many sweeps of pushing left so much that the others would not help."""
    share = dirty_share(state.pairs, state.found)
    late = sweeps >= options.hopeless_after and share > options.hopeless
    return late and is_stuck(state, options=options)


def dirty_share(left: Sequence[IntArray], met: Sequence[IntArray]) -> float:
    """Return the share of the frames with pairs (K, 2) in the input that have some left."""
    dirty, before = (sum(len(pairs) > 0 for pairs in own) for own in (left, met))
    return dirty / max(before, 1)


def lend_frames(state: WindowState, *, options: LendFramesOptions = LendFramesOptions()) -> None:
    """Relax the clean frames each for itself; solve the others from their displacements, inwards.

    Frames that still intersect then stay as they are. A frame whose displacement differs from a
    neighbour's that distorts less is solved from there again, and keeps what distorts less.
    """
    costs, lent = state.relax_alone(), set[tuple[int, int, float]]()
    while (waiting := np.isnan(costs)).any():
        loans = []
        for frame in np.flatnonzero(waiting).tolist():
            lenders = [k for k in (frame - 1, frame + 1) if 0 <= k < len(costs)]
            solved = [k for k in lenders if not waiting[k]]
            if solved:
                lender = min(solved, key=lambda k: float(costs[k]))
                loans.append(Loan(frame, lender, np.inf))
        if not loans:
            # No frame is clean: the one with the fewest pairs begins, from its own input.
            frame = int(np.argmin([len(pairs) for pairs in state.found]))
            loans = [Loan(frame, frame, np.inf)]
        _lend(state, loans, costs, lent)
    for index in range(options.rounds):
        _lend(state, _disputed(state, costs, index % 2, options), costs, lent)


def _lend(
    state: WindowState, loans: list[Loan], costs: FloatArray, lent: set[tuple[int, int, float]]
) -> None:
    """Make the loans that were not made before; change `costs` (T,) and `lent`.

    lent: frame, lender and what the lender cost, of each loan made: its pose changes with its cost.
    """
    keys = [(loan.frame, loan.lender, float(costs[loan.lender])) for loan in loans]
    state.lend([loan for loan, key in zip(loans, keys, strict=True) if key not in lent], costs)
    lent.update(keys)


def _disputed(
    state: WindowState, costs: FloatArray, parity: int, options: LendFramesOptions
) -> list[Loan]:
    """Return loans to frames of a parity from neighbours that distort less, by another way."""
    moved, loans = state.poses - state.original, []
    for frame in range(parity, len(costs), 2):
        lenders = [k for k in (frame - 1, frame + 1) if 0 <= k < len(costs)]
        lender = min(lenders, key=lambda k: float(costs[k]), default=frame)
        cheaper = costs[lender] < costs[frame]
        if cheaper and disagreement(moved[lender], moved[frame]) > options.apart:
            loans.append(Loan(frame, lender, float(costs[frame])))
    return loans
