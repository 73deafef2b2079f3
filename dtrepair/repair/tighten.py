"""Back towards the input: every step is accepted only if it is clean and closer."""

from __future__ import annotations

import numpy as np

from dtrepair.geometry import FloatArray
from dtrepair.metrics import displacements, edge_log_ratio
from dtrepair.repair.contact import Defects, find_defects, near_contacts, update_defects
from dtrepair.repair.crease import Filled, fill_creases, membrane_fill
from dtrepair.repair.push import push
from dtrepair.repair.rigidity import Rigidity
from dtrepair.repair.surface import BoolArray, Surface

# Weight of a pin inside the rigidity solve.
PIN = 10.0
# Pins fade by this factor in every cycle, and are gone below the last.
PIN_FADE, PIN_GONE = 0.5, 0.1
# Rings over which a step is rolled back around what it would make collide.
ROLLBACK_RINGS = 8
# Motions below this (units of the size) are left out, those up to twice this fade in: what does not
# move needs no new detection.
STILL = 1e-5
# Tightening reaches this many rings beyond what the repair has displaced, fading over half of them.
REACH_RINGS = 10
# Contacts within this many rings are creases: their surroundings follow, they are not pinned.
CREASE_RINGS = 12


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
    """Undo a fraction of the displacement, then push and fill what collides again."""
    known = find_defects(surface, points)
    current, best = points, distortion(surface, original, points)
    failures = 0
    for _ in range(cycles):
        trial = original + (1.0 - fraction) * (current - original)
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
        value = distortion(surface, original, trial)
        if _acceptable(defects, folds) and value < 0.995 * best:
            current, best, known = trial, value, defects
        else:
            failures += 1
            fraction, step = 0.5 * fraction, 0.6 * step
            if failures == 3:
                break
    return current


def relax(
    surface: Surface,
    original: FloatArray,
    points: FloatArray,
    *,
    cycles: int,
    folds: int,
    soften: bool,
    reach: FloatArray,
    tries: int = 2,
) -> FloatArray:
    """As-rigid-as-possible cycles towards the input's edges.

    `reach` (V,) scales the motion of each vertex. What would collide is pinned inside the solve;
    with `soften`, creases instead follow the membrane extension of the displacement around them.
    What still collides is rolled back locally.
    """
    rigidity = Rigidity(surface, original)
    known = find_defects(surface, points)
    current, best = points, distortion(surface, original, points)
    pins = np.zeros(surface.count)
    soft = np.zeros(surface.count, dtype=bool)
    rejected = 0
    for cycle in range(cycles):
        target = rigidity.target(current)
        attempt = _Attempt(surface, current, known, target, pins, soft, reach, folds)
        trial = attempt.run(rigidity, tries, soften)
        value = distortion(surface, original, trial) if trial is not None else np.inf
        if trial is not None and value < (0.997 if soften else 0.998) * best:
            current, best, known = trial, value, attempt.defects
            pins = np.where(attempt.pins > PIN_GONE, PIN_FADE * attempt.pins, 0.0)
            soft = attempt.soft if cycle % 3 else np.zeros_like(soft)
        else:
            rejected += 1
            pins, soft = attempt.pins, np.zeros_like(soft)
            if rejected == 2:
                break
    return current


class _Attempt:
    """One rigidity step and what it had to pin or soften to stay clean."""

    def __init__(
        self,
        surface: Surface,
        current: FloatArray,
        known: Defects,
        target: FloatArray,
        pins: FloatArray,
        soft: BoolArray,
        reach: FloatArray,
        folds: int,
    ) -> None:
        self.surface, self.current, self.target = surface, current, target
        self.known = self.defects = known
        self.pins, self.soft, self.reach, self.folds = pins, soft, reach, folds

    def run(self, rigidity: Rigidity, tries: int, soften: bool) -> FloatArray | None:
        """The clean pose of the step, or None."""
        for _ in range(tries):
            trial = rigidity.solve(self.target, PIN * self.pins, self.current)
            trial = without_still(self.current, self._softened(trial), self.reach)
            self.defects = changed_defects(self.surface, self.known, self.current, trial)
            if _acceptable(self.defects, self.folds):
                return trial
            self._learn(self.defects, soften)
        rolled = roll_back(
            self.surface, self.current, trial, self.known, self.defects, folds=self.folds
        )
        if rolled is None:
            return None
        self.defects = rolled.defects
        return rolled.points

    def _softened(self, trial: FloatArray) -> FloatArray:
        if not self.soft.any() or self.soft.mean() >= 0.5:
            return trial
        moved = membrane_fill(self.surface.uniform, trial - self.current, self.soft)
        return self.current + moved

    def _learn(self, defects: Defects, soften: bool) -> None:
        surface = self.surface
        pairs = np.concatenate([defects.crossings, defects.folds])
        creased = (
            near_contacts(surface, pairs, CREASE_RINGS)
            if soften
            else np.zeros(len(pairs), dtype=bool)
        )
        far = surface.dilate(surface.vertices_of(pairs[~creased]))
        self.pins = np.maximum(self.pins, far)
        near = surface.vertices_of(pairs[creased])
        again = surface.dilate(self.soft & surface.dilate(near, 3))
        self.soft = self.soft | again | surface.dilate(near, 2)


def roll_back(
    surface: Surface,
    current: FloatArray,
    trial: FloatArray,
    known: Defects,
    defects: Defects,
    *,
    folds: int,
    tries: int = 4,
) -> Filled | None:
    """The step from `current` to `trial` undone around what collides, fading over some rings.

    known: defects of `current`; defects: those of `trial`.
    """
    bad = np.zeros(surface.count, dtype=bool)
    for attempt in range(tries):
        bad |= surface.vertices_of(defects.triangles)
        rings = surface.rings_from(bad, ROLLBACK_RINGS + 2)
        kept = np.clip((rings - 1 - attempt) / ROLLBACK_RINGS, 0.0, 1.0)
        pose = current + kept[:, None] * (trial - current)
        defects = changed_defects(surface, known, current, pose)
        if _acceptable(defects, folds):
            return Filled(pose, defects)
    return None


def reach_of(surface: Surface, displacement: FloatArray) -> FloatArray:
    """Weight (V,) of tightening: 1 at and near what was displaced, 0 beyond and where stiff."""
    displaced = (displacement != 0).any(axis=1)
    rings = surface.rings_from(displaced, REACH_RINGS)
    return np.where(surface.stiff, 0.0, np.clip(2.0 - 2.0 * rings / REACH_RINGS, 0.0, 1.0))


def without_still(current: FloatArray, trial: FloatArray, reach: FloatArray) -> FloatArray:
    """The motion to `trial` scaled by `reach` (V,), and left out where it is below STILL."""
    motion = reach[:, None] * (trial - current)
    length = np.linalg.norm(motion, axis=1)
    kept = np.clip(length / STILL - 1.0, 0.0, 1.0)
    return np.where(kept[:, None] > 0, current + kept[:, None] * motion, current)


def changed_defects(
    surface: Surface, known: Defects, current: FloatArray, trial: FloatArray
) -> Defects:
    """Defects of `trial`, given those of `current`."""
    return update_defects(surface, known, trial, (trial != current).any(axis=1))


def _acceptable(defects: Defects, folds: int) -> bool:
    return len(defects.crossings) == 0 and len(defects.folds) <= folds
