"""The whole repair of one pose: push and fill in phases, then tighten."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.full.biharmonic_fill import fill_creases
from dtrepair.repair.full.clearance import open_contacts
from dtrepair.repair.full.pull_back import distortion, pull_back, reach_of
from dtrepair.repair.full.push import Pushed, push
from dtrepair.repair.full.relax import STEP, relax
from dtrepair.repair.full.unbend import unbend
from dtrepair.repair.options import Solved, Stage
from dtrepair.repair.surface.defects import Defects, contact_scale, find_defects
from dtrepair.repair.surface.rigid_bodies import allowed
from dtrepair.repair.surface.surface import Surface

# Rings within which contacts are left to the crease stage: from careful to pushing all of them.
NEAR = (20, 12, 6, 0)
FIRST_STEPS, STEP_DECAY = (0.02, 0.01), 0.7
# A clean result with less distortion than this needs no further phase.
GOOD_ENOUGH = 0.10
# Tightening mends more: the first step length that comes clean will do, and a phase with less than
# this.
TIGHTENABLE = 0.23
# A phase after a clean one must lower the distortion to this part to be followed by another.
PHASE_GAIN = 0.97
# What the phases leave is pushed by short steps, so many times each, filling in between; the last
# resort are patches that may grow by so many rings.
INSIST_STEPS, INSIST_ROUNDS, INSIST_RINGS = (0.005, 0.002, 0.01), 4, 24
# Tightening does not begin below this distortion.
LOW_ENOUGH = 0.004
# Cycles of relaxing in a round of tightening.
CYCLES = 3
PULL_BACK, PULL_BACK_STEP = 0.35, 0.004


class Candidate(NamedTuple):
    """A pose, its defects and distortion, and the ring limit of the phase that made it."""

    points: FloatArray
    defects: Defects
    distortion: float
    near: int

    @property
    def rank(self) -> tuple[int, float]:
        """Crossings first, then distortion: smaller is better."""
        return len(self.defects.crossings), round(self.distortion, 4)


class FullMethod:
    """Push far contacts in phases, fill the creases, tighten towards the input."""

    def __init__(
        self,
        surface: Surface,
        *,
        rounds: int = 4,
        farthest: float | None = None,
        clearance: float = 0.0,
        skip: tuple[str, ...] = (),
    ) -> None:
        """Repair poses of `surface`; `rounds` of tightening at most, stages in `skip` left out.

        farthest: no vertex moves farther; clearance: what contacts keep; units of the size.
        """
        self.surface = surface
        self.rounds = rounds
        self.farthest = farthest
        self.clearance = clearance
        self.skip = skip

    def __call__(self, original: FloatArray) -> Solved:
        """Repair a pose (V, 3) in units of the surface's size."""
        run = _Run(self.surface, original, self.farthest, self.skip)
        if self.rounds:
            run.good_enough, run.first_will_do = TIGHTENABLE, True
        best = run.best_of_steps()
        points = best.points
        if len(best.defects.crossings) == 0:
            points = run.tighten(best, self.rounds)
            if (run.limited(points) != points).any():
                points = best.points
            if self.rounds and "unbend" not in self.skip:
                points = run.unbend(points, len(best.defects.folds))
        left = 0
        if self.clearance > 0.0:
            points, left = run.opened(points, self.clearance)
        return Solved(points, run.stages, left)


class _Run:
    """One pose on its way, and what its stages achieved."""

    def __init__(
        self,
        surface: Surface,
        original: FloatArray,
        farthest: float | None,
        skip: tuple[str, ...],
    ) -> None:
        self.surface, self.original = surface, original
        self.farthest, self.skip = farthest, skip
        self.known = find_defects(surface, original)
        self.scale = contact_scale(surface, self.known.crossings)
        self.stages: list[Stage] = []
        self.candidates: list[Candidate] = []
        self.good_enough, self.first_will_do = GOOD_ENOUGH, False

    def limited(self, points: FloatArray) -> FloatArray:
        """The nearest pose that is allowed: no displacement beyond the limit."""
        return allowed(self.surface.rigid, self.original, points, self.farthest)

    def best_of_steps(self) -> Candidate:
        """The best of several first step lengths; later ones only where the first did not suffice.

        Long steps keep a pose open that short ones squeeze, short ones solve what long ones miss.
        """
        best: Candidate | None = None
        for step in FIRST_STEPS:
            found = self.phases(step)
            best = found if best is None or found.rank < best.rank else best
            if len(best.defects.crossings) and self._concerns_few(best):
                best = self.insist(best)
            if len(best.defects.crossings) == 0 and best.distortion < self.good_enough:
                return best
        assert best is not None
        return self.insist(best) if len(best.defects.crossings) else best

    def _concerns_few(self, best: Candidate) -> bool:
        """Whether what still crosses does not meet all bodies that are in contact."""
        body_of = self.surface.body_of
        met, crossing = body_of[self.known.crossings], body_of[best.defects.crossings]
        return not np.isin(met, crossing).any(axis=1).all()

    def insist(self, best: Candidate) -> Candidate:
        """What no phase solved, tried again from all poses that the phases left, best first.

        A fill leaves a few tangles that are no longer tied to what made them: pushing them all by
        short steps and filling anew solves most. Then patches grow until they swallow the rest.
        """
        if "insist" in self.skip:
            return best
        candidates = sorted(self.candidates, key=lambda found: found.rank)
        for candidate in candidates:
            for step in INSIST_STEPS:
                found = self._alternated(candidate, self.scale * step)
                best = found if found.rank < best.rank else best
                if len(best.defects.crossings) == 0:
                    return best
        for candidate in candidates:
            pushed = Pushed(candidate.points, candidate.defects.crossings, 0)
            found = self._filled(pushed, candidate.near, rounds=INSIST_RINGS)
            best = found if found.rank < best.rank else best
            if len(best.defects.crossings) == 0:
                break
        return best

    def _alternated(self, found: Candidate, step: float) -> Candidate:
        """Push all contacts and fill in turns for as long as crossings become fewer."""
        for _ in range(INSIST_ROUNDS):
            trial = self._filled(self._push(found.points, 0, step), 0)
            if len(trial.defects.crossings) >= len(found.defects.crossings):
                break
            found = trial
            if len(found.defects.crossings) == 0:
                break
        return found

    def phases(self, step: float) -> Candidate:
        """The best result of pushing with ever fewer contacts left to the creases."""
        best: Candidate | None = None
        points = self.original
        for index, near in enumerate(NEAR):
            pushed = self._push(points, near, self.scale * step * STEP_DECAY**index)
            points = pushed.points
            if pushed.iterations == 0 and best is not None:
                continue
            found, previous = self._filled(pushed, near), best
            best = found if best is None or found.rank < best.rank else best
            if len(best.defects.crossings) == 0:
                if best.distortion < self.good_enough:
                    break
                if previous is not None and len(previous.defects.crossings) == 0:
                    if found.distortion > PHASE_GAIN * previous.distortion:
                        break
            elif index == 1:
                # Far contacts did not come apart: this step length is not for this pose.
                break
        assert best is not None
        return best

    def tighten(self, best: Candidate, rounds: int) -> FloatArray:
        """The clean pose taken back towards the input as far as contacts allow."""
        points, folds = best.points, len(best.defects.folds)
        surface, original = self.surface, self.original
        if rounds == 0 or best.distortion < LOW_ENOUGH:
            return points
        if surface.rigid.slices and "pull-back" not in self.skip:
            # Relaxing deforms; what only moves as a whole comes back this way.
            start = time.perf_counter()
            step = PULL_BACK_STEP * self.scale
            points = pull_back(
                surface,
                original,
                points,
                near=best.near,
                fraction=PULL_BACK,
                folds=folds,
                cycles=rounds,
                step=step,
            )
            self._record("pull-back", points, 0, folds, 0, start)
        if "relax" not in self.skip:
            start = time.perf_counter()
            points, cycles = relax(
                surface,
                original,
                points,
                cycles=rounds * CYCLES,
                folds=folds,
                reach=reach_of(surface, points - original),
                step=STEP * self.scale,
            )
            self._record("relax", points, 0, folds, cycles, start)
        return points

    def unbend(self, points: FloatArray, folds: int) -> FloatArray:
        """The tightened pose with its zipped creases opened, where that is allowed."""
        start = time.perf_counter()
        unbent, done = unbend(
            self.surface,
            self.original,
            points,
            folds=folds,
            step=STEP * self.scale,
        )
        if done == 0 or (self.limited(unbent) != unbent).any():
            return points
        self._record("unbend", unbent, 0, folds, done, start)
        return unbent

    def opened(self, points: FloatArray, clearance: float) -> tuple[FloatArray, int]:
        """The pose with its contacts apart by the clearance, and the pairs still closer."""
        start = time.perf_counter()
        # A pose that is its own rest would excuse its own contacts.
        at_rest = np.allclose(self.original, self.surface.rest, rtol=0.0, atol=1e-7)
        points, left = open_contacts(
            self.surface, points, clearance, limit=self.limited, facing=at_rest
        )
        defects = find_defects(self.surface, points)
        self._record("open", points, len(defects.crossings), len(defects.folds), 0, start)
        return points, left

    def _push(self, points: FloatArray, near: int, step: float) -> Pushed:
        start = time.perf_counter()
        known = self.known.crossings if points is self.original else None
        pushed = push(
            self.surface,
            points,
            near=near,
            step=step,
            known_pairs=known,
            limit=self.limited,
            volume="volume" not in self.skip,
        )
        self._record(f"push {near}", pushed.points, len(pushed.pairs), 0, pushed.iterations, start)
        return pushed

    def _filled(self, pushed: Pushed, near: int, *, rounds: int = 8) -> Candidate:
        start = time.perf_counter()
        surface = self.surface
        folds = surface.folds(pushed.points)
        points, left = pushed.points, Defects(pushed.pairs, folds)
        if "fill" not in self.skip:
            points, left = fill_creases(surface, points, rounds=rounds, known=left)
        allowed = self.limited(points)
        if (allowed != points).any():
            points, left = allowed, find_defects(surface, allowed)
        value = self._record("fill", points, len(left.crossings), len(left.folds), 0, start)
        found = Candidate(points, left, value, near)
        self.candidates.append(found)
        return found

    def _record(
        self,
        name: str,
        points: FloatArray,
        crossings: int,
        folds: int,
        iterations: int,
        start: float,
    ) -> float:
        value = distortion(self.surface, self.original, points)
        seconds = time.perf_counter() - start
        self.stages.append(Stage(name, crossings, folds, value, iterations, seconds))
        return value
