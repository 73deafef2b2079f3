"""A clean window back towards its input, as far as it stays clean."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.temporal import apply_in_time, gaussian_kernel, spread_in_time
from dtrepair.repair.clip.mend_frames import mend_frames
from dtrepair.repair.clip.restore_shape import stretch
from dtrepair.repair.clip.window_state import Snapshot, SpaceTime

# Width in frames of the kernel of the displacement that pushing adds.
WIDTH = 3.5
# Part of the displacement that is taken back, its decay on failure, the push's step.
PULL_BACK, PULL_DECAY, PULL_STEP, PULL_SWEEPS = 0.2, 0.6, 0.003, 5
# What had to be pushed in the last cycle is taken back by this part less.
HELD = 0.85
# What is dirty then goes back within these rings, try by try, and as a bell of this width in time;
# from the second try on, frames that are still dirty are mended.
BACK_RINGS, BACK_WIDTH = (10, 20, 40), 2.0
BACK_MENDING, BACK_STEP = (1.0, 0.7, 0.0), 0.002
# Levels of folds fall by this in a cycle.
LEVEL_FALL = 0.8
# A cycle must lower the cost to this part; the cost counts jitter so many times the displacement.
PULL_GAIN, JITTER_WEIGHT, EDGE_WEIGHT = 0.995, 6.0, 0.25
# Part of the usual work on a window that is done before tightening.
BEFORE = 0.55


def tighten_frames(state: SpaceTime, cycles: int) -> None:
    """Take back displacement, less where the last cycle had to push; keep what is better."""
    kernel = gaussian_kernel(state.frames, WIDTH)
    best, value = state.snapshot(), _cost(state)
    needed = np.zeros(state.original.shape[:2])
    fraction, current = PULL_BACK, True
    for cycle in range(cycles):
        state.tell_progress(BEFORE + (1.0 - BEFORE) * cycle / cycles)
        kept = 1.0 - fraction * (1.0 - HELD * needed)[:, :, None]
        added = _pulled(state, best, kept, fraction / PULL_BACK, kernel)
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
    """Go back to the best state around what intersects, as far as needed; what is left is mended.

    All the way where even that fails.
    """
    now = state.snapshot()
    back = np.zeros(state.original.shape[:2], dtype=np.float32)
    for index, rings in enumerate(BACK_RINGS):
        for frame in state.dirty:
            np.maximum(back[frame], _around(state, frame, rings), out=back[frame])
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
        if index > 0:
            mend_frames(state, widths=BACK_MENDING, step=BACK_STEP, alone=False)
        if not state.dirty:
            return
    state.restore(best)


def _around(state: SpaceTime, frame: int, rings: int) -> FloatArray:
    """1 at the vertices (V,) within some rings of a frame's pairs, fading out over as many."""
    surface = state.surface
    away = surface.rings_from(surface.vertices_of(state.pairs[frame]), 2 * rings)
    part = np.minimum(2.0 - away / rings, 1.0)
    for body in surface.rigid.slices:
        part[body] = part[body].max()
    return part


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
