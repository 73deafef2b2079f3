"""The whole repair of one pose: push and fill in phases, then tighten."""

from __future__ import annotations

import time
from typing import NamedTuple

from dtrepair.geometry import FloatArray
from dtrepair.repair.contact import Defects, find_defects
from dtrepair.repair.crease import fill_creases
from dtrepair.repair.options import Solved, Stage
from dtrepair.repair.push import Pushed, push
from dtrepair.repair.surface import Surface
from dtrepair.repair.tighten import distortion, pull_back, reach_of, relax

# Rings within which contacts are left to the crease stage: from careful to pushing all of them.
NEAR = (20, 12, 6, 0)
FIRST_STEP, STEP_DECAY = 0.02, 0.7
# A clean result with less distortion than this needs no further phase.
GOOD_ENOUGH = 0.10
# A phase after a clean one must lower the distortion to this part to be followed by another.
PHASE_GAIN = 0.97
# A round of tightening must lower it to this part to be followed by another.
ROUND_GAIN = 0.95
PULL_BACK, PULL_BACK_DECAY = 0.35, 0.8


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

    def __init__(self, surface: Surface, *, rounds: int = 4) -> None:
        """Repair poses of `surface`; `rounds` of tightening at most."""
        self.surface = surface
        self.rounds = rounds

    def __call__(self, original: FloatArray) -> Solved:
        """Repair a pose (V, 3) in units of the surface's size."""
        run = _Run(self.surface, original)
        best = run.phases()
        points = best.points
        if len(best.defects.crossings) == 0:
            points = run.tighten(best, self.rounds)
        return Solved(points, run.stages)


class _Run:
    """One pose on its way, and what its stages achieved."""

    def __init__(self, surface: Surface, original: FloatArray) -> None:
        self.surface, self.original = surface, original
        self.known = find_defects(surface, original)
        self.stages: list[Stage] = []

    def phases(self) -> Candidate:
        """The best result of pushing with ever fewer contacts left to the creases."""
        best: Candidate | None = None
        points = self.original
        for index, near in enumerate(NEAR):
            if index == 2 and best is not None and len(best.defects.crossings):
                # Far contacts did not come apart: start again from the input with half the step.
                pushed = self._push(self.original, 12, 0.5 * FIRST_STEP, 40, 8)
                best = min(best, self._filled(pushed, 12), key=lambda one: one.rank)
                if len(best.defects.crossings) == 0:
                    break
            pushed = self._push(points, near, FIRST_STEP * STEP_DECAY**index, 25, 6)
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
        assert best is not None
        return best

    def tighten(self, best: Candidate, rounds: int) -> FloatArray:
        """The clean pose pulled towards the input in rounds of three stages."""
        points, folds = best.points, len(best.defects.folds)
        surface, original = self.surface, self.original
        before = best.distortion
        reach = reach_of(surface, points - original)
        for index in range(rounds):
            start = time.perf_counter()
            fraction = PULL_BACK * PULL_BACK_DECAY**index
            points = pull_back(
                surface, original, points, near=best.near, fraction=fraction, folds=folds
            )
            middle = time.perf_counter()
            self._record("pull back", points, 0, folds, 0, start)
            points = relax(
                surface, original, points, cycles=3, folds=folds, soften=True, reach=reach
            )
            start = time.perf_counter()
            self._record("relax", points, 0, folds, 0, middle)
            points = relax(
                surface, original, points, cycles=4, folds=folds, soften=False, reach=reach
            )
            after = self._record("pin", points, 0, folds, 0, start)
            if after > ROUND_GAIN * before:
                break
            before = after
        return points

    def _push(
        self, points: FloatArray, near: int, step: float, iterations: int, patience: int
    ) -> Pushed:
        start = time.perf_counter()
        known = self.known.crossings if points is self.original else None
        pushed = push(
            self.surface,
            points,
            near=near,
            step=step,
            iterations=iterations,
            patience=patience,
            known_pairs=known,
        )
        self._record(f"push {near}", pushed.points, len(pushed.pairs), 0, pushed.iterations, start)
        return pushed

    def _filled(self, pushed: Pushed, near: int) -> Candidate:
        start = time.perf_counter()
        surface = self.surface
        folds = surface.queries.folds(surface.written(pushed.points))
        points, left = fill_creases(surface, pushed.points, known=Defects(pushed.pairs, folds))
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
