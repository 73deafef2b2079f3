"""As-rigid-as-possible steps towards the input that stop where surfaces meet."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dtrepair.numerics.geometry import FloatArray, among, lengths
from dtrepair.numerics.metrics import distortion
from dtrepair.numerics.work import work_done
from dtrepair.repair.elastic.arap import ArapOptions, ArapSystem
from dtrepair.repair.elastic.contact_step import ContactStepOptions, step_with_gaps
from dtrepair.repair.elastic.gaps import GapOptions, Gaps
from dtrepair.repair.elastic.volume_pressure import PressureOptions, VolumePressure
from dtrepair.repair.full.acceptance import (
    AcceptanceOptions,
    acceptable,
    changed_defects,
    roll_back,
    without_still,
)
from dtrepair.repair.full.biharmonic_fill import Filled
from dtrepair.repair.full.push import PushOptions
from dtrepair.repair.full.settle import Settling
from dtrepair.repair.full.steering import Steering
from dtrepair.repair.surface.defects import find_defects
from dtrepair.repair.surface.surface import Surface


@dataclass(frozen=True, kw_only=True)
class RelaxOptions:
    """Numbers of relaxing.

    Args:
        step: Largest motion of a vertex in a cycle, units of the size: gaps are linear about it.
        first: Largest factor of the step at first, as little is in the way then, ...
        of_moved: ... which is no longer than so many times the root mean square displacement: a
            long step beside a small contact spoils it.
        longer: Factor of the following steps after a cycle that gained and needed no rolling back.
        pile: So many moving bodies are a pile.
        pile_step: Factor of the step in a pile, whose bodies go as a whole rather than bend.
        shortening: The same after any other cycle, down to the step; after one that could not be
            made clean it becomes still shorter.
        force_decay: Factor of the contact forces after such a cycle, which they did not suit.
        tries: Solves of a cycle, each with the gaps that the one before closed.
        few: Fraction of new gaps up to which one round of the step is enough: the other forces
            are known.
        concern: Gaps that the step without any leaves wider than the least by this take no part
            (sizes).
        enough: Relaxing ends when the distortion fell by less than this ...
        stalled: ... over so many cycles.
        failures: It also ends when so many cycles in a row could not be made clean.
        volume_weight: What missing volume counts next to the distortion.
        missing: As long as more than this fraction of the volume is missing, ...
        more: ... relaxing goes on for up to so many times its cycles.
        settle: Strains by which what is far from all contacts may go back to its place, in turn.
        settle_after: Cycles before each of them.
        arap, gaps, pressure: Numbers of the elastic terms.
        solve: The step itself.
        acceptance: Which motions are left out, and what is rolled back.
    """

    step: float = 0.01
    first: float = 3.0
    of_moved: float = 2.5
    longer: float = 1.4
    pile: int = PushOptions.pile
    pile_step: float = 2.0
    shortening: float = 0.7
    force_decay: float = 0.5
    tries: int = 5
    few: float = 0.1
    concern: float = 6e-4
    enough: float = 0.002
    stalled: int = 3
    failures: int = 3
    volume_weight: float = 0.3
    missing: float = 0.01
    more: int = 2
    settle: tuple[float, ...] = (0.15, 0.25)
    settle_after: int = 2
    arap: ArapOptions = field(default_factory=ArapOptions)
    gaps: GapOptions = field(default_factory=GapOptions)
    pressure: PressureOptions = field(default_factory=PressureOptions)
    solve: ContactStepOptions = field(default_factory=ContactStepOptions)
    acceptance: AcceptanceOptions = field(default_factory=AcceptanceOptions)


# One cluster comes to rest within fewer cycles than bodies that lean on each other.
QUICK = RelaxOptions(enough=0.003, stalled=2)


def relax(
    surface: Surface,
    original: FloatArray,
    points: FloatArray,
    *,
    cycles: int,
    folds: int,
    crossings: int = 0,
    reach: FloatArray,
    scale: float = 1.0,
    steering: Steering | None = None,
    settling: Settling | None = None,
    until: float = np.inf,
    options: RelaxOptions = RelaxOptions(),
) -> tuple[FloatArray, int]:
    """Return the pose of least distortion between a clean one and its original, and the cycles.

    Each cycle is an as-rigid-as-possible step towards the original's edges (Sorkine & Alexa 2007)
    of limited length, under the condition that no gap between surfaces closes: both sides come to
    rest against each other. What collides all the same is rolled back locally. Cycles may double.

    cycles: at most, unless volume is missing; folds, crossings: so many are allowed; reach: (V,)
    scales the motion of each vertex; scale: factor of the step (see `contact_scale`); steering:
    regions that stay on the line of their direction; settling: takes back what is far from
    contacts; until: total of `work_done` after which no cycle begins.
    """
    if not reach.any():
        return points, 0
    numbers = scale, options, steering
    state = Relaxation(surface, original, points, folds, reach, *numbers, crossings=crossings)
    done = 0
    if settling is not None:
        for strain in options.settle:
            done += _relaxed(state, options.settle_after, until)
            state.settle(settling, strain)
    done += _relaxed(state, max(cycles - done, 1), until)
    return state.best[1], done


def _relaxed(state: Relaxation, cycles: int, until: float) -> int:
    """Relax for so many cycles, fewer where they gain nothing or work ends; return how many."""
    options, history = state.options, [state.best[0]]
    state.failures = 0
    for cycle in range(options.more * cycles):
        if work_done() > until:
            break
        state.cycle()
        history.append(state.best[0])
        if state.failures == options.failures:
            break
        if state.pressure.lost(state.points) > options.missing:
            continue
        if cycle + 1 >= cycles:
            break
        if cycle >= options.stalled:
            if history[-1 - options.stalled] - history[-1] < options.enough:
                break
    return len(history) - 1


class Relaxation:
    """A clean pose on its way back, its gaps, and the best pose so far."""

    def __init__(
        self,
        surface: Surface,
        original: FloatArray,
        points: FloatArray,
        folds: int,
        reach: FloatArray,
        scale: float,
        options: RelaxOptions,
        steering: Steering | None = None,
        *,
        crossings: int = 0,
    ) -> None:
        self.options, self.steering = options, steering
        self.surface, self.original = surface, original
        self.points, self.known = points, find_defects(surface, points)
        self.folds, self.crossings, self.reach = folds, crossings, reach
        moving = surface.cluster_of_body[surface.cluster_maxima(reach) > 0.0]
        self.pile = len(np.unique(moving)) >= options.pile
        step = options.step * scale
        self._least_step = options.pile_step * step if self.pile else step
        moved = float(np.sqrt((lengths(points - original) ** 2).mean()))
        farthest = min(options.first * self._least_step, options.of_moved * moved)
        # Long steps would lead off a direction, and dent what lies against another body.
        careful = bool(steering) or surface.clusters > 1
        self._longer = 1.0 if careful else options.longer
        self.step = self._least_step if careful else max(self._least_step, farthest)
        self.system = ArapSystem(surface, original, region=reach > 0, options=options.arap)
        self.gaps = Gaps(surface, reach, options=options.gaps)
        self.pressure = VolumePressure(surface, original, reach, options=options.pressure)
        self._last = self._value()
        self.best = self._last, points
        self.failures, self._pull = 0, np.zeros(surface.count)

    def cycle(self) -> None:
        """Take one step; the pose stays where it is if it cannot be made clean."""
        step, self._collided = self.step, False
        right, free = self._right_hand_side()
        self._find_gaps(free)
        solved = self._solved(right)
        if solved is None:
            self.failures += step <= self._least_step
            self.step = min(self._least_step, self.options.shortening * step)
            self.gaps.forces *= self.options.force_decay
            return
        self.points, self.known = solved
        self.failures, last = 0, self._last
        self._last = self._value()
        if self._last < self.best[0]:
            self.best = self._last, self.points
        worse = self._collided or self._last >= last
        factor = self.options.shortening if worse else self._longer
        self.step = max(min(self._least_step, step), factor * step)

    def settle(self, settling: Settling, strain: float) -> None:
        """Take back what is far from all contacts; it stays there, and the best pose is this."""
        best = self.best[1]
        known = self.known if best is self.points else find_defects(self.surface, best)
        settled, still = settling(best, known, folds=self.folds, strain=strain)
        if not still.any():
            return
        self.points, self.known = settled
        self.reach = settling.reach(still)
        self.system = ArapSystem(
            self.surface, self.original, region=self.reach > 0, options=self.options.arap
        )
        self.gaps.mobility = self.pressure.reach = self.reach
        self._last = self._value()
        self.best = self._last, self.points

    def _value(self) -> float:
        """Return the distortion and missing volume: what relaxing lowers."""
        lost = self.pressure.lost(self.points)
        return (
            distortion(self.original, self.points, self.surface.edges)
            + self.options.volume_weight * lost
        )

    def _right_hand_side(self) -> tuple[FloatArray, FloatArray]:
        """Return the right-hand side of the step, and the pose (V, 3) it has without gaps.

        No vertex moves too far to there.
        """
        points = self.points
        full = self.system.target(points) + self.pressure.force(
            points, self._pull, self.system.solve
        )
        present = self.system.image(points)
        free = self.system.solve(full - present)
        pull = self._fraction_of(self.reach[:, None] * free)
        if self._pull.any():
            self.gaps.scale(pull / self._pull)
        self._pull = pull
        pull = pull[:, None]
        return present + pull * (full - present), points + pull * free

    def _find_gaps(self, free: FloatArray) -> None:
        """Find the gaps that matter to the step: those with forces and those it would close.

        free: where the step leads without gaps (V, 3).
        """
        gaps, points = self.gaps, self.points
        gaps.soften()
        areas, radius = self.pressure.areas(points), 2.0 * self.step
        facing = gaps.add_facing(points, areas, free - points, radius)
        gaps.linearise(points)
        narrow = gaps.width(free) < gaps.least + self.options.concern
        closing = among(gaps.keys, facing) & narrow
        gaps.keep((gaps.forces > 0) | closing)

    def _solved(self, right: FloatArray) -> Filled | None:
        """Return the clean pose of the step, with what still collides rolled back, or None."""
        surface, options, current = self.surface, self.options, self.points
        pose, previous = current, (0, 0)
        trial, defects = current, self.known
        rounds = options.solve.rounds
        most = {"folds": self.folds, "crossings": self.crossings}
        for _ in range(options.tries):
            self.gaps.linearise(current)
            pose = step_with_gaps(
                self.system, right, self.gaps, pose, rounds=rounds, options=options.solve
            )
            # New gaps move few vertices by much: the rest stays where the last try had it.
            last = trial
            trial = without_still(last, self._shortened(pose), still=options.acceptance.still)
            defects = changed_defects(surface, defects, last, trial)
            if acceptable(defects, **most):
                return Filled(trial, defects)
            if defects.rank == previous:
                # Forces do not help here: folds have no room for a gap.
                break
            previous = defects.rank
            changed = self.gaps.add_defects(defects)
            few = changed <= options.few * np.count_nonzero(self.gaps.forces)
            rounds = 1 if few else options.solve.rounds
        self._collided = True
        return roll_back(surface, current, trial, defects, **most, options=options.acceptance)

    def _shortened(self, pose: FloatArray) -> FloatArray:
        """Return the pose (V, 3), its motion shortened where contacts throw a vertex too far."""
        motion = pose - self.points
        if self.steering:
            motion = self.steering.steered(motion)
        return self.points + (self._fraction_of(motion) * self.reach)[:, None] * motion

    def _fraction_of(self, motion: FloatArray) -> FloatArray:
        """Return the fraction (V,) of a motion (V, 3) by which no vertex passes the step.

        In a pile each body has its own fraction: one that has far to go does not make the others
        wait.
        """
        farthest = self.surface.cluster_maxima(lengths(motion))
        if not self.pile:
            farthest[:] = farthest.max()
        fraction = np.minimum(1.0, self.step / np.maximum(farthest, 1e-300))
        return fraction[self.surface.body_of_vertex]
