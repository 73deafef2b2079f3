"""The way to a clean pose: push far contacts and fill creases, with ever fewer left to the fill."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import distortion
from dtrepair.numerics.work import Repeats, work_done
from dtrepair.repair.elastic.parting import PartingOptions, parted
from dtrepair.repair.elastic.sections import SectionOptions, sections_apart
from dtrepair.repair.full.biharmonic_fill import Candidate, FillOptions, biharmonic_fill
from dtrepair.repair.full.push import Pushed, PushOptions, push
from dtrepair.repair.full.steering import Steering, SteeringOptions
from dtrepair.repair.stage_log import StageLog
from dtrepair.repair.surface.defects import Defects, contact_scale, find_defects
from dtrepair.repair.surface.rigid_bodies import allowed
from dtrepair.repair.surface.surface import Surface


@dataclass(frozen=True, kw_only=True)
class PhaseOptions:
    """Numbers of the phases, and of what insists where they leave crossings.

    Args:
        near: Rings within which contacts are left to the fill, phase by phase: from careful to
            pushing all of them; none beyond the limit of `RingDistances`.
        first_steps: Largest motions in an iteration of the first phase, units of the size, each
            tried where the one before did not suffice: long steps keep a pose open that short ones
            squeeze, short ones solve what long ones miss.
        step_decay: Factor of the step from phase to phase: less is left to be moved.
        good_enough: Distortion below which a clean result needs no further phase.
        tightenable: The same where tightening follows, which mends more.
        parted: Distortion below which a pose whose few crossings were led apart is the one.
        gain: A phase after a clean one must lower the distortion to this fraction to be followed
            by another.
        insist_steps: Largest motions in an iteration where the phases left crossings, units of the
            size: short ones, which find out of tangles.
        far_less: Limbs that were led apart are insisted on, in place of what the phases left, where
            they keep at most this share of its crossings.
        insist_rounds: Times that pushing and filling take turns with each of them.
        work, work_a_triangle: After so much work (units of `numerics.work`), and so much for each
            triangle of the mesh, times the effort, no other attempt begins: some three seconds of
            a processor for a pose of 1,000 triangles, five for 20,000.
        push: Numbers of the push.
        sections: How limbs that lie in each other are led apart where pushing does not suffice.
        steering: Numbers of preferred directions.
        parting: Numbers of the least motion.
        fill: Numbers of the fill.
        last_fill: The fill of the last resort, whose patches may grow until they swallow what is
            left.
    """

    near: tuple[int, ...] = (20, 12, 6, 0)
    first_steps: tuple[float, ...] = (0.02, 0.01)
    step_decay: float = 0.7
    good_enough: float = 0.10
    tightenable: float = 0.23
    parted: float = 0.02
    gain: float = 0.97
    insist_steps: tuple[float, ...] = (0.005, 0.002, 0.01)
    far_less: float = 0.65
    insist_rounds: int = 4
    work: float = 1.5e6
    work_a_triangle: float = 50.0
    push: PushOptions = field(default_factory=PushOptions)
    sections: SectionOptions = field(default_factory=SectionOptions)
    steering: SteeringOptions = field(default_factory=SteeringOptions)
    parting: PartingOptions = field(default_factory=PartingOptions)
    fill: FillOptions = field(default_factory=FillOptions)
    last_fill: FillOptions = field(default_factory=lambda: FillOptions(rounds=24))


class Phases:
    """The search for a clean pose near an original (V, 3), in units of the surface's size."""

    def __init__(
        self,
        surface: Surface,
        original: FloatArray,
        *,
        log: StageLog | None = None,
        farthest: float | None = None,
        skip: tuple[str, ...] = (),
        tightened: bool = True,
        effort: float = 1.0,
        options: PhaseOptions = PhaseOptions(),
    ) -> None:
        """Search within `farthest` (units of the size) of the original; note stages in `log`.

        skip: stages that are left out; tightened: whether tightening follows; effort: factor of the
        work after which no other attempt begins.
        """
        self.surface, self.original, self.options = surface, original, options
        self.farthest, self.skip = farthest, skip
        self._begun = work_done()
        self._most = effort * (options.work + options.work_a_triangle * len(surface.faces))
        self.log = log or StageLog(surface, original)
        self.known = find_defects(surface, original)
        self.scale = contact_scale(surface, self.known.crossings)
        self.candidates: list[Candidate] = []
        # What sections left is no start for others unless it is far less.
        self._of_sections: list[Candidate] = []
        self._fills = Repeats[Candidate]()
        self.good_enough = options.tightenable if tightened else options.good_enough
        self.steering = Steering(surface, options=options.steering)
        self.push = options.push
        if self.steering:
            patience = max(options.steering.patience, options.push.patience)
            self.push = replace(options.push, patience=patience)

    def limited(self, points: FloatArray) -> FloatArray:
        """Return the nearest pose that is allowed: no displacement beyond the limit."""
        return allowed(self.surface.rigid, self.original, points, self.farthest)

    @property
    def worked_enough(self) -> bool:
        """Whether so much work was done that no other attempt should begin."""
        return work_done() > self.enough()

    def enough(self, times: float = 1.0) -> float:
        """Return the total of `work_done` when so many times the work of the phases is done."""
        return self._begun + times * self._most

    def best(self) -> Candidate:
        """Return the best of several first steps; later ones only where the first did not suffice.

        Where what is left concerns few of the bodies, it is insisted on at once.
        """
        best = self._led_apart(Candidate(self.original, self.known, 0.0, self.options.near[-1]))
        if best is not None and best.distortion < self.options.parted:
            return best
        self.candidates += [] if best is None else [best]
        apart: Candidate | None = None
        for step in self.options.first_steps:
            candidate = self.run(step)
            good = candidate.clean and candidate.distortion < self.good_enough
            if best is None and not good:
                apart = self._sections_apart()
                if apart is not None and apart.clean and apart.rank < candidate.rank:
                    candidate = apart
            best = candidate if best is None or candidate.rank < best.rank else best
            if not best.clean and self._concerns_few(best):
                best = self._insisted(best, apart)
            if (best.clean and best.distortion < self.good_enough) or self.worked_enough:
                break
        assert best is not None
        if not (best.clean or self.worked_enough):
            best = self._insisted(best, apart)
        best = best if apart is None or best.rank <= apart.rank else apart
        return self._led_apart(best, some=True) or best

    def _insisted(self, best: Candidate, apart: Candidate | None) -> Candidate:
        """Insist on limbs led apart if they keep far less than the best does, else on that.

        They are then the candidates, in place of all before.
        """
        most = self.options.far_less * len(best.defects.crossings)
        if apart is None or len(apart.defects.crossings) > most:
            return self.insist(best)
        self.candidates = list(self._of_sections)
        return self.insist(apart)

    def _sections_apart(self) -> Candidate | None:
        """Return what pushing makes of limbs that were led apart; None where they were not.

        It takes no work from the other attempts.
        """
        if self.steering or "sections" in self.skip or self.worked_enough:
            return None
        start, begun, tried = time.perf_counter(), work_done(), len(self.candidates)
        points = sections_apart(self.surface, self.original, options=self.options.sections)
        found = None
        if points is not None and np.array_equal(self.limited(points), points):
            self.log.add("sections", points, start)
            found = self.run(self.options.first_steps[-1], points)
            self._of_sections = self.candidates[tried:]
            del self.candidates[tried:]
        self._begun += work_done() - begun
        return found

    def _led_apart(self, start: Candidate, *, some: bool = False) -> Candidate | None:
        """Return a pose with (some of) its few crossings led apart, if they can be.

        some: not before all else has ended, or it only changes which way that takes.
        """
        begun = time.perf_counter()
        found = self._parted_from(start.points, start.defects, some=some)
        if found is None:
            return None
        points, left = found
        value = self.log.add("part", points, begun, folds=len(left.folds))
        return start._replace(points=points, defects=left, distortion=value)

    def _parted_from(
        self, points: FloatArray, known: Defects, *, some: bool = False
    ) -> tuple[FloatArray, Defects] | None:
        """Return a pose (V, 3) with (some of) its few crossings led apart; None if that fails."""
        if self.steering:
            return None
        options = self.options.parting
        return parted(self.surface, points, known, some=some, limited=self.limited, options=options)

    def run(self, step: float, points: FloatArray | None = None) -> Candidate:
        """Return the best result of pushing with ever fewer contacts left to the fill.

        points: the pose (V, 3) it begins with; default: the original.
        """
        best: Candidate | None = None
        options, points = self.options, self.original if points is None else points
        for index, near in enumerate(options.near):
            start = points
            pushed = self._pushed(points, near, self.scale * step * options.step_decay**index)
            points = pushed.points
            if pushed.iterations == 0 and best is not None:
                continue
            previous = best
            if best is None or points is not start:  # else filling does what it did before
                candidate = self._filled(pushed, near, options.fill)
            best = candidate if best is None or candidate.rank < best.rank else best
            if self.worked_enough:
                break
            if best.clean:
                if best.distortion < self.good_enough:
                    break
                if previous is not None and previous.clean:
                    if candidate.distortion > options.gain * previous.distortion:
                        break
            elif index == 1:
                # Far contacts did not come apart: this step length is not for this pose.
                break
        assert best is not None
        return best

    def insist(self, best: Candidate) -> Candidate:
        """Try what no phase solved again from all candidates, best first.

        A fill leaves a few tangles that are no longer tied to what made them: pushing them all by
        short steps and filling anew solves most. Then patches grow until they swallow the rest.
        """
        if "insist" in self.skip:
            return best
        candidates = sorted(self.candidates, key=lambda candidate: candidate.rank)
        for candidate in candidates:
            for step in self.options.insist_steps:
                if self.worked_enough:
                    return best
                trial = self._alternated(candidate, self.scale * step)
                best = trial if trial.rank < best.rank else best
                if best.clean:
                    return best
        for candidate in candidates:
            if self.worked_enough:
                break
            pushed = Pushed(candidate.points, candidate.defects.crossings, 0)
            trial = self._filled(pushed, candidate.near, self.options.last_fill)
            best = trial if trial.rank < best.rank else best
            if best.clean:
                break
        return best

    def insist_from(self, points: FloatArray) -> Candidate:
        """Return the best that insisting makes of another pose (V, 3) than the phases left."""
        defects = find_defects(self.surface, points)
        value = distortion(self.original, points, self.surface.edges)
        self.candidates.append(Candidate(points, defects, value, self.options.near[-1]))
        best = self.insist(self.candidates[-1])
        return self._led_apart(best, some=True) or best

    def _concerns_few(self, best: Candidate) -> bool:
        """Return whether what still crosses does not meet all bodies that are in contact."""
        body_of = self.surface.body_of
        met, crossing = body_of[self.known.crossings], body_of[best.defects.crossings]
        return not np.isin(met, crossing).any(axis=1).all()

    def _alternated(self, best: Candidate, step: float) -> Candidate:
        """Push all contacts and fill in turns for as long as crossings become fewer."""
        for _ in range(self.options.insist_rounds):
            if self.worked_enough:
                break
            trial = self._filled(self._pushed(best.points, 0, step), 0, self.options.fill)
            if len(trial.defects.crossings) >= len(best.defects.crossings):
                break
            best = trial
            if best.clean:
                break
        return best

    def _pushed(self, points: FloatArray, near: int, step: float) -> Pushed:
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
            options=self.push,
        )
        found = {"crossings": len(pushed.pairs), "iterations": pushed.iterations}
        self.log.add(f"push {near}", pushed.points, start, **found)
        return pushed

    def _filled(self, pushed: Pushed, near: int, options: FillOptions) -> Candidate:
        newly = partial(self._newly_filled, pushed, near, options)
        return self._fills(newly, pushed.points, near, options)

    def _newly_filled(self, pushed: Pushed, near: int, options: FillOptions) -> Candidate:
        start = time.perf_counter()
        surface = self.surface
        folds = surface.contacts.folds(pushed.points)
        points, left = pushed.points, Defects(pushed.pairs, folds)
        if "fill" not in self.skip:
            points, left = biharmonic_fill(surface, points, known=left, options=options)
            points, left = self._parted_from(points, left) or (points, left)
        limited = self.limited(points)
        if (limited != points).any():
            points, left = limited, find_defects(surface, limited)
        counts = {"crossings": len(left.crossings), "folds": len(left.folds)}
        value = self.log.add("fill", points, start, **counts)
        off = self.options.steering.weight * self.steering.astray(points - self.original)
        self.candidates.append(Candidate(points, left, value, near, off))
        return self.candidates[-1]
