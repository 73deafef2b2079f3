"""Back towards the input: every step is accepted only if it is clean and closer."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import distortion
from dtrepair.repair.full.acceptance import acceptable, changed_defects
from dtrepair.repair.full.biharmonic_fill import Filled, FillOptions, biharmonic_fill
from dtrepair.repair.full.push import PushOptions, push
from dtrepair.repair.surface.defects import Defects, find_defects
from dtrepair.repair.surface.surface import BoolArray, Surface


@dataclass(frozen=True, kw_only=True)
class PullBackOptions:
    """Numbers of the way back that takes bodies as a whole.

    Args:
        fraction: Of the displacement that a cycle undoes.
        decay: Factor of the fraction, of all bodies where a cycle failed, else of those that stayed
            where they were.
        step: Largest motion in an iteration of the push, units of the size.
        step_decay: Factor of the step where a cycle failed.
        gain: A cycle must lower the distortion to this fraction to be taken.
        failures: So many cycles that failed end it.
        push: What separates what collides; few iterations, as little does.
        fill: What closes the creases then; few rounds, or it undoes more than it brings back.
    """

    fraction: float = 0.35
    decay: float = 0.5
    step: float = 0.004
    step_decay: float = 0.6
    gain: float = 0.995
    failures: int = 3
    push: PushOptions = field(default_factory=lambda: PushOptions(iterations=12, patience=4))
    fill: FillOptions = field(default_factory=lambda: FillOptions(rounds=5))


def pull_back(
    surface: Surface,
    original: FloatArray,
    points: FloatArray,
    *,
    near: int,
    folds: int,
    cycles: int = 1,
    scale: float = 1.0,
    options: PullBackOptions = PullBackOptions(),
) -> FloatArray:
    """Return the pose (V, 3) with fractions of its displacement undone as long as it is clean.

    What collides is pushed and filled. Of several bodies those that cross all the same stay where
    they were, and try half of it next. near: rings of a crease; folds: so many are allowed;
    cycles: at most; scale: factor of the step (see `contact_scale`).
    """
    known = find_defects(surface, points)
    current, best = points, distortion(original, points, surface.edges)
    step, failures = options.step * scale, 0
    fraction = np.full(len(surface.bodies), options.fraction)
    for _ in range(cycles):
        kept = 1.0 - fraction[surface.body_of_vertex]
        trial = original + kept[:, None] * (current - original)
        trial = surface.rigid.fitted(original, trial)
        trial, defects = _separated(surface, known, current, trial, near, step, options)
        trial, defects, back = _put_back(surface, known, current, trial, defects)
        value = distortion(original, trial, surface.edges)
        if acceptable(defects, folds) and value < options.gain * best:
            current, best, known = trial, value, defects
            fraction[back] *= options.decay
        else:
            failures += 1
            fraction, step = options.decay * fraction, options.step_decay * step
            if failures == options.failures:
                break
    return current


def _separated(
    surface: Surface,
    known: Defects,
    current: FloatArray,
    trial: FloatArray,
    near: int,
    step: float,
    options: PullBackOptions,
) -> Filled:
    """Return the trial with what collides in it pushed and filled, and its defects."""
    defects = changed_defects(surface, known, current, trial)
    if len(defects.crossings) == 0:
        return Filled(trial, defects)
    pushed = push(
        surface,
        trial,
        near=near,
        step=step,
        known_pairs=defects.crossings,
        options=options.push,
    )
    moved = changed_defects(surface, known, current, pushed.points)
    return biharmonic_fill(surface, pushed.points, known=moved, options=options.fill)


def _put_back(
    surface: Surface, known: Defects, current: FloatArray, trial: FloatArray, defects: Defects
) -> tuple[FloatArray, Defects, BoolArray]:
    """Return the trial with bodies that cross put back at the clean `current`; which are (B,).

    A single body stays where it is.
    """
    back = np.zeros(len(surface.bodies), dtype=bool)
    pose = trial
    while len(defects.crossings) and len(back) > 1:
        # Bodies that are back do not cross each other: each round puts another one back.
        back[surface.body_of[defects.crossings]] = True
        pose = np.where(back[surface.body_of_vertex][:, None], current, trial)
        defects = changed_defects(surface, known, current, pose)
    return pose, defects, back
