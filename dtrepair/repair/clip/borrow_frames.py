"""Frames that ended badly start again: from their neighbours, or by themselves.

Solved each for itself, a limb may leave another one by the short way in one frame and collapse in
the next. From a neighbour's correction, turned with its surroundings, the short way is found again,
and the character does not jump from one way to the other.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import distortion
from dtrepair.numerics.temporal import standing_out
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
        hopeless: What is farther beyond its bounds than this (see `badness`) does not start again:
            a soldier's straps crushed between layers are so by any way.
        stands_out: Of attached parts frames in which one moves by this much, root mean square,
            units of the size, farther than between its neighbours start again, too, and take what
            stands out ...
        less, less_eased: ... by at most this share of that; the second if edges change less, too.
        limb: Of a larger part so many vertices, those that stand out most, count: a leg is little
            of a skin.
        triangles: Of attached parts loans are made for so many triangles to each frame of a window,
            one at least, and first to strained frames: a loan is about as much work as a frame.
            Twice as many go to frames that stand out.
        left_share: Of what was wrong with the input so much may be left, of a lender and of what
            was borrowed: a share of a strained pose leaves more.
        lending: What cleans a frame from there.
        relief: What relaxes it then.
    """

    rough: float = 3.0
    rough_attached: float = 1.6
    smooth: float = 0.03
    hopeless: float = 30.0
    stands_out: float = 4e-3
    less: float = 0.6
    less_eased: float = 0.8
    limb: int = 1000
    triangles: int = 5000
    left_share: float = 0.1
    lending: LendingOptions = field(default_factory=LendingOptions)
    relief: ReliefOptions = field(default_factory=ReliefOptions)


class _Merit(NamedTuple):
    """How a pose is: the less the better.

    Whether and how far it is strained, what is wrong, and the distortion of its edges.
    """

    strained: bool
    badness: float
    wrong: int
    distortion: float


class _Loan(NamedTuple):
    """A frame, and the neighbour whose correction it takes."""

    frame: int
    lender: int


class _Borrowers:
    """Frames that borrow; a pool calls `solved`.

    Args:
        mesh: The mesh that was solved.
        loans: For each the input of the lender, what was found for it, and the input of the frame,
            poses (V, 3).
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


def started_again(
    scene: Scene,
    mesh: WeldedMesh,
    frames: Sequence[OpenedPose],
    poses: list[FloatArray],
    *,
    alone: Callable[[OpenedPose], FloatArray] | None = None,
    jobs: int | None = 1,
    options: BorrowingOptions = BorrowingOptions(),
) -> list[FloatArray]:
    """Return what was found (V, 3) for the frames, better where a neighbour shows how.

    Lenders are within the bounds, and little is left of what was wrong with them. With a clearance,
    which relaxing would close, nothing starts again.

    Args:
        scene, mesh: What was solved.
        frames, poses: The input, and what was found for it.
        alone: Solves a pose by itself, where it still is strained or has pairs.
        jobs: Workers; None: one a processor.
        options: The numbers.

    Raises:
        WorkerLost: a worker ended.
    """
    if scene.options.clearance > 0.0:
        return poses
    state = _Frames(scene, mesh, frames, poses, jobs, options)
    rough, most, tied = options.rough, 2 * len(frames), mesh.surface.ties is not None
    if tied:
        rough = options.rough_attached
        most = max(1, options.triangles * len(frames) // len(mesh.surface.faces))
    tried = _lent(
        state,
        lambda tried: _loans(state.merits, state.few, tried, rough, options),
        state.take,
        most,
    )
    if tied:
        _lent(
            state,
            lambda again: _loans_in_step(state, tried | again, options),
            state.take_in_step,
            2 * most,
        )
    # A limit of displacements leaves it no more room than it left the window.
    if alone is not None and scene.options.maximum_displacement is None:
        for index, merit in enumerate(state.merits):
            if merit.strained or merit.wrong:
                state.take(index, alone(frames[index]))
    return state.result


class _Frames:
    """The best poses (V, 3) of frames, and how good they are."""

    def __init__(
        self,
        scene: Scene,
        mesh: WeldedMesh,
        frames: Sequence[OpenedPose],
        poses: list[FloatArray],
        jobs: int | None,
        options: BorrowingOptions,
    ) -> None:
        self.scene, self.mesh, self.frames, self.result = scene, mesh, frames, list(poses)
        self.jobs, self.options = jobs, options
        self.merits = [self._merit(*both) for both in zip(frames, poses, strict=True)]
        self.few = [options.left_share * frame.wrong for frame in frames]

    def solved(self, loans: Sequence[_Loan]) -> list[FloatArray]:
        """Return the poses (V, 3) that loans lead to."""
        of_loans = [
            (self.frames[lender].centred, self.result[lender], self.frames[index].centred)
            for index, lender in loans
        ]
        scene, options = self.scene, self.options
        borrowers = _Borrowers(self.mesh, of_loans, scene.options.effort, options.lending)
        own = [self.frames[loan.frame] for loan in loans]
        found = _solved(borrowers, self.jobs)
        return relieved_poses(scene, self.mesh, own, found, jobs=self.jobs, options=options.relief)

    def take(self, index: int, points: FloatArray) -> None:
        """Take a pose (V, 3) of a frame if it is better than what was found."""
        frame, than = self.frames[index], self.merits[index]
        merit = self._merit(frame, points)
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
        moved = [pose - frame.centred for frame, pose in zip(self.frames, self.result, strict=True)]
        found = standing_out(moved, parts.of_vertex, limb=self.options.limb)
        return found / self.scene.scale.extent(self.frames[0].centred)

    def take_in_step(self, index: int, points: FloatArray) -> None:
        """Take a pose (V, 3) of a frame if it is no worse and stands out clearly less."""
        frame, kept, before = self.frames[index], self.result[index], self.standing_out()[index]
        if before <= self.options.stands_out:
            return  # a neighbour that was solved along no longer does
        merit = self._merit(frame, points)
        self.result[index] = points
        easier = merit.distortion < self.merits[index].distortion
        most = self.options.less_eased if easier else self.options.less
        less = self.standing_out()[index] <= most * before
        worse = merit.strained or merit.wrong > self.merits[index].wrong
        if less and not worse and not too_far(self.scene, frame, points).any():
            self.merits[index] = merit
        else:
            self.result[index] = kept

    def _merit(self, frame: OpenedPose, points: FloatArray) -> _Merit:
        """Return how good a pose (V, 3) of a frame is."""
        scene, bent = self.scene, 0.0
        excess = strain_of(scene, frame.centred, points)
        # Single skins were solved from their neighbours already.
        if scene.strain_meter.parts.count > 1:
            bent = distortion(frame.centred, points, scene.strain_meter.parts.edges)
        return _Merit(bool(excess), badness(excess), wrong_of(scene, frame, points), bent)


def _lent(
    state: _Frames,
    next_loans: Callable[[frozenset[_Loan]], list[_Loan]],
    take: Callable[[int, FloatArray], None],
    most: int,
) -> frozenset[_Loan]:
    """Make at most so many loans, as long as there are next ones, and return them.

    take: is given a frame and the pose (V, 3) that a loan leads to.
    """
    tried = frozenset[_Loan]()
    while loans := next_loans(tried)[: most - len(tried)]:
        tried |= frozenset(loans)
        for loan, points in zip(loans, state.solved(loans), strict=True):
            take(loan.frame, points)
    return tried


def _loans(
    merits: Sequence[_Merit],
    few: Sequence[float],
    tried: Collection[_Loan],
    rougher: float,
    options: BorrowingOptions,
) -> list[_Loan]:
    """Return the next loan, of those not tried, of each frame in need of one, strained ones first.

    few: so much may be wrong with a lender (T,); rougher: see `BorrowingOptions.rough`.
    """
    result = []
    for index, merit in enumerate(merits):
        for lender in (index - 1, index + 1):
            loan = _Loan(index, lender)
            if not 0 <= lender < len(merits) or loan in tried:
                continue
            other = merits[lender]
            good = few[lender] > 0.0 and not other.strained and other.wrong <= few[lender]
            rough = merit.distortion > max(options.smooth, rougher * other.distortion)
            if good and merit.badness <= options.hopeless and (merit.strained or rough):
                result.append(loan)
                break
    return sorted(result, key=lambda loan: not merits[loan.frame].strained)


def _loans_in_step(
    state: _Frames, tried: Collection[_Loan], options: BorrowingOptions
) -> list[_Loan]:
    """Return the next loan, of those not tried, of each frame that stands out, the farthest first.

    Strained frames had their turn.
    """
    out, merits, result = state.standing_out(), state.merits, []
    for index in np.argsort(-out)[: np.count_nonzero(out > options.stands_out)].tolist():
        loans = [
            _Loan(index, lender)
            for lender in (index - 1, index + 1)
            if not merits[lender].strained and merits[lender].wrong <= merits[index].wrong
        ]
        loans = [loan for loan in loans if loan not in tried and not merits[index].strained]
        if loans:
            result.append(min(loans, key=lambda loan: float(out[loan.lender])))
    return result


def _solved(state: _Borrowers, jobs: int | None) -> list[FloatArray]:
    """Return the poses (V, 3) that loans lead to."""
    surface, count = state.surface, len(state.loans)

    def solved_by(pool: WorkerPool) -> list[FloatArray]:
        pool.start(state)
        return list(pool.map("solved", range(count)))

    return with_workers(surface, worthwhile_jobs(jobs, count, len(surface.faces)), solved_by)
