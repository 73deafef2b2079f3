"""A clean window back towards its input, as far as it stays clean."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.temporal import (
    apply_in_time,
    eased_in_time,
    gaussian_kernel,
    spread_in_time,
)
from dtrepair.repair.clip.mend_frames import MendFramesOptions, mend_frames
from dtrepair.repair.clip.restore_shape import stretch
from dtrepair.repair.clip.window_state import Snapshot, WindowState
from dtrepair.repair.full.settle import (
    CommonShiftOptions,
    SettleOptions,
    Settling,
    shifted_back,
)


@dataclass(frozen=True, kw_only=True)
class TightenOptions:
    """Numbers of the tightening of a window.

    Args:
        fraction: Of the displacement that a cycle takes back.
        decay: Factor of the fraction where a cycle failed.
        held: What had to be pushed in the last cycle is taken back by this fraction less.
        forget: Factor by which that fades from cycle to cycle where no push was needed again.
        level_fall: Levels of folds fall by so much in a cycle, as less is to be faired.
        step: Largest motion in a sweep that pushes what collides then, units of the size.
        sweeps: At most so many.
        width: Of the kernel of what they add, frames: as smooth as what the first phase pushed.
        back_rings: Around what is dirty then, the window goes back within so many rings, try by
            try ...
        back_width: ... and as a bell of this width in time, frames.
        back_mend: From the second try on, frames that are still dirty are mended.
        gain: A cycle must lower the cost to this fraction to be taken.
        jitter_weight: What jitter costs, next to displacement: it is what is seen first.
        edge_weight: What the change of edges costs where there are several bodies: one may move
            much and another be stretched thin.
        work_before: Fraction of the usual work on a window that is done before tightening, for the
            progress that is told.
    """

    fraction: float = 0.2
    decay: float = 0.6
    held: float = 0.85
    forget: float = 0.7
    level_fall: float = 0.8
    step: float = 0.003
    sweeps: int = 5
    width: float = 3.5
    back_rings: tuple[int, ...] = (10, 20, 40)
    back_width: float = 2.0
    back_mend: MendFramesOptions = field(
        default_factory=lambda: MendFramesOptions(widths=(1.0, 0.7, 0.0), step=0.002)
    )
    gain: float = 0.995
    jitter_weight: float = 6.0
    edge_weight: float = 0.25
    work_before: float = 0.55


def tighten_frames(
    state: WindowState, cycles: int, *, options: TightenOptions = TightenOptions()
) -> None:
    """Take back displacement, less where the last cycle had to push; keep what is better."""
    kernel = gaussian_kernel(state.frames, options.width)
    best, value = state.snapshot(), _cost(state, options)
    needed = np.zeros(state.original.shape[:2])
    fraction, current = options.fraction, True
    for cycle in range(cycles):
        before = options.work_before
        state.tell_progress(before + (1.0 - before) * cycle / cycles)
        kept = 1.0 - fraction * (1.0 - options.held * needed)[:, :, None]
        fall = options.level_fall * (fraction / options.fraction)
        added = _pulled(state, best, kept, fall, kernel, options)
        if state.dirty:
            _blend_back(state, best, options)
        taken = np.linalg.norm(best.smooth * (1.0 - kept), axis=2)
        floor = 1e-3 * taken.max(initial=0.0) + 1e-30
        pushed = np.linalg.norm(added, axis=2) / np.maximum(taken, floor)
        pushed = apply_in_time(kernel, np.clip(pushed, 0.0, 1.0))
        cost = _cost(state, options)
        current = not state.dirty and cost < options.gain * value
        if current:
            best, value = state.snapshot(), cost
            needed = np.maximum(options.forget * needed, pushed)
        else:
            fraction *= options.decay
            needed = np.maximum(needed, pushed)
    if not current:
        state.restore(best)


def _pulled(
    state: WindowState,
    best: Snapshot,
    kept: FloatArray,
    fall: float,
    kernel: FloatArray,
    options: TightenOptions,
) -> FloatArray:
    """Push what collides in a fraction of the best state; what the push added (T, V, 3)."""
    fallen = np.maximum(best.fold_hits - np.float32(fall), np.float32(0.0))
    start = best._replace(smooth=best.smooth * kept, extra=best.extra * kept, fold_hits=fallen)
    state.restore(start)
    added = np.zeros_like(state.original)
    for _ in range(options.sweeps):
        if not state.dirty:
            break
        added += state.sweep(kernel, options.step)
    return added


def _blend_back(state: WindowState, best: Snapshot, options: TightenOptions) -> None:
    """Go back to the best state around what intersects, as far as needed; what is left is mended.

    All the way where even that fails.
    """
    now = state.snapshot()
    back = np.zeros(state.original.shape[:2], dtype=np.float32)
    for index, rings in enumerate(options.back_rings):
        for frame in state.dirty:
            np.maximum(back[frame], _around(state, frame, rings), out=back[frame])
        back = np.maximum(back, spread_in_time(state.frames, back, options.back_width))
        weight = back[:, :, None].astype(np.float64)
        mixed = Snapshot(
            now.smooth + weight * (best.smooth - now.smooth),
            now.extra + weight * (best.extra - now.extra),
            now.fold_hits + back * (best.fold_hits - now.fold_hits),
            now.close_hits + back * (best.close_hits - now.close_hits),
            now.springs,
        )
        state.restore(mixed)
        if index > 0:
            mend_frames(state, alone=False, options=options.back_mend)
        if not state.dirty:
            return
    state.restore(best)


def _around(state: WindowState, frame: int, rings: int) -> FloatArray:
    """Return 1 at vertices (V,) within some rings of a frame's pairs, fading over as many."""
    surface = state.surface
    away = surface.rings_from(surface.vertices_of(state.pairs[frame]), 2 * rings)
    weight = np.minimum(2.0 - away / rings, 1.0)
    for body in surface.rigid.slices:
        weight[body] = weight[body].max()
    return weight


def _cost(state: WindowState, options: TightenOptions) -> float:
    """Return what tightening lowers: displacement, second difference and edges, weighted."""
    moved = state.poses - state.original
    second = np.diff(moved, 2, axis=0)
    jitter = float(np.sqrt((second**2).sum(axis=2).mean())) if len(second) else 0.0
    cost = float(np.linalg.norm(moved, axis=2).mean()) + options.jitter_weight * jitter
    if len(state.surface.bodies) > 1:
        cost += options.edge_weight * stretch(state, state.surface.edges)
    return cost


@dataclass(frozen=True, kw_only=True)
class SettleFramesOptions:
    """Numbers of the settling of a window.

    Args:
        strain: By which what is far from all contacts may go back: less than in single poses, as
            nothing evens it out.
        width: Frames over which what goes back in one frame and not in another fades.
        together: Frames before and after whose contacts count as well.
        rings: Around what that closes displacements come back, fading out over so many rings, try
            by try; then in the whole frame.
        settle: What is far, and how displacements fade.
        shift: Which shifts of all that moves go back.
    """

    strain: float = 0.15
    width: float = 2.0
    together: float = 4.0
    rings: tuple[int, ...] = (6, 12)
    settle: SettleOptions = field(default_factory=SettleOptions)
    shift: CommonShiftOptions = field(default_factory=CommonShiftOptions)


def shift_frames_back(
    state: WindowState, *, options: SettleFramesOptions = SettleFramesOptions()
) -> None:
    """Take back by what all that moves was shifted, smoothly in time, where no pair comes of it.

    Not where no vertex may go farther than a limit: those that moved against the shift would.
    """
    if state.work.farthest is not None or not any(map(len, state.found)):
        return
    poses = shifted_back(
        state.surface,
        state.original,
        state.poses,
        (state.found, state.pairs),
        state.pairs_of,
        eased=lambda needed: eased_in_time(needed, state.frames, options.width),
        options=options.shift,
    )
    if poses is not state.poses:
        state.work.extra += poses - state.poses
        state.evaluate()


def settle_frames(
    state: WindowState, *, options: SettleFramesOptions = SettleFramesOptions()
) -> None:
    """Take back what is far from all contacts, smoothly in time, where no pair comes of it.

    Bodies that move freely and meet lean on each other: they are left alone.
    """
    surface = state.surface
    if state.leaning or not any(map(len, state.found)):
        return
    moved, pairs = state.poses - state.original, state.pairs
    needed = np.stack([_needed(state, frame, options) for frame in range(len(moved))])
    for rings in (*options.rings, None):
        kept = eased_in_time(needed, state.frames, options.width)
        if (kept == 1.0).all():
            return
        settled = np.where(kept[:, :, None] > 0.0, state.original + kept[:, :, None] * moved, 0.0)
        settled = np.where(kept[:, :, None] > 0.0, settled, state.original)
        changed = np.flatnonzero((settled != state.poses).any(axis=(1, 2))).tolist()
        found = dict(zip(changed, state.pairs_of(settled, changed), strict=True))
        closed = [frame for frame in changed if len(found[frame]) > len(pairs[frame])]
        if not closed:
            state.work.extra += settled - state.poses
            state.evaluate()
            return
        for frame in closed:
            near = np.ones(surface.count)
            if rings is not None:
                away = surface.rings_from(surface.vertices_of(found[frame]), 2 * rings)
                near = np.clip(2.0 - away / rings, 0.0, 1.0)
            needed[frame] = np.maximum(needed[frame], near)


def _needed(state: WindowState, frame: int, options: SettleFramesOptions) -> FloatArray:
    """Return the fraction (V,) of a frame's displacements that it needs itself."""
    apart = np.abs(state.frames - state.frames[frame])
    met = np.flatnonzero([len(pairs) > 0 for pairs in state.found])
    near = met[apart[met] <= max(options.together, apart[met].min())]
    triangles = np.concatenate([state.found[other].ravel() for other in near])
    settling = Settling(state.surface, state.original[frame], triangles, options=options.settle)
    return settling.kept(state.poses[frame], options.strain)
