"""A clean pose opened until its contacts keep a distance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.elastic.arap import ArapSystem
from dtrepair.repair.elastic.contact_step import ContactStepOptions, step_with_gaps
from dtrepair.repair.elastic.gaps import GapOptions, Gaps
from dtrepair.repair.full.push import Limit, PushOptions, push
from dtrepair.repair.surface.defects import Defects, find_defects
from dtrepair.repair.surface.surface import Surface


@dataclass(frozen=True, kw_only=True)
class ClearanceOptions:
    """Numbers of the opening of contacts to a clearance.

    Args:
        cycles: Most elastic steps that open gaps.
        idle: So many steps without a gain end them.
        aim: Width that gaps are to have, times the clearance: linear gaps fall a little short.
        attempts: Of pushing what is left, each with a step of half the length.
        step: Largest motion in an iteration of the push, times the clearance.
        gaps: Numbers of the gaps.
        solve: The elastic step.
        push: The push, which has many short steps to make.
    """

    cycles: int = 12
    idle: int = 3
    aim: float = 1.15
    attempts: int = 3
    step: float = 0.25
    gaps: GapOptions = field(default_factory=GapOptions)
    solve: ContactStepOptions = field(default_factory=ContactStepOptions)
    push: PushOptions = field(default_factory=lambda: PushOptions(iterations=40, patience=8))


def open_contacts(
    surface: Surface,
    points: FloatArray,
    clearance: float,
    *,
    limit: Limit = None,
    facing: bool = False,
    options: ClearanceOptions = ClearanceOptions(),
) -> tuple[FloatArray, int]:
    """Return the pose with its contacts `clearance` apart (units of the size), and what is left.

    Returns the number of pairs that are still closer; `facing`: see `Contacts.close_pairs`. A pose
    that is not clean, or not better, is never taken: the input may not have the room.
    """

    def close(pose: FloatArray) -> IntArray:
        return surface.contacts.close_pairs(pose, clearance, facing=facing)

    folds = len(find_defects(surface, points).folds)
    points, left = _opened(surface, points, clearance, close, folds, limit, options)
    for attempt in range(options.attempts):
        if left == 0:
            break
        opened = push(
            surface,
            points,
            near=surface.options.neighbour_rings,
            step=options.step * clearance * 0.5**attempt,
            limit=limit,
            detect=close,
            options=options.push,
        )
        defects = find_defects(surface, opened.points)
        if len(defects.crossings) == 0 and len(defects.folds) <= folds:
            if len(opened.pairs) < left:
                points, left = opened.points, len(opened.pairs)
    return points, left


def _opened(
    surface: Surface,
    points: FloatArray,
    clearance: float,
    close: Callable[[FloatArray], IntArray],
    folds: int,
    limit: Limit,
    options: ClearanceOptions,
) -> tuple[FloatArray, int]:
    """Return the best of some as-rigid-as-possible steps that open narrow gaps."""
    pairs = close(points)
    best, left, idle = points, len(pairs), 0
    if left == 0:
        return points, 0
    system = ArapSystem(surface, points)
    gaps = Gaps(surface, np.where(surface.stiff, 0.0, 1.0), options=options.gaps)
    pose = points
    for _ in range(options.cycles):
        if left == 0 or idle == options.idle:
            break
        gaps.add_defects(Defects(pairs, np.zeros((0, 2), dtype=np.int32)))
        gaps.soften()
        gaps.linearise(pose, clearance=options.aim * clearance)
        trial = step_with_gaps(system, system.target(pose), gaps, pose, options=options.solve)
        trial = np.where(surface.stiff[:, None], pose, trial)
        trial = trial if limit is None else limit(trial)
        defects = find_defects(surface, trial)
        if len(defects.crossings) or len(defects.folds) > folds:
            gaps.add_defects(defects)
            idle += 1
            continue
        pose, pairs = trial, close(trial)
        idle = 0 if len(pairs) < left else idle + 1
        if len(pairs) < left:
            best, left = pose, len(pairs)
    return best, left
