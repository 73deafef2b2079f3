"""Frames back to their shapes: what pushing bent, stretched or squeezed in a clip is taken back.

Bodies of a scene are unbent as wholes. Single skins, attached parts and what collapsed get what
single poses get, as-rigid-as-possible cycles between gaps that stay open, in lockstep: each frame
is pulled to where its neighbours ask it to be as well, so that it accelerates little.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray, lengths
from dtrepair.numerics.metrics import edge_log_ratio
from dtrepair.numerics.temporal import gaussian_kernel, spread_in_time
from dtrepair.repair.clip.window_state import Snapshot, WindowState
from dtrepair.repair.full.acceptance import reach_of
from dtrepair.repair.full.method import FullOptions
from dtrepair.repair.scene.bodies import STIFF
from dtrepair.repair.surface.rigid_bodies import RigidBodies
from dtrepair.repair.surface.surface import BoolArray, Surface


@dataclass(frozen=True, kw_only=True)
class RestoreShapeOptions:
    """Numbers of the way back to the shapes of bodies.

    Args:
        stiff: Diffusion from which on a body is stiff: all of it moves together.
        fraction: Of the bending that a cycle takes back at first.
        decay: Factor of the fraction around frames where that failed.
        cycles: At most so many where a body is stiff, ...
        soft_cycles: ... and where none is: they gain little.
        little: Change of the edges of soft bodies that is left alone, rms of the logarithms of
            their ratios.
        least: A smaller fraction is not worth a cycle.
        step: Largest motion in a sweep that pushes what collides then, units of the size.
        sweeps: At most so many.
        width: Of the kernel of what they add, frames.
        gain: A cycle must lower the change of the edges to this fraction to be taken.
    """

    stiff: float = STIFF
    fraction: float = 0.6
    decay: float = 0.4
    cycles: int = 8
    soft_cycles: int = 3
    little: float = 0.015
    least: float = 0.1
    step: float = 0.003
    sweeps: int = 8
    width: float = 3.5
    gain: float = 0.97


def restore_shapes(
    state: WindowState, *, options: RestoreShapeOptions = RestoreShapeOptions()
) -> None:
    """Take back what deforms bodies, push what collides, keep what is better.

    The displacement of a stiff body is split into the nearest rigid motion and the rest, its
    bending: a steep operator alone bends a body that should turn. That of a soft one is split into
    an even part and the rest, which stretches the sides of thin layers.
    """
    surface = state.surface
    # Tied bodies were relaxed together already.
    if len(surface.bodies) == 1 or state.dirty or surface.ties is not None:
        return
    stiff = [
        (body.start, body.stop)
        for body in surface.bodies
        if body.diffusion >= options.stiff and not body.rigid
    ]
    whole = RigidBodies(stiff, surface.mass)
    edges = surface.edges[~surface.stiff[surface.edges[:, 0]]]
    best, value = state.snapshot(), stretch(state, edges)
    kernel = gaussian_kernel(state.frames, options.width)
    fraction = np.full(len(state.frames), options.fraction)
    for _ in range(options.cycles if stiff else options.soft_cycles):
        if (not stiff and value < options.little) or fraction.max() < options.least:
            break
        _unbent(state, best, whole, fraction)
        for _ in range(options.sweeps):
            if not state.dirty:
                break
            state.sweep(kernel, options.step)
        changed = stretch(state, edges)
        gained = changed < options.gain * value
        if not state.dirty and gained:
            best, value = state.snapshot(), changed
            continue
        if not stiff and not gained:
            # What is pushed again stretches soft bodies as much as what was taken back.
            state.restore(best)
            return
        # Frames that stayed dirty, and those around them, ask for less; others may go on.
        failed = np.zeros((len(state.frames), 1), dtype=np.float32)
        failed[state.dirty or slice(None)] = 1.0
        spread = spread_in_time(state.frames, failed, options.width)[:, 0]
        fraction *= 1.0 - (1.0 - options.decay) * spread
        state.restore(best)


def _unbent(state: WindowState, best: Snapshot, whole: RigidBodies, fraction: FloatArray) -> None:
    """Set the state to the best one less fractions (T,) of what bends the bodies."""
    smooth = best.smooth.copy()
    for frame, (before, after) in enumerate(zip(state.original, state.poses, strict=True)):
        even = before + state.surface.evened(after - before)
        even[whole.mask] = whole.fitted(before, after)[whole.mask]
        even[state.surface.fixed] = after[state.surface.fixed]
        smooth[frame] -= fraction[frame] * (after - even)
    state.restore(best._replace(smooth=smooth))


def stretch(state: WindowState, edges: IntArray) -> float:
    """Return the root mean square over the frames of the logarithms of the edges' length ratios."""
    pairs = zip(state.original, state.poses, strict=True)
    squares = [edge_log_ratio(before, after, edges) ** 2 for before, after in pairs]
    return float(np.sqrt(np.mean(squares)))


@dataclass(frozen=True, kw_only=True)
class RelaxFramesOptions:
    """Lockstep relaxation of a window.

    Args:
        agreement: For each cycle, the weight, next to the edges, by which frames are pulled to
            where their neighbours ask them to be: little first, as it holds them back, then more.
        attached: The same where parts are attached, whose frames were solved each for itself: they
            have farther to go.
        lifted: The same where layers were lifted and no frame was solved for itself: lifts were
            smooth in time, and what is left of them has to be.
        attached_work: Fractions of the usual work on such a window that are done before and after,
            for the progress that is told.
        still: Relaxing ends when no vertex moves farther in a cycle, units of the size.
        width: Standard deviation, in frames, of the smoothing of what cures.
        spread: Standard deviation, in frames, over which the relaxed region comes and goes.
        faint: Vertices that would take part by less are left out.
        collapse: Edges shorter than this part of what they were, or longer than its inverse, are
            collapsed.
        collapsed, collapsed_share: More such edges in a frame, and more than this share of all,
            have it relaxed around them, or cured: it would be strained.
        left_attached: Frames of attached parts that keep so many pairs take part as well.
        rings: Edge rings around collapsed edges that are relaxed; they fade over as many more.
    """

    agreement: tuple[float, ...] = (0.5,) * 6 + (3.0,) * 4
    attached: tuple[float, ...] = (0.1,) * 8 + (1.0,) * 4
    lifted: tuple[float, ...] = (3.0,) * 6 + (10.0,) * 6
    attached_work: tuple[float, float] = (0.35, 0.95)
    still: float = 2e-4
    width: float = 1.5
    spread: float = 2.0
    faint: float = 0.05
    collapse: float = 0.25
    collapsed: int = 5
    collapsed_share: float = 5e-4
    left_attached: int = FullOptions.left_attached
    rings: int = 10


def relax_frames(
    state: WindowState,
    *,
    alone: bool = False,
    lifted: bool = False,
    options: RelaxFramesOptions = RelaxFramesOptions(),
) -> None:
    """Relax the clean frames of a window wherever they were displaced.

    A frame that still intersects stays as it is, but for `left_attached`. Bodies that move freely
    and meet lean on each other: of them only what collapsed is relaxed, unless each frame was
    solved alone, or layers were lifted, some of them farther than their frames need.
    """
    surface = state.surface
    poses = zip(state.original, state.poses, strict=True)
    reached = _near_collapsed if state.leaning and not (alone or lifted) else _displaced
    reach = np.stack([reached(surface, before, after, options) for before, after in poses])
    if not reach.any():
        return
    reach = np.maximum(reach, spread_in_time(state.frames, reach, options.spread))
    reach[(reach < options.faint) | surface.stiff] = 0.0
    frames = [frame for frame in _nearly_clean(state, options) if reach[frame].any()]
    tied = surface.ties is not None
    if tied:
        agreement = options.attached
    else:
        agreement = options.lifted if lifted and not alone else options.agreement
    state.relax(
        frames,
        reach,
        agreement,
        still=options.still,
        spread=options.spread,
        # Other windows have been tightened before, which tells as much.
        work=options.attached_work if tied else None,
    )


def cure_frames(state: WindowState, *, options: RelaxFramesOptions = RelaxFramesOptions()) -> None:
    """Bring crushed edges back in the nearly clean frames of a window that have too many."""
    surface, frames = state.surface, []
    for frame in _nearly_clean(state, options):
        before, after = state.original[frame], state.poses[frame]
        if collapsed_vertices(surface, before, after, options.collapse)[1] > options.collapsed:
            frames.append(frame)
    if frames:
        state.cure(frames, gaussian_kernel(state.frames, options.width))


def _nearly_clean(state: WindowState, options: RelaxFramesOptions) -> list[int]:
    """Return the clean frames, and of attached parts those that keep few pairs."""
    most = 0 if state.surface.ties is None else options.left_attached
    return [frame for frame, pairs in enumerate(state.pairs) if len(pairs) <= most]


def _displaced(
    surface: Surface, before: FloatArray, after: FloatArray, options: RelaxFramesOptions
) -> NDArray[np.float32]:
    """Return how far each vertex (V,) takes part, 0 to 1: those near displaced ones."""
    return reach_of(surface, after - before, rings=options.rings).astype(np.float32)


def _near_collapsed(
    surface: Surface, before: FloatArray, after: FloatArray, options: RelaxFramesOptions
) -> NDArray[np.float32]:
    """Return how far each vertex (V,) takes part, 0 to 1: those near too many collapsed edges."""
    collapsed, count = collapsed_vertices(surface, before, after, options.collapse)
    if count <= max(options.collapsed, options.collapsed_share * len(surface.edges)):
        return np.zeros(surface.count, dtype=np.float32)
    away = surface.rings_from(collapsed, 2 * options.rings) / options.rings
    return np.clip(2.0 - away, 0.0, 1.0).astype(np.float32)


def collapsed_vertices(
    surface: Surface, before: FloatArray, after: FloatArray, collapse: float
) -> tuple[BoolArray, int]:
    """Return ends (V,) of edges whose length changed by more than a factor, and their number."""
    ends = surface.edges
    was = lengths(before[ends[:, 0]] - before[ends[:, 1]])
    now = lengths(after[ends[:, 0]] - after[ends[:, 1]])
    changed = (now < collapse * was) | (collapse * now > was)
    mask = np.zeros(surface.count, dtype=bool)
    mask[ends[changed].ravel()] = True
    return mask, int(changed.sum())
