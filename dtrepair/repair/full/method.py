"""The whole repair of one pose: phases to a clean pose, then back towards the input."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.work import work_done
from dtrepair.repair.elastic.dihedral_angles import DihedralAngles, DihedralOptions
from dtrepair.repair.elastic.edge_lengths import EdgeLengthOptions, EdgeLengths
from dtrepair.repair.full.acceptance import reach_of
from dtrepair.repair.full.biharmonic_fill import Candidate
from dtrepair.repair.full.cure import CureOptions, Flaws, cure
from dtrepair.repair.full.phases import PhaseOptions, Phases
from dtrepair.repair.full.pull_back import PullBackOptions, pull_back
from dtrepair.repair.full.relax import QUICK, RelaxOptions, relax
from dtrepair.repair.full.settle import (
    CommonShiftOptions,
    SettleOptions,
    Settling,
    shifted_back,
)
from dtrepair.repair.result import Solved
from dtrepair.repair.stage_log import StageLog
from dtrepair.repair.surface.defects import Defects
from dtrepair.repair.surface.surface import Surface


@dataclass(frozen=True, kw_only=True)
class FullOptions:
    """Every number of the full method, stage by stage.

    Args:
        phases: Push and fill until the pose is clean.
        low_enough: Distortion below which tightening does not begin: nobody sees it.
        cycles: Of relaxing, in a round of tightening.
        pull_back: Rigid bodies back towards the input.
        relax: All others back towards the input: single skins and attached parts, ...
        relax_bodies: ... and bodies that move freely, which take longer to come to rest.
        shift: What all that moves was shifted by back, before it is relaxed; less of it settles.
        settle: What touches nothing back to its place, between cycles of relaxing.
        edges: Edges that are crushed or drawn out, brought back.
        unbend: Zipped creases opened.
        cure: How both are cured.
        relax_attached: Of attached parts no cycle of relaxing begins after so many times the work
            that the phases may take, theirs included: what follows needs its time, too; ...
        relax_always: ... but so many times is left to it, whatever they took.
        left_attached, left_share: A pose of attached parts that keeps so many pairs, and not more
            than this share of the input's, is relaxed and cured as if it were clean: what strains
            it costs more contacts than these.
    """

    phases: PhaseOptions = field(default_factory=PhaseOptions)
    low_enough: float = 0.004
    cycles: int = 3
    pull_back: PullBackOptions = field(default_factory=PullBackOptions)
    relax: RelaxOptions = field(default_factory=lambda: QUICK)
    relax_bodies: RelaxOptions = field(default_factory=RelaxOptions)
    shift: CommonShiftOptions = field(default_factory=lambda: CommonShiftOptions(faint=0.01))
    settle: SettleOptions = field(default_factory=SettleOptions)
    edges: EdgeLengthOptions = field(default_factory=EdgeLengthOptions)
    unbend: DihedralOptions = field(default_factory=DihedralOptions)
    cure: CureOptions = field(default_factory=CureOptions)
    relax_attached: float = 0.6
    relax_always: float = 0.4
    left_attached: int = 60
    left_share: float = 0.1


class FullMethod:
    """Push far contacts in phases, fill the creases, tighten towards the input."""

    def __init__(
        self,
        surface: Surface,
        *,
        rounds: int = 4,
        farthest: float | None = None,
        skip: tuple[str, ...] = (),
        effort: float = 1.0,
        options: FullOptions = FullOptions(),
    ) -> None:
        """Repair poses of `surface`; `rounds` of tightening at most, stages in `skip` left out.

        farthest: no vertex moves farther, units of the size; effort: factor of the work on a pose
        after which no other attempt begins.
        """
        self.surface, self.options = surface, options
        self.rounds = rounds
        self.farthest = farthest
        self.skip, self.effort = skip, effort

    def __call__(self, original: FloatArray) -> Solved:
        """Repair a pose (V, 3) in units of the surface's size."""
        log = StageLog(self.surface, original)
        phases = Phases(
            self.surface,
            original,
            log=log,
            farthest=self.farthest,
            skip=self.skip,
            tightened=self.rounds > 0,
            effort=self.effort,
            options=self.options.phases,
        )
        best = phases.best()
        points = best.points
        if self._finished(best, len(phases.known.crossings)):
            points = self._tightened(best, phases)
            if self.rounds:
                points = self._cured(points, best.defects, phases)
        return Solved(points, log.stages)

    def _finished(self, best: Candidate, before: int) -> bool:
        """Return whether what follows pays: all is clean, or of attached parts nearly all.

        before: how many pairs the input has.
        """
        left = 0
        if self.surface.ties is not None:
            left = min(self.options.left_attached, int(self.options.left_share * before))
        return len(best.defects.crossings) <= left

    def _tightened(self, best: Candidate, phases: Phases) -> FloatArray:
        """Return a finished pose taken back towards the input as contacts and limit allow."""
        options, points, folds = self.options, best.points, len(best.defects.folds)
        if self.rounds == 0 or best.distortion < options.low_enough:
            return points
        surface, original, log = self.surface, phases.original, phases.log
        crossings = len(best.defects.crossings)
        # What goes back beside pairs that stay would not know when to stop.
        if surface.rigid.slices and "pull-back" not in self.skip and not crossings:
            # Relaxing deforms; what only moves as a whole comes back this way.
            start = time.perf_counter()
            points = pull_back(
                surface,
                original,
                points,
                near=best.near,
                folds=folds,
                cycles=self.rounds,
                scale=phases.scale,
                options=options.pull_back,
            )
            log.add("pull-back", points, start, folds=folds)
        if phases.steering and not crossings:
            start = time.perf_counter()
            points = phases.steering.led_back(original, points, folds=folds)
            log.add("lead back", points, start, folds=folds)
        if "relax" not in self.skip:
            start = time.perf_counter()
            numbers = options.relax if surface.clusters == 1 else options.relax_bodies
            rings = numbers.acceptance.reach_rings
            settling = None
            # What has a direction would lose it, and free bodies lean on each other.
            if not ("settle" in self.skip or phases.steering or surface.clusters > 1 or crossings):
                bad = phases.known.triangles
                settling = Settling(surface, original, bad, options=options.settle)
                points = self._shifted_back(points, phases)
            points, cycles = relax(
                surface,
                original,
                points,
                cycles=self.rounds * options.cycles,
                folds=folds,
                crossings=crossings,
                reach=reach_of(surface, points - original, rings=rings),
                scale=phases.scale,
                steering=phases.steering,
                settling=settling,
                until=np.inf if surface.ties is None else self._relaxed_enough(phases),
                options=numbers,
            )
            left = len(surface.contacts.pairs(points)) if crossings else 0
            log.add("relax", points, start, crossings=left, folds=folds, iterations=cycles)
        return best.points if (phases.limited(points) != points).any() else points

    def _shifted_back(self, points: FloatArray, phases: Phases) -> FloatArray:
        """Return a clean pose (V, 3) without what all that moves was shifted by.

        As it is where something would be farther than it may go: what moved against the shift.
        """
        surface, known = self.surface, phases.known.crossings
        (result,) = shifted_back(
            surface,
            phases.original[None],
            points[None],
            ([known], [known[:0]]),
            lambda poses, _: [surface.contacts.pairs(poses[0])],
            eased=lambda needed: needed,
            options=self.options.shift,
        )
        return result if np.array_equal(phases.limited(result), result) else points

    def _relaxed_enough(self, phases: Phases) -> float:
        """Return the total of `work_done` after which attached parts are not relaxed on."""
        left = phases.enough(self.options.relax_always) - phases.enough(0.0)
        return max(phases.enough(self.options.relax_attached), work_done() + left)

    def _cured(self, points: FloatArray, known: Defects, phases: Phases) -> FloatArray:
        """Return the tightened pose with its flaws cured, where that is allowed.

        known: the defects that were left before it was tightened.
        """
        options, original, skip = self.options, phases.original, self.skip
        if "edges" not in skip:
            lengths = EdgeLengths(self.surface, original, options=options.edges)
            points = self._without(lengths, points, known, phases, "edges")
        if "unbend" not in skip:
            angles = DihedralAngles(self.surface, original, options=options.unbend)
            points = self._without(angles, points, known, phases, "unbend")
        return points

    def _without(
        self, flaws: Flaws, points: FloatArray, known: Defects, phases: Phases, name: str
    ) -> FloatArray:
        start, original = time.perf_counter(), phases.original
        folds, crossings = len(known.folds), len(known.crossings)
        cured, done = cure(
            flaws,
            original,
            points,
            folds=folds,
            crossings=crossings,
            scale=phases.scale,
            options=self.options.cure,
        )
        if done == 0 or (phases.limited(cured) != cured).any():
            return points
        phases.log.add(name, cured, start, crossings=crossings, folds=folds, iterations=done)
        return cured


def solve_alone(
    surface: Surface,
    original: FloatArray,
    *,
    rounds: int = 0,
    effort: float = 1.0,
    options: FullOptions = FullOptions(),
) -> FloatArray:
    """Return a pose repaired alone; untightened by default: it is blended with its neighbours'."""
    return FullMethod(surface, rounds=rounds, effort=effort, options=options)(original).points
