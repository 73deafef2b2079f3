"""The whole repair of one pose: push and fill in phases, then tighten."""

from __future__ import annotations

import time
from typing import NamedTuple

from dtrepair.geometry import FloatArray
from dtrepair.repair.clearance import open_contacts
from dtrepair.repair.contact import Defects, contact_scale, find_defects
from dtrepair.repair.crease import fill_creases
from dtrepair.repair.options import Solved, Stage
from dtrepair.repair.push import Pushed, push
from dtrepair.repair.rigid import allowed
from dtrepair.repair.surface import Surface
from dtrepair.repair.tighten import distortion, pull_back, reach_of, relax

# Rings within which contacts are left to the crease stage: from careful to pushing all of them.
NEAR = (20, 12, 6, 0)
FIRST_STEPS, STEP_DECAY = (0.02, 0.01), 0.7
# A clean result with less distortion than this needs no further phase.
GOOD_ENOUGH = 0.10
# A phase after a clean one must lower the distortion to this part to be followed by another.
PHASE_GAIN = 0.97
# A round of tightening must lower it to this part to be followed by another.
ROUND_GAIN = 0.97
# Tightening ends below this distortion, and does not begin below a tenth of it.
LOW_ENOUGH = 0.04
# A stage must lower it to this part to be run in the next round too.
STAGE_GAIN = 0.995
PULL_BACK, PULL_BACK_STEP = 0.35, 0.004
# How the fraction goes on after a pull that was of use, and after one that asked too much.
PULL_BACK_DECAY, PULL_BACK_CUT = 0.8, 0.4


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
        best = run.best_of_steps()
        points = best.points
        if len(best.defects.crossings) == 0:
            points = run.tighten(best, self.rounds)
            if (run.limited(points) != points).any():
                points = best.points
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
            if len(best.defects.crossings) == 0 and best.distortion < GOOD_ENOUGH:
                break
        assert best is not None
        return best

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
                if best.distortion < GOOD_ENOUGH:
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
        """The clean pose pulled towards the input in rounds of three stages.

        A stage that gained nothing in one round is left out in the next, or asks for less.
        """
        points, folds = best.points, len(best.defects.folds)
        surface, original = self.surface, self.original
        before = best.distortion
        reach = reach_of(surface, points - original)
        idle, fraction = "", PULL_BACK
        for index in range(rounds):
            if before < LOW_ENOUGH * (1.0 if index else 0.1):
                break
            start_of_round = before
            for name in ("pull-back", "relax", "pin"):
                if name == idle or name in self.skip:
                    idle = "" if name == idle else idle
                    continue
                start = time.perf_counter()
                if name == "pull-back":
                    points = pull_back(
                        surface,
                        original,
                        points,
                        near=best.near,
                        fraction=fraction,
                        folds=folds,
                        step=PULL_BACK_STEP * self.scale,
                    )
                else:
                    points = relax(
                        surface,
                        original,
                        points,
                        cycles=3 if name == "relax" else 4,
                        folds=folds,
                        soften=name == "relax",
                        reach=reach,
                    )
                after = self._record(name, points, 0, folds, 0, start)
                gained = after <= STAGE_GAIN * before
                if name == "pull-back":
                    fraction *= PULL_BACK_DECAY if gained else PULL_BACK_CUT
                elif not gained:
                    idle = name
                before = after
            if before > ROUND_GAIN * start_of_round:
                break
        return points

    def opened(self, points: FloatArray, clearance: float) -> tuple[FloatArray, int]:
        """The pose with its contacts apart by the clearance, and the pairs still closer."""
        start = time.perf_counter()
        points, left = open_contacts(self.surface, points, clearance, limit=self.limited)
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

    def _filled(self, pushed: Pushed, near: int) -> Candidate:
        start = time.perf_counter()
        surface = self.surface
        folds = surface.folds(pushed.points)
        points, left = pushed.points, Defects(pushed.pairs, folds)
        if "fill" not in self.skip:
            points, left = fill_creases(surface, points, known=left)
        allowed = self.limited(points)
        if (allowed != points).any():
            points, left = allowed, find_defects(surface, allowed)
        value = self._record("fill", points, len(left.crossings), len(left.folds), 0, start)
        return Candidate(points, left, value, near)

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
