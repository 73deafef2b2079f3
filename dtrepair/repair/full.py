"""The whole repair of one pose: push and fill in phases, then tighten."""

from __future__ import annotations

import time
from dataclasses import dataclass

from dtrepair.geometry import FloatArray
from dtrepair.repair.contact import Defects, find_defects
from dtrepair.repair.crease import fill_creases
from dtrepair.repair.options import Solved, Stage
from dtrepair.repair.push import push
from dtrepair.repair.surface import Surface
from dtrepair.repair.tighten import distortion, pull_back, relax

# Rings within which contacts are left to the crease stage, from careful to all.
NEAR = (20, 12, 6, 0)
FIRST_STEP, STEP_DECAY = 0.02, 0.7
# A result with less distortion than this needs no further phase.
GOOD_ENOUGH = 0.10
ROUNDS = 4


@dataclass
class Candidate:
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

    def __init__(self, surface: Surface, *, rounds: int = ROUNDS) -> None:
        self.surface = surface
        self.rounds = rounds

    def __call__(self, original: FloatArray) -> Solved:
        """Repair a pose (V, 3) in units of the surface's size."""
        stages: list[Stage] = []
        defects = find_defects(self.surface, original)
        if len(defects.crossings) == 0:
            return Solved(original)
        best = self._phases(original, defects, stages)
        points = best.points
        if best.rank[0] == 0:
            points = self._tighten(original, best, stages)
        return Solved(points, stages)

    def _phases(self, original: FloatArray, defects: Defects, stages: list[Stage]) -> Candidate:
        best: Candidate | None = None
        points = original
        for index, near in enumerate(NEAR):
            if index == 2 and best is not None and best.rank[0] > 0:
                # Far contacts did not come apart: start again with half the step.
                fresh, _, _ = self._candidate(
                    original, original, 12, 0.5 * FIRST_STEP, stages, 40, 8
                )
                best = min(best, fresh, key=lambda candidate: candidate.rank)
                if best.rank[0] == 0:
                    break
            step = FIRST_STEP * STEP_DECAY**index
            found, points, iterations = self._candidate(original, points, near, step, stages)
            if iterations == 0 and best is not None:
                continue
            previous = best
            if best is None or found.rank < best.rank:
                best = found
            if best.rank[0] == 0 and best.distortion < GOOD_ENOUGH:
                break
            if previous is not None and previous.rank[0] == 0:
                if found.distortion > 0.97 * previous.distortion:
                    break
        assert best is not None
        return best

    def _candidate(self, original, points, near, step, stages, iterations=25, patience=6):
        start = time.perf_counter()
        surface = self.surface
        pushed = push(
            surface, points, near=near, step=step, iterations=iterations, patience=patience
        )
        middle = time.perf_counter()
        filled = fill_creases(surface, pushed.points)
        value = distortion(surface, original, filled.points)
        left = filled.defects
        stages.append(
            Stage(
                f"push {near}",
                len(pushed.pairs),
                0,
                distortion(surface, original, pushed.points),
                pushed.iterations,
                middle - start,
            )
        )
        stages.append(
            Stage(
                "fill", len(left.crossings), len(left.folds), value, 0, time.perf_counter() - middle
            )
        )
        return Candidate(filled.points, left, value, near), pushed.points, pushed.iterations

    def _tighten(self, original: FloatArray, best: Candidate, stages: list[Stage]) -> FloatArray:
        surface, folds = self.surface, len(best.defects.folds)
        points = best.points
        for index in range(self.rounds):
            before = distortion(surface, original, points)
            for name, stage in (
                (
                    "pull back",
                    lambda p: pull_back(
                        surface,
                        original,
                        p,
                        near=best.near,
                        fraction=0.35 * 0.8**index,
                        folds=folds,
                        cycles=1,
                    ),
                ),
                (
                    "relax",
                    lambda p: relax(surface, original, p, cycles=3, folds=folds, soften=True),
                ),
                ("pin", lambda p: relax(surface, original, p, cycles=4, folds=folds, soften=False)),
            ):
                start = time.perf_counter()
                points = stage(points)
                stages.append(
                    Stage(
                        name,
                        0,
                        folds,
                        distortion(surface, original, points),
                        0,
                        time.perf_counter() - start,
                    )
                )
            if distortion(surface, original, points) > 0.98 * before:
                break
        return points
