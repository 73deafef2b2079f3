"""Bodies of a scene keep their shape: what bends or stretches them in a clip is taken back."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.metrics import edge_log_ratio
from dtrepair.numerics.temporal import gaussian_kernel, spread_in_time
from dtrepair.repair.clip.window_state import Snapshot, SpaceTime
from dtrepair.repair.scene.bodies import STIFF
from dtrepair.repair.surface.rigid_bodies import RigidBodies

# Part of the bending that is taken back at first, its decay where that failed, and cycles.
FRACTION, DECAY, CYCLES, SOFT_CYCLES = 0.6, 0.4, 8, 3
# Edges of soft bodies that changed by less are left alone; a smaller part is not worth a cycle.
LITTLE, LEAST = 0.015, 0.1
# What collides then is pushed in such steps over such a width; edges must gain this much.
STEP, SWEEPS, WIDTH, GAIN = 0.003, 8, 3.5, 0.97


def stiffen_frames(state: SpaceTime) -> None:
    """Take back what deforms bodies, push what collides, keep what is better.

    The displacement of a stiff body is split into the nearest rigid motion and the rest, its
    bending: a steep operator alone bends a body that should turn. That of a soft one is split into
    an even part and the rest, which stretches the sides of thin layers.
    """
    surface = state.surface
    if len(surface.bodies) == 1 or state.dirty:
        return
    stiff = [
        (body.start, body.stop)
        for body in surface.bodies
        if body.diffusion >= STIFF and not body.rigid
    ]
    whole = RigidBodies(stiff, surface.mass)
    edges = surface.edges[~surface.stiff[surface.edges[:, 0]]]
    best, value = state.snapshot(), stretch(state, edges)
    kernel = gaussian_kernel(state.frames, WIDTH)
    fraction = np.full(len(state.frames), FRACTION)
    for _ in range(CYCLES if stiff else SOFT_CYCLES):
        if (not stiff and value < LITTLE) or fraction.max() < LEAST:
            break
        _unbent(state, best, whole, fraction)
        for _ in range(SWEEPS):
            if not state.dirty:
                break
            state.sweep(kernel, STEP)
        found = stretch(state, edges)
        if not state.dirty and found < GAIN * value:
            best, value = state.snapshot(), found
            continue
        if not stiff and found >= GAIN * value:
            # What is pushed again stretches soft bodies as much as what was taken back.
            state.restore(best)
            return
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
        even = before + state.surface.evened(after - before)
        even[whole.mask] = whole.fitted(before, after)[whole.mask]
        even[state.surface.fixed] = after[state.surface.fixed]
        smooth[frame] -= fraction[frame] * (after - even)
    state.restore(best._replace(smooth=smooth))


def stretch(state: SpaceTime, edges: IntArray) -> float:
    """Root mean square over the frames of the logarithms of the edges' length ratios."""
    pairs = zip(state.original, state.poses, strict=True)
    squares = [edge_log_ratio(before, after, edges) ** 2 for before, after in pairs]
    return float(np.sqrt(np.mean(squares)))
