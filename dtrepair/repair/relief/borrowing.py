"""Poses solved from the corrections of their neighbours, and how good they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import distortion
from dtrepair.numerics.temporal import standing_out, steps_between
from dtrepair.repair.frame.lending import LendingOptions, carried, solved_from
from dtrepair.repair.full.steering import Steering
from dtrepair.repair.parallel.worker_pool import WorkerPool, with_workers, worthwhile_jobs
from dtrepair.repair.relief.relief import ReliefOptions, relieved_poses
from dtrepair.repair.relief.swelling import too_far
from dtrepair.repair.scene.bounds import badness, strain_of, wrong_of
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh
from dtrepair.repair.surface.surface import Surface


@dataclass(frozen=True, kw_only=True)
class BorrowingOptions:
    """When frames start again.

    Args:
        rough: Of several parts not only strained frames start again, but those that are distorted
            so many times as much as a neighbour, ...
        rough_attached: ... where parts are attached, whose frames are solved each for itself, so
            many times as much, ...
        smooth: ... and more than this.
        wrung: Of attached parts those start again, too, in which a piece of a limb lost, or gained,
            more of its volume than this, and than in the neighbour.
        hopeless: What is farther beyond its bounds than this (see `badness`) does not start again:
            a soldier's straps crushed between layers are so by any way.
        stands_out: Of attached parts frames in which one moves by this much, root mean square,
            units of the size, farther than between its neighbours start again, too, and take what
            stands out ...
        less, less_eased: ... by at most this share of that; the second if edges change less, too.
        jump, run: Between corrections that differ by more than the first, measured alike, runs of
            at most so many frames are solved one from the other, from before and from behind: they
            may have taken the other side of something. Kept where steps shrink to `less` in all.
        limb: Of a larger part so many vertices, those that stand out most, count: a leg is little
            of a skin.
        triangles: Of attached parts loans are made for so many triangles to each frame of a window,
            one at least, and first to strained frames: a loan is a quarter of the work of a frame.
            Twice as many go to frames that stand out.
        left_share: Of what was wrong with the input so much may be left, of a lender and of what
            was borrowed: a share of a strained pose leaves more.
        lending: What cleans a frame from there.
        relief: What relaxes it then.
    """

    rough: float = 3.0
    rough_attached: float = 1.6
    smooth: float = 0.03
    wrung: float = 0.5
    hopeless: float = 30.0
    stands_out: float = 4e-3
    less: float = 0.6
    less_eased: float = 0.8
    jump: float = 0.012
    run: int = 8
    limb: int = 1000
    triangles: int = 20_000
    left_share: float = 0.1
    lending: LendingOptions = field(default_factory=LendingOptions)
    relief: ReliefOptions = field(default_factory=ReliefOptions)


class Merit(NamedTuple):
    """How a pose is: the less the better.

    Whether and how far it is strained, what is wrong, the distortion of its edges, and where parts
    are attached the largest change of a limb.
    """

    strained: bool
    badness: float
    wrong: int
    distortion: float
    wrung: float = 0.0


class Loan(NamedTuple):
    """A frame, and the neighbour whose correction it takes."""

    frame: int
    lender: int


class Snapshot(NamedTuple):
    """Poses (V, 3) of all frames, and how good they are."""

    result: list[FloatArray]
    merits: list[Merit]


class _Paid(NamedTuple):
    """Of which pose (V, 3) a loan was, which one it led to, and whether that is relaxed."""

    lent: FloatArray
    found: FloatArray
    relieved: bool


class _Borrowers:
    """Frames that borrow; a pool calls `solved`.

    Args:
        mesh: The mesh that was solved.
        loans: For each where the lender was led, what was found for it, and where the frame was
            led, poses (V, 3).
        effort: Factor of the work after which a frame is left as it is.
        options: What cleans a frame.
    """

    def __init__(
        self,
        mesh: WeldedMesh,
        loans: Sequence[tuple[FloatArray, FloatArray, FloatArray]],
        effort: float,
        options: LendingOptions,
    ) -> None:
        self.mesh, self.surface = mesh, mesh.surface
        self.loans, self.effort, self.options = loans, effort, options

    def solved(self, surface: Surface, index: int) -> FloatArray:
        """Return the pose (V, 3) that a loan leads to."""
        lent_from, found, lent_to = map(self.mesh.reduced, self.loans[index])
        unit, _ = solved_from(
            surface,
            lent_to,
            carried(surface, lent_from, lent_to, found - lent_from),
            scale=1.0,
            alone=None,
            steering=Steering(surface),
            effort=self.effort,
            options=self.options,
        )
        return self.mesh.expanded(self.loans[index][2], lent_to, unit)


class Borrowing:
    """The best poses (V, 3) of frames, and how good they are."""

    def __init__(
        self,
        scene: Scene,
        mesh: WeldedMesh,
        frames: Sequence[OpenedPose],
        poses: list[FloatArray],
        jobs: int | None,
        options: BorrowingOptions,
        *,
        leads: FloatArray | None = None,
    ) -> None:
        self.scene, self.mesh, self.frames, self.result = scene, mesh, frames, list(poses)
        self.jobs, self.options = jobs, options
        self._led = np.stack([frame.centred for frame in frames])
        if leads is not None:
            self._led += leads
        self.merits = [self.merit(*both) for both in zip(frames, poses, strict=True)]
        self.few = [options.left_share * frame.wrong for frame in frames]
        self._paid: dict[Loan, _Paid] = {}

    def solved(self, loans: Sequence[Loan], *, in_step: bool = False) -> list[FloatArray]:
        """Return the poses (V, 3) that loans lead to.

        in_step: of those that stand out no less than what is there, or in which more is wrong, that
        is returned instead: relaxing cures neither.
        """
        paid = self._paid
        # A loan of what has not changed leads where it did before.
        new = [k for k in loans if k not in paid or paid[k].lent is not self.result[k.lender]]
        for loan, pose in zip(new, self._unrelieved(new), strict=True):
            paid[loan] = _Paid(self.result[loan.lender], pose, relieved=False)
        rough = [k for k in loans if not paid[k].relieved]
        if in_step and rough:
            out = self.standing_out()
            rough = [k for k in rough if self._nearer(k.frame, paid[k].found, out[k.frame])]
        frames, poses = [self.frames[k.frame] for k in rough], [paid[k].found for k in rough]
        relieve = partial(relieved_poses, jobs=self.jobs, options=self.options.relief)
        relieved = relieve(self.scene, self.mesh, frames, poses)
        for loan, pose in zip(rough, relieved, strict=True):
            paid[loan] = paid[loan]._replace(found=pose, relieved=True)
        return [paid[k].found if paid[k].relieved else self.result[k.frame] for k in loans]

    def _unrelieved(self, loans: Sequence[Loan]) -> list[FloatArray]:
        """Return the poses (V, 3) that loans lead to, before they are relaxed."""
        of_loans = [
            (self._led[lender], self.result[lender], self._led[index]) for index, lender in loans
        ]
        effort = self.scene.options.effort
        return _solved(_Borrowers(self.mesh, of_loans, effort, self.options.lending), self.jobs)

    def _nearer(self, index: int, points: FloatArray, before: float) -> bool:
        """Return whether a pose (V, 3) of a frame would stand out less, with no more wrong."""
        kept, self.result[index] = self.result[index], points
        after = self.standing_out()[index]
        self.result[index] = kept
        wrong = wrong_of(self.scene, self.frames[index], points)
        return bool(after < before) and wrong <= self.merits[index].wrong

    def take(self, index: int, points: FloatArray) -> None:
        """Take a pose (V, 3) of a frame if it is better than what was found."""
        frame, than = self.frames[index], self.merits[index]
        merit = self.merit(frame, points)
        most = than.wrong
        if not self.scene.options.at_any_cost:
            most = max(most, int(self.few[index]))
        if merit < than and merit.wrong <= most and not too_far(self.scene, frame, points).any():
            self.result[index], self.merits[index] = points, merit

    def standing_out(self) -> FloatArray:
        """Return how far (T,) the part of each frame that does most stands out between two others.

        In units of the size; of a large part a limb's share counts.
        """
        parts = self.scene.strain_meter.parts
        found = standing_out(self._moved(), parts.of_vertex, limb=self.options.limb)
        return found / self.scene.scale.extent(self.frames[0].centred)

    def steps(self) -> FloatArray:
        """Return how far (T - 1,) corrections go from frame to frame, as `standing_out` does."""
        parts = self.scene.strain_meter.parts
        found = steps_between(self._moved(), parts.of_vertex, limb=self.options.limb)
        return found / self.scene.scale.extent(self.frames[0].centred)

    def _moved(self) -> list[FloatArray]:
        """Return the displacements (V, 3) of all frames."""
        both = zip(self.frames, self.result, strict=True)
        return [pose - frame.centred for frame, pose in both]

    def take_in_step(self, index: int, points: FloatArray) -> None:
        """Take a pose (V, 3) of a frame if it is no worse and stands out clearly less."""
        frame, kept, before = self.frames[index], self.result[index], self.standing_out()[index]
        if before <= self.options.stands_out:
            return  # a neighbour that was solved along no longer does
        merit = self.merit(frame, points)
        self.result[index] = points
        easier = merit.distortion < self.merits[index].distortion
        most = self.options.less_eased if easier else self.options.less
        less = self.standing_out()[index] <= most * before
        worse = merit.strained or merit.wrong > self.merits[index].wrong
        if less and not worse and not too_far(self.scene, frame, points).any():
            self.merits[index] = merit
        else:
            self.result[index] = kept

    def taken_on(self, run: Sequence[int], lender: int, most: float) -> bool:
        """Solve frames one from the other, the first from a lender; return whether none is worse.

        They stay as they were found, to be put back with `put_back`. most: what the steps to them
        are together at most, units of the size.
        """
        for index in run:
            frame = self.frames[index]
            (points,) = self.solved([Loan(index, lender)])
            merit = self.merit(frame, points)
            worse = merit.strained or merit.wrong > self.merits[index].wrong
            if worse or too_far(self.scene, frame, points).any():
                return False
            self.result[index], self.merits[index] = points, merit
            most -= float(self.steps()[min(index, lender)])
            if most < 0.0:
                return False
            lender = index
        return True

    def snapshot(self) -> Snapshot:
        """Return all poses, and how good they are."""
        return Snapshot(list(self.result), list(self.merits))

    def put_back(self, kept: Snapshot) -> None:
        """Take poses again that were the best."""
        self.result, self.merits = list(kept.result), list(kept.merits)

    def merit(self, frame: OpenedPose, points: FloatArray) -> Merit:
        """Return how good a pose (V, 3) of a frame is."""
        scene, bent = self.scene, 0.0
        excess = strain_of(scene, frame.centred, points)
        # Single skins were solved from their neighbours already.
        if scene.strain_meter.parts.count > 1:
            bent = distortion(frame.centred, points, scene.strain_meter.parts.edges)
        tied = self.mesh.surface.ties is not None
        wrung = scene.strain_meter.limb_change(frame.centred, points) if tied else 0.0
        return Merit(bool(excess), badness(excess), wrong_of(scene, frame, points), bent, wrung)


def _solved(state: _Borrowers, jobs: int | None) -> list[FloatArray]:
    """Return the poses (V, 3) that loans lead to."""
    surface, count = state.surface, len(state.loans)

    def solved_by(pool: WorkerPool) -> list[FloatArray]:
        pool.start(state)
        return list(pool.map("solved", range(count)))

    return with_workers(surface, worthwhile_jobs(jobs, count, len(surface.faces)), solved_by)
