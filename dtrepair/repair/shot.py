"""The stages of a window of frames: space-time push, mending, tightening, easing out."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dtrepair.geometry import FloatArray
from dtrepair.repair.crew import Crew
from dtrepair.repair.spacetime import Snapshot, SpaceTime
from dtrepair.repair.stiffen import stiffen_frames, stretch
from dtrepair.repair.surface import Surface
from dtrepair.repair.timeline import (
    apply_in_time,
    gaussian_kernel,
    second_differences,
    spread_in_time,
    steady_weights,
)
from dtrepair.repair.window_frames import Alone, Chain

# Width of the kernel of the displacement, in frames.
WIDTH = 3.5
# Sweeps are judged in blocks of this many; after so many blocks without progress a phase ends.
BLOCK, PATIENCE = 2, 3
# Widths in frames over which the corrections of single frames are spread, pass by pass.
MENDING = (2.0, 2.0, 1.5, 1.5, 1.2, 1.2, 1.0, 1.0, 0.8, 0.8, 0.6, 0.0, 0.0)
MEND_STEP = 0.004
# From this pass on frames may start from the displacements of clean frames around them.
LENDING = 4
# Frames with a larger root mean square second difference (units of the size) are steadied.
ROUGH, STEADY_ROUNDS, STEADY_STEP = 1.5e-3, 6, 0.002
# As long as a round lowers their roughness to this part.
STEADY_GAIN = 0.97
# The same after a cycle of tightening, of at most this part of the frames.
TIGHT_MENDING, TIGHT_MEND_STEP, TIGHT_DIRTY = (1.0, 0.7, 0.0), 0.002, 0.2
# Tightening: part of the displacement that is taken back, its decay on failure, the push's step.
PULL_BACK, PULL_DECAY, PULL_STEP, PULL_SWEEPS = 0.2, 0.6, 0.003, 5
# What had to be pushed in the last cycle is taken back by this part less.
HELD = 0.85
# Frames that tightening leaves dirty take their neighbours back with them, as bells of this width.
BACK_WIDTH, BACK_TRIES = 2.0, 4
# Levels of folds fall by this in a cycle.
LEVEL_FALL = 0.8
# A cycle must lower the cost to this part; the cost counts jitter so many times the displacement.
PULL_GAIN, JITTER_WEIGHT, EDGE_WEIGHT = 0.995, 6.0, 0.25
# Displacements below this (units of the size) are left out; up to twice this they fade in. Around
# what that would close they come back, fading out over these rings, try by try.
STILL, EASE_RINGS = 1e-4, (3, 6)
# Parts of the usual work on a window that are done after pushing, and before tightening.
PUSHED, MENDED = 0.4, 0.55


class Phase(NamedTuple):
    """Sweeps: the step in units of the size, how many, and the width in frames of what is added."""

    step: float
    sweeps: int
    width: float


# Frames that stay dirty in the wide kernel get a narrower one: their neighbours stay clean.
PHASES = (Phase(0.01, 20, WIDTH), Phase(0.006, 8, 0.5 * WIDTH))
SWEEPS = sum(phase.sweeps for phase in PHASES)


class ShotMethod:
    """Repairs windows of frames of one surface, in units of its size."""

    def __init__(
        self,
        surface: Surface,
        alone: Alone,
        *,
        tighten: int = 3,
        farthest: float | None = None,
        clearance: float = 0.0,
    ) -> None:
        """Use `alone` (surface, pose) for frames that stay dirty; `tighten` cycles at most.

        farthest: no vertex moves farther; clearance: what contacts keep where they can.
        """
        self.surface, self.alone, self.tighten = surface, alone, tighten
        self.farthest, self.clearance = farthest, clearance

    def __call__(
        self,
        original: FloatArray,
        frames: FloatArray,
        crew: Crew,
        *,
        unless: Callable[[], bool] | None = None,
    ) -> FloatArray | None:
        """Repaired poses (T, V, 3) of poses at times in frame units; dirty where none was found.

        unless: asked where pushing leaves frames dirty; None is returned if it says so.
        """
        state = SpaceTime(
            self.surface,
            original,
            frames,
            crew,
            alone=self.alone,
            farthest=self.farthest,
            clearance=self.clearance,
        )
        if not state.dirty:
            return original
        push(state)
        if state.dirty and unless is not None and unless():
            return None
        state.forget_clearance()
        mend_frames(state)
        steady_frames(state)
        state.given_up = frozenset(state.dirty)
        # Tightening would close a clearance again.
        if self.clearance == 0.0:
            tighten_frames(state, self.tighten)
            stiffen_frames(state)
        return eased(state)


def push(state: SpaceTime) -> None:
    """Sweeps in phases until all frames are clean; the state with the fewest pairs is kept.

    A phase goes on as long as any frame gets better, whatever the others do.
    """
    best = (state.remaining, state.snapshot())
    fewest = np.array([len(pairs) for pairs in state.pairs])
    swept = 0
    for phase in PHASES:
        stalled = 0
        kernel = gaussian_kernel(state.frames, phase.width)
        for index in range(phase.sweeps):
            if not state.dirty:
                return
            state.sweep(kernel, phase.step)
            swept += 1
            state.tell_progress(PUSHED * swept / SWEEPS)
            if index % BLOCK != BLOCK - 1:
                continue
            counts = np.array([len(pairs) for pairs in state.pairs])
            stalled = 0 if (counts < fewest).any() else stalled + 1
            fewest = np.minimum(fewest, counts)
            if state.remaining < best[0]:
                best = (state.remaining, state.snapshot())
            if stalled == PATIENCE:
                break
        if state.remaining > best[0]:
            state.restore(best[1])


def mend_frames(
    state: SpaceTime,
    *,
    widths: tuple[float, ...] = MENDING,
    step: float = MEND_STEP,
    alone: bool = True,
) -> None:
    """Frames still dirty: the solver of single frames from this state, spread in time.

    Neighbouring frames are solved one after the other, forwards and backwards in turn. After some
    passes they may take the displacements of clean frames around them; those that even then stay
    dirty are solved alone.
    """
    for index, width in enumerate(widths):
        if not state.dirty:
            return
        chains = _chains(state, backwards=index % 2 == 1, lend=index >= LENDING)
        last = alone and index == len(widths) - 1
        state.mend(chains, gaussian_kernel(state.frames, width), step, last=last)


def steady_frames(state: SpaceTime) -> None:
    """Frames that stand out from their neighbours go where these ask them to be, if still clean."""
    if len(state.frames) < 3:
        return
    weights, differences = steady_weights(state.frames), second_differences(state.frames)

    def roughness() -> FloatArray:
        second = apply_in_time(differences, state.poses - state.original)
        return np.sqrt((second**2).sum(axis=2).mean(axis=1))

    now = roughness()
    for _ in range(STEADY_ROUNDS):
        before = np.linalg.norm(now)
        for colour in range(3):
            rough = np.zeros(len(state.frames), dtype=bool)
            rough[1:-1] = now > ROUGH
            rough[:-1] |= rough[1:]
            rough[1:] |= rough[:-1]
            frames = np.flatnonzero(rough)
            frames = frames[frames % 3 == colour]
            if len(frames) and state.steady(frames.tolist(), weights, STEADY_STEP):
                now = roughness()
        if np.linalg.norm(now) > STEADY_GAIN * before:
            break


def tighten_frames(state: SpaceTime, cycles: int) -> None:
    """Take back displacement, less where the last cycle had to push; keep what is better."""
    kernel = gaussian_kernel(state.frames, WIDTH)
    best, value = state.snapshot(), _cost(state)
    needed = np.zeros(state.original.shape[:2])
    fraction, current = PULL_BACK, True
    for cycle in range(cycles):
        state.tell_progress(MENDED + (1.0 - MENDED) * cycle / cycles)
        kept = 1.0 - fraction * (1.0 - HELD * needed)[:, :, None]
        added = _pulled(state, best, kept, fraction / PULL_BACK, kernel)
        if 0 < len(state.dirty) <= max(2, TIGHT_DIRTY * len(state.original)):
            mend_frames(state, widths=TIGHT_MENDING, step=TIGHT_MEND_STEP, alone=False)
        if state.dirty:
            _blend_back(state, best)
        taken = np.linalg.norm(best.smooth * (1.0 - kept), axis=2)
        floor = 1e-3 * taken.max(initial=0.0) + 1e-30
        pushed = np.linalg.norm(added, axis=2) / np.maximum(taken, floor)
        pushed = apply_in_time(kernel, np.clip(pushed, 0.0, 1.0))
        cost = _cost(state)
        current = not state.dirty and cost < PULL_GAIN * value
        if current:
            best, value = state.snapshot(), cost
            needed = np.maximum(0.7 * needed, pushed)
        else:
            fraction *= PULL_DECAY
            needed = np.maximum(needed, pushed)
    if not current:
        state.restore(best)


def _pulled(
    state: SpaceTime, best: Snapshot, kept: FloatArray, fall: float, kernel: FloatArray
) -> FloatArray:
    """Start from a part of the best state and push what collides; what the push added (T, V, 3)."""
    fallen = np.maximum(best.fold_hits - np.float32(LEVEL_FALL * fall), np.float32(0.0))
    start = best._replace(smooth=best.smooth * kept, extra=best.extra * kept, fold_hits=fallen)
    state.restore(start)
    added = np.zeros_like(state.original)
    for _ in range(PULL_SWEEPS):
        if not state.dirty:
            break
        added += state.sweep(kernel, PULL_STEP)
    return added


def _blend_back(state: SpaceTime, best: Snapshot) -> None:
    """Go back to the best state in dirty frames, smoothly in time; all the way if that fails."""
    now = state.snapshot()
    back = np.zeros((len(state.frames), 1), dtype=np.float32)
    for _ in range(BACK_TRIES):
        back[state.dirty] = 1.0
        back = np.maximum(back, spread_in_time(state.frames, back, BACK_WIDTH))
        part = back[:, :, None].astype(np.float64)
        mixed = Snapshot(
            now.smooth + part * (best.smooth - now.smooth),
            now.extra + part * (best.extra - now.extra),
            now.fold_hits + back * (best.fold_hits - now.fold_hits),
            now.close_hits + back * (best.close_hits - now.close_hits),
            now.springs,
        )
        state.restore(mixed)
        if not state.dirty:
            return
    state.restore(best)


def _cost(state: SpaceTime) -> float:
    """What tightening lowers: mean displacement and rms second difference, weighted; and edges."""
    moved = state.poses - state.original
    second = np.diff(moved, 2, axis=0)
    jitter = float(np.sqrt((second**2).sum(axis=2).mean())) if len(second) else 0.0
    cost = float(np.linalg.norm(moved, axis=2).mean()) + JITTER_WEIGHT * jitter
    if len(state.surface.bodies) > 1:
        # Of several bodies one may move much and another be stretched thin.
        cost += EDGE_WEIGHT * stretch(state, state.surface.edges)
    return cost


def eased(state: SpaceTime) -> FloatArray:
    """Poses with the faintest displacements taken out, except around what that would close.

    What is far from all contacts keeps every bit; displacements fade in over the surface and time.
    """
    moved = state.poses - state.original
    length = np.linalg.norm(moved, axis=2)
    for body in state.surface.rigid.slices:
        length[:, body] = length[:, body].max(axis=1, keepdims=True)
    kept = np.clip(length / STILL - 1.0, 0.0, 1.0)
    asked = np.flatnonzero((kept < np.minimum(length, 1.0)).any(axis=1)).tolist()
    for rings in (*EASE_RINGS, None):
        part = kept[:, :, None]
        result = np.where(part > 0, state.original + part * moved, state.original)
        result = np.where(part < 1, result, state.poses)
        found = dict(zip(asked, state.pairs_of(result, asked), strict=True))
        asked = [f for f, pairs in found.items() if len(pairs) > len(state.pairs[f])]
        if not asked or rings is None:
            break
        for frame in asked:
            closed = state.surface.vertices_of(found[frame])
            away = state.surface.rings_from(closed, 2 * rings) / rings - 1.0
            kept[frame] = np.where(length[frame] > 0, np.maximum(kept[frame], 1.0 - away), 0.0)
            kept[frame] = np.minimum(kept[frame], 1.0)
            for body in state.surface.rigid.slices:
                kept[frame, body] = kept[frame, body].max()
    result[asked] = state.poses[asked]
    return result


def _chains(state: SpaceTime, *, backwards: bool, lend: bool) -> list[Chain]:
    """Dirty frames split where they are not neighbours: each chain is mended in order."""
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
