"""Clean frames relaxed towards the shapes of their inputs, all in step, smoothly in time.

Pushing takes whole limbs along and squeezes thin ones. What single poses get, as-rigid-as-possible
cycles between gaps that stay open, all frames of a window get in lockstep: the increments of a
cycle are smoothed in time and taken as far as each frame stays clean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.numerics.temporal import gaussian_kernel, spread_in_time
from dtrepair.repair.clip.window_state import WindowState
from dtrepair.repair.full.acceptance import reach_of
from dtrepair.repair.surface.surface import BoolArray, Surface


@dataclass(frozen=True, kw_only=True)
class RelaxFramesOptions:
    """Lockstep relaxation of a window.

    Args:
        cycles: Cycles at most.
        still: Relaxing ends when no vertex moves farther in a cycle, units of the size.
        width: Standard deviation, in frames, of the smoothing of the increments.
        spread: Standard deviation, in frames, over which the relaxed region comes and goes.
        faint: Vertices that would take part by less are left out.
        collapse: Edges shorter than this part of what they were, or longer than its inverse, are
            collapsed: around them any window is relaxed.
        collapsed: A frame with fewer such edges is left as it is.
        rings: Edge rings around collapsed edges that are relaxed; they fade over as many more.
    """

    cycles: int = 12
    still: float = 2e-4
    width: float = 1.5
    spread: float = 2.0
    faint: float = 0.05
    collapse: float = 0.25
    collapsed: int = 10
    rings: int = 10


def relax_frames(state: WindowState, *, options: RelaxFramesOptions = RelaxFramesOptions()) -> None:
    """Relax the clean frames of a window: wherever parts are attached, else where edges collapsed.

    A frame that still intersects stays as it is.
    """
    surface = state.surface
    poses = zip(state.original, state.poses, strict=True)
    reach = np.stack([_reach(surface, before, after, options) for before, after in poses])
    if not reach.any():
        return
    reach = np.maximum(reach, spread_in_time(state.frames, reach, options.spread))
    reach[(reach < options.faint) | surface.stiff] = 0.0
    frames = [
        frame for frame, pairs in enumerate(state.pairs) if len(pairs) == 0 and reach[frame].any()
    ]
    kernel = gaussian_kernel(state.frames, options.width)
    state.relax(frames, reach, kernel, cycles=options.cycles, still=options.still)


def _reach(
    surface: Surface, before: FloatArray, after: FloatArray, options: RelaxFramesOptions
) -> NDArray[np.float32]:
    """How far each vertex (V,) takes part, 0 to 1."""
    if surface.ties is not None:
        return reach_of(surface, after - before, rings=options.rings).astype(np.float32)
    collapsed, count = collapsed_vertices(surface, before, after, options.collapse)
    if count < options.collapsed:
        return np.zeros(surface.count, dtype=np.float32)
    away = surface.rings_from(collapsed, 2 * options.rings) / options.rings
    return np.clip(2.0 - away, 0.0, 1.0).astype(np.float32)


def collapsed_vertices(
    surface: Surface, before: FloatArray, after: FloatArray, collapse: float
) -> tuple[BoolArray, int]:
    """Ends (V,) of the edges whose length changed by more than a factor, and how many these are."""
    ends = surface.edges
    was = lengths(before[ends[:, 0]] - before[ends[:, 1]])
    now = lengths(after[ends[:, 0]] - after[ends[:, 1]])
    changed = (now < collapse * was) | (collapse * now > was)
    mask = np.zeros(surface.count, dtype=bool)
    mask[ends[changed].ravel()] = True
    return mask, int(changed.sum())
