"""Bodies of a scene keep their shape: what bends or stretches them in a clip is taken back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.metrics import edge_log_ratio
from dtrepair.numerics.temporal import gaussian_kernel, spread_in_time
from dtrepair.repair.clip.window_state import Snapshot, WindowState
from dtrepair.repair.scene.bodies import STIFF
from dtrepair.repair.surface.rigid_bodies import RigidBodies


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
    """Root mean square over the frames of the logarithms of the edges' length ratios."""
    pairs = zip(state.original, state.poses, strict=True)
    squares = [edge_log_ratio(before, after, edges) ** 2 for before, after in pairs]
    return float(np.sqrt(np.mean(squares)))
