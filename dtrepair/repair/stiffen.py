"""Bodies of a high diffusion move more as one piece: what bends them is taken back."""

from __future__ import annotations

import numpy as np

from dtrepair.geometry import FloatArray, IntArray
from dtrepair.metrics import edge_log_ratio
from dtrepair.repair.rigid import RigidBodies
from dtrepair.repair.spacetime import Snapshot, SpaceTime
from dtrepair.repair.timeline import gaussian_kernel, spread_in_time

# From this diffusion on a body of a scene is stiff.
STIFF = 300.0
# Part of the bending that is taken back at first, its decay where that failed, and cycles.
FRACTION, DECAY, CYCLES = 0.6, 0.4, 8
# What collides then is pushed in such steps over such a width; edges must gain this much.
STEP, SWEEPS, WIDTH, GAIN = 0.003, 8, 3.5, 0.97


def stiffen_frames(state: SpaceTime) -> None:
    """Take back what is no rigid motion of stiff bodies, push what collides, keep what is better.

    The displacement of a stiff body is split into the nearest rigid motion and the rest, its
    bending; a steep operator alone bends a body that should turn.
    """
    surface = state.surface
    ranges = [
        (body.start, body.stop)
        for body in surface.bodies
        if body.diffusion >= STIFF and not body.rigid and not surface.fixed[body.start]
    ]
    if len(surface.bodies) == 1 or not ranges or state.dirty:
        return
    whole = RigidBodies(ranges, surface.mass)
    edges = surface.edges[whole.mask[surface.edges[:, 0]]]
    best, value = state.snapshot(), _stretch(state, edges)
    kernel = gaussian_kernel(state.frames, WIDTH)
    fraction = np.full(len(state.frames), FRACTION)
    for _ in range(CYCLES):
        _unbent(state, best, whole, fraction)
        for _ in range(SWEEPS):
            if not state.dirty:
                break
            state.sweep(kernel, STEP)
        found = _stretch(state, edges)
        if not state.dirty and found < GAIN * value:
            best, value = state.snapshot(), found
            continue
        # Frames that stayed dirty, and those around them, ask for less; others may go on.
        failed = np.zeros((len(state.frames), 1), dtype=np.float32)
        failed[state.dirty or slice(None)] = 1.0
        spread = spread_in_time(state.frames, failed, WIDTH)[:, 0]
        fraction *= 1.0 - (1.0 - DECAY) * spread
        state.restore(best)


def _unbent(state: SpaceTime, best: Snapshot, whole: RigidBodies, fraction: FloatArray) -> None:
    """Set the state to the best one less fractions (T,) of what bends the bodies."""
    smooth = best.smooth.copy()
    for frame, (before, after) in enumerate(zip(state.original, state.poses, strict=True)):
        smooth[frame] -= fraction[frame] * (after - whole.fitted(before, after))
    state.restore(best._replace(smooth=smooth))


def _stretch(state: SpaceTime, edges: IntArray) -> float:
    """Root mean square over the frames of the change of the edges' lengths."""
    pairs = zip(state.original, state.poses, strict=True)
    squares = [edge_log_ratio(before, after, edges) ** 2 for before, after in pairs]
    return float(np.sqrt(np.mean(squares)))
