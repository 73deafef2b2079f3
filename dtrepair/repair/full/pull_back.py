"""Back towards the input: every step is accepted only if it is clean and closer."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.geometry import FloatArray, differing, lengths
from dtrepair.numerics.metrics import displacements, edge_log_ratio
from dtrepair.repair.full.biharmonic_fill import Filled, fill_creases
from dtrepair.repair.full.push import push
from dtrepair.repair.surface.defects import Defects, find_defects, update_defects
from dtrepair.repair.surface.surface import BoolArray, Surface

# Rings over which a step is rolled back around what it would make collide.
ROLLBACK_RINGS = 8
# Motions below this (units of the size) are left out, those up to twice this fade in: what does not
# move needs no new detection.
STILL = 1e-5
# Tightening reaches this many rings beyond what the repair has displaced, fading over half of them.
REACH_RINGS = 10


def distortion(surface: Surface, original: FloatArray, points: FloatArray) -> float:
    """What tightening lowers: edge log-ratio rms + 2 x mean displacement over the diagonal."""
    moved = float(displacements(original, points).mean())
    return edge_log_ratio(original, points, surface.edges) + 2.0 * moved


def pull_back(
    surface: Surface,
    original: FloatArray,
    points: FloatArray,
    *,
    near: int,
    fraction: float,
    folds: int,
    cycles: int = 1,
    step: float = 0.004,
) -> FloatArray:
    """Undo a fraction of the displacement, then push and fill what collides again.

    Of several bodies those that cross all the same stay where they were, and try half of it next.
    """
    known = find_defects(surface, points)
    current, best = points, distortion(surface, original, points)
    failures, part = 0, np.full(len(surface.bodies), fraction)
    for _ in range(cycles):
        kept = 1.0 - part[surface.body_of_vertex]
        trial = original + kept[:, None] * (current - original)
        trial = surface.rigid.fitted(original, trial)
        defects = changed_defects(surface, known, current, trial)
        if len(defects.crossings):
            pushed = push(
                surface,
                trial,
                near=near,
                step=step,
                iterations=12,
                patience=4,
                known_pairs=defects.crossings,
            )
            trial = pushed.points
            moved = changed_defects(surface, known, current, trial)
            trial, defects = fill_creases(surface, trial, rounds=5, known=moved)
        trial, defects, back = _put_back(surface, known, current, trial, defects)
        value = distortion(surface, original, trial)
        if acceptable(defects, folds) and value < 0.995 * best:
            current, best, known = trial, value, defects
            part[back] *= 0.5
        else:
            failures += 1
            part, step = 0.5 * part, 0.6 * step
            if failures == 3:
                break
    return current


def _put_back(
    surface: Surface, known: Defects, current: FloatArray, trial: FloatArray, defects: Defects
) -> tuple[FloatArray, Defects, BoolArray]:
    """The trial with each body that crosses one back at the clean `current`; which are back (B,).

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


def roll_back(
    surface: Surface,
    current: FloatArray,
    trial: FloatArray,
    defects: Defects,
    *,
    folds: int,
    tries: int = 4,
) -> Filled | None:
    """The step from `current` to `trial` undone around its `defects`, fading over some rings."""
    bad = np.zeros(surface.count, dtype=bool)
    known = defects
    for attempt in range(tries):
        bad |= surface.vertices_of(defects.triangles)
        rings = surface.rings_from(bad, ROLLBACK_RINGS + 2)
        kept = np.clip((rings - 1 - attempt) / ROLLBACK_RINGS, 0.0, 1.0)
        pose = current + kept[:, None] * (trial - current)
        defects = changed_defects(surface, known, trial, pose)
        if acceptable(defects, folds):
            return Filled(pose, defects)
    return None


def reach_of(surface: Surface, displacement: FloatArray) -> FloatArray:
    """Weight (V,) of tightening: 1 at and near what was displaced, 0 beyond and where stiff."""
    displaced = (displacement != 0).any(axis=1)
    rings = surface.rings_from(displaced, REACH_RINGS)
    return np.where(surface.stiff, 0.0, np.clip(2.0 - 2.0 * rings / REACH_RINGS, 0.0, 1.0))


def without_still(current: FloatArray, trial: FloatArray) -> FloatArray:
    """The trial with its motion left out where that is below STILL."""
    motion = trial - current
    length = lengths(motion)
    kept = np.clip(length / STILL - 1.0, 0.0, 1.0)
    return np.where(kept[:, None] > 0, current + kept[:, None] * motion, current)


def changed_defects(
    surface: Surface, known: Defects, current: FloatArray, trial: FloatArray
) -> Defects:
    """Defects of `trial`, given those of `current`."""
    return update_defects(surface, known, trial, differing(trial, current))


def acceptable(defects: Defects, folds: int) -> bool:
    """Whether a pose is clean and has no more folds than allowed."""
    return len(defects.crossings) == 0 and len(defects.folds) <= folds
