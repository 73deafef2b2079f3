"""As-rigid-as-possible steps towards the input that stop where surfaces meet."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.repair.elastic.arap import Rigidity
from dtrepair.repair.elastic.gaps import Gaps
from dtrepair.repair.elastic.volume_pressure import Inflation
from dtrepair.repair.full.biharmonic_fill import Filled
from dtrepair.repair.full.pull_back import (
    acceptable,
    changed_defects,
    distortion,
    roll_back,
    without_still,
)
from dtrepair.repair.full.push import PILE
from dtrepair.repair.surface.defects import find_defects
from dtrepair.repair.surface.surface import Surface

# No vertex moves farther in a cycle (units of the size); gaps are sought within twice that.
STEP = 0.01
# Bodies of a pile go as a whole rather than bend: they take steps that are longer by this factor.
LONGER = 2.0
# A cycle that could not be made clean shortens the following ones.
SHORTER = 0.7
# Solves of a cycle, each with the gaps that the one before closed.
TRIES = 5
# Rounds of the augmented Lagrangian, iterations of each, and what part of the error ends them.
ROUNDS, ITERATIONS, PRECISION = 3, 60, 5e-3
# One round is enough where at most this part of the gaps is new: the other forces are known.
FEW = 0.1
# Gaps that a first solve leaves wider than this many margins are of no concern.
CONCERN = 6e-4
# Relaxing ends when the distortion fell by less than this over so many cycles.
ENOUGH, STALLED = 0.002, 3
# It also ends when so many cycles in a row could not be made clean.
FAILURES = 3
# What missing volume counts next to the distortion; as long as more than this part is missing,
# relaxing goes on for up to so many times its cycles.
VOLUME, MISSING, MORE = 0.3, 0.01, 2


def relax(
    surface: Surface,
    original: FloatArray,
    points: FloatArray,
    *,
    cycles: int,
    folds: int,
    reach: FloatArray,
    step: float = STEP,
) -> tuple[FloatArray, int]:
    """The pose of least distortion between a clean pose and its original, and the cycles spent.

    Each cycle is an as-rigid-as-possible step towards the original's edges (Sorkine & Alexa 2007)
    of at most `step`, under the condition that no gap between surfaces closes: contact forces push
    both sides, so they come to rest against each other. What collides all the same is rolled back
    locally. Cycles may double to bring volume back. `reach` (V,) scales the motion of each vertex;
    `folds` are allowed.
    """
    if not reach.any():
        return points, 0
    state = _Relaxation(surface, original, points, folds, reach, step)
    history = [state.best[0]]
    for cycle in range(MORE * cycles):
        state.cycle()
        history.append(state.best[0])
        if state.failures == FAILURES:
            break
        if state.inflation.lost(state.points) > MISSING:
            continue
        if cycle + 1 >= cycles:
            break
        if cycle >= STALLED and history[-1 - STALLED] - history[-1] < ENOUGH:
            break
    return state.best[1], len(history) - 1


class _Relaxation:
    """A clean pose on its way back, its gaps, and the best pose so far."""

    def __init__(
        self,
        surface: Surface,
        original: FloatArray,
        points: FloatArray,
        folds: int,
        reach: FloatArray,
        step: float,
    ) -> None:
        self.surface, self.original = surface, original
        self.points, self.known = points, find_defects(surface, points)
        self.folds, self.reach = folds, reach
        self._starts = [body.start for body in surface.bodies]
        self.pile = np.count_nonzero(np.maximum.reduceat(reach, self._starts)) >= PILE
        self.step = LONGER * step if self.pile else step
        self.rigidity = Rigidity(surface, original, region=reach > 0)
        self.gaps = Gaps(surface, reach)
        self.inflation = Inflation(surface, original, reach)
        self.best = self._value(), points
        self.failures, self._pull = 0, np.zeros(surface.count)

    def cycle(self) -> None:
        """One step; the pose stays where it is if it cannot be made clean."""
        right = self._right_hand_side()
        self._find_gaps(right)
        found = self._solved(right)
        if found is None:
            self.failures += 1
            self.step *= SHORTER
            self.gaps.forces *= 0.5
            return
        self.points, self.known = found
        self.failures = 0
        value = self._value()
        if value < self.best[0]:
            self.best = value, self.points

    def _value(self) -> float:
        """Distortion and missing volume: what relaxing lowers."""
        lost = self.inflation.lost(self.points)
        return distortion(self.surface, self.original, self.points) + VOLUME * lost

    def _right_hand_side(self) -> FloatArray:
        """That of the step, shortened such that no vertex moves too far without contacts."""
        points = self.points
        full = self.rigidity.target(points) + self.inflation.force(
            points, self._pull, self.rigidity.solve
        )
        present = self.rigidity.image(points)
        free = self.rigidity.solve(full - present)
        pull = self._part_of(self.reach[:, None] * free)
        if self._pull.any():
            self.gaps.scale(pull / self._pull)
        self._pull = pull
        return present + pull[:, None] * (full - present)

    def _find_gaps(self, right: FloatArray) -> None:
        """Gaps that matter to the step: those with forces and those it would close."""
        gaps = self.gaps
        gaps.soften()
        facing = gaps.add_facing(self.points, self.inflation.areas(self.points), 2.0 * self.step)
        gaps.linearise(self.points)
        first = step_with_gaps(self.rigidity, right, gaps, self.points, rounds=1, iterations=2)
        closing = np.isin(gaps.keys, facing) & (gaps.width(first) < gaps.least + CONCERN)
        gaps.keep((gaps.forces > 0) | closing)

    def _solved(self, right: FloatArray) -> Filled | None:
        """The clean pose of the step, with what still collides rolled back, or None."""
        surface, current = self.surface, self.points
        pose, previous = current, (0, 0)
        trial, defects = current, self.known
        rounds = ROUNDS
        for _ in range(TRIES):
            self.gaps.linearise(current)
            pose = step_with_gaps(self.rigidity, right, self.gaps, pose, rounds=rounds)
            # New gaps move few vertices by much: the rest stays where the last try had it.
            last, trial = trial, without_still(trial, self._shortened(pose))
            defects = changed_defects(surface, defects, last, trial)
            if acceptable(defects, self.folds):
                return Filled(trial, defects)
            if defects.rank == previous:
                # Forces do not help here: folds have no room for a gap.
                break
            previous = defects.rank
            changed = self.gaps.add_defects(defects)
            few = changed <= FEW * np.count_nonzero(self.gaps.forces)
            rounds = 1 if few else ROUNDS
        return roll_back(surface, current, trial, defects, folds=self.folds)

    def _shortened(self, pose: FloatArray) -> FloatArray:
        """Contacts may throw a vertex farther than the step: the whole motion is shortened."""
        motion = pose - self.points
        return self.points + (self._part_of(motion) * self.reach)[:, None] * motion

    def _part_of(self, motion: FloatArray) -> FloatArray:
        """The part (V,) of a motion (V, 3) by which no vertex passes the step.

        In a pile each body has its own: one that has far to go does not make the others wait.
        """
        farthest = np.maximum.reduceat(lengths(motion), self._starts)
        if not self.pile:
            farthest[:] = farthest.max()
        part = np.minimum(1.0, self.step / np.maximum(farthest, 1e-300))
        return part[self.surface.body_of_vertex]


def step_with_gaps(
    rigidity: Rigidity,
    right: FloatArray,
    gaps: Gaps,
    start: FloatArray,
    *,
    rounds: int = ROUNDS,
    iterations: int = ITERATIONS,
) -> FloatArray:
    """The pose of a step with right-hand side (V, 3) whose gaps stay open; changes their forces.

    Rounds of an augmented Lagrangian; each one solves with the stiff gaps that are active, by
    conjugate gradients from `start` with the factor of the bare system as preconditioner.
    """
    solution, image = start, rigidity.image(start)
    if len(gaps) == 0:
        return solution + rigidity.solve(right - image)
    for _ in range(rounds):
        lacking = gaps.least - gaps.width(solution)
        active = gaps.forces + gaps.stiffness * lacking > 0
        stiffness = gaps.stiffness * active
        residual = right + gaps.spread(stiffness * lacking + active * gaps.forces) - image
        # As the preconditioner is the system's own factor, its images come without products.
        search = preconditioned = rigidity.solve(residual)
        searched = residual
        energy = first = float(np.vdot(residual, preconditioned))
        for _ in range(iterations):
            if energy <= PRECISION * first:
                break
            stiff = searched + gaps.spread(stiffness * gaps.width(search))
            length = energy / max(float(np.vdot(search, stiff)), 1e-300)
            solution = solution + length * search
            image = image + length * searched
            residual = residual - length * stiff
            preconditioned = rigidity.solve(residual)
            following = float(np.vdot(residual, preconditioned))
            search = preconditioned + following / energy * search
            searched = residual + following / energy * searched
            energy = following
        gaps.forces = np.maximum(
            0.0, gaps.forces + gaps.stiffness * (gaps.least - gaps.width(solution))
        )
    return solution
