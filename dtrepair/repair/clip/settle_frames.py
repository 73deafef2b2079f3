"""What is far from every contact goes back to where it was in all frames of a window."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.temporal import eased_in_time
from dtrepair.repair.clip.window_state import WindowState
from dtrepair.repair.full.settle import SettleOptions, Settling


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
    """

    strain: float = 0.15
    width: float = 2.0
    together: float = 4.0
    rings: tuple[int, ...] = (6, 12)
    settle: SettleOptions = field(default_factory=SettleOptions)


def settle_frames(
    state: WindowState, *, options: SettleFramesOptions = SettleFramesOptions()
) -> None:
    """Take back what is far from all contacts, smoothly in time, where no pair comes of it.

    Bodies that move freely lean on each other: they are left alone.
    """
    surface = state.surface
    if surface.clusters > 1 or not any(map(len, state.found)):
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
