"""A clean pose opened until its contacts keep a distance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.elastic.arap import Rigidity
from dtrepair.repair.elastic.gaps import Gaps
from dtrepair.repair.full.push import Limit, push
from dtrepair.repair.full.relax import step_with_gaps
from dtrepair.repair.surface.defects import Defects, find_defects
from dtrepair.repair.surface.surface import NEIGHBOUR_RINGS, Surface

# Cycles of opening gaps, how many without a gain end them, and what is asked for beside.
CYCLES, IDLE, MORE = 12, 3, 1.15
# One iteration of pushing moves by this part of the clearance.
STEP = 0.25
ITERATIONS, PATIENCE = 40, 8
# Attempts, each with a step of half the length.
ATTEMPTS = 3


def open_contacts(
    surface: Surface,
    points: FloatArray,
    clearance: float,
    *,
    limit: Limit = None,
    facing: bool = False,
) -> tuple[FloatArray, int]:
    """The pose with its contacts pushed `clearance` apart (units of the size), and what is left.

    Returns the number of pairs that are still closer; `facing`: see `Surface.close_pairs`. A pose
    that is not clean, or not better, is never taken: the input may not have the room.
    """

    def close(pose: FloatArray) -> IntArray:
        return surface.close_pairs(pose, clearance, facing=facing)

    folds = len(find_defects(surface, points).folds)
    points, left = _opened(surface, points, clearance, close, folds, limit)
    for attempt in range(ATTEMPTS):
        if left == 0:
            break
        opened = push(
            surface,
            points,
            near=NEIGHBOUR_RINGS,
            step=STEP * clearance * 0.5**attempt,
            iterations=ITERATIONS,
            patience=PATIENCE,
            limit=limit,
            detect=close,
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
) -> tuple[FloatArray, int]:
    """The best of some steps that keep the shape as rigid as possible and open narrow gaps."""
    pairs = close(points)
    best, left, idle = points, len(pairs), 0
    rigidity = Rigidity(surface, points)
    gaps = Gaps(surface, np.where(surface.stiff, 0.0, 1.0))
    pose = points
    for _ in range(CYCLES):
        if left == 0 or idle == IDLE:
            break
        gaps.add_defects(Defects(pairs, np.zeros((0, 2), dtype=np.int32)))
        gaps.soften()
        gaps.linearise(pose, clearance=MORE * clearance)
        trial = step_with_gaps(rigidity, rigidity.target(pose), gaps, pose)
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
