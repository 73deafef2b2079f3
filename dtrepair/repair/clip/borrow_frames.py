"""Strained and rough frames of a clip start again from the corrections of their neighbours.

Solved each for itself, a limb may leave another one by the short way in one frame and collapse in
the next. From a neighbour's correction, turned with its surroundings, the short way is found again,
and the character does not jump from one way to the other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.numerics.metrics import distortion
from dtrepair.repair.frame.lending import LendingOptions, carried, solved_from
from dtrepair.repair.full.steering import Steering
from dtrepair.repair.parallel.worker_pool import WorkerPool, with_workers, worthwhile_jobs
from dtrepair.repair.relief.relief import ReliefOptions, relieved_poses
from dtrepair.repair.relief.swelling import ROUNDING
from dtrepair.repair.scene.bounds import badness, strain_of, wrong_of
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh
from dtrepair.repair.surface.surface import Surface


@dataclass(frozen=True, kw_only=True)
class BorrowingOptions:
    """How strained frames start again.

    Args:
        tries: So many times a frame may start again.
        rough: One of attached parts, whose frames are solved each for itself, starts again as well
            where it is distorted so many times as much as a neighbour, ...
        smooth: ... and more than this.
        left_share: Of what was wrong with the input so much may be left, of a lender and of what
            was borrowed: a share of a strained pose leaves more.
        lending: What cleans a frame from there.
        relief: What relaxes it then.
    """

    tries: int = 2
    rough: float = 2.0
    smooth: float = 0.05
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
        options: What cleans a frame.
    """

    def __init__(
        self,
        mesh: WeldedMesh,
        loans: Sequence[tuple[FloatArray, FloatArray, FloatArray]],
        options: LendingOptions,
    ) -> None:
        self.mesh, self.surface = mesh, mesh.surface
        self.loans, self.options = loans, options

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
            options=self.options,
        )
        return self.mesh.expanded(self.loans[index][2], lent_to, unit)


def with_borrowed(
    scene: Scene,
    mesh: WeldedMesh,
    frames: Sequence[OpenedPose],
    poses: list[FloatArray],
    *,
    jobs: int | None = 1,
    options: BorrowingOptions = BorrowingOptions(),
) -> list[FloatArray]:
    """Return what was found (V, 3) for the frames, less strained where a neighbour shows how.

    Lenders are within the bounds, and little is left of what was wrong with them. jobs: workers;
    None: one a processor. Raises WorkerLost.
    """
    if scene.options.clearance > 0.0:
        return poses
    result = list(poses)
    merits = [_merit(scene, *both) for both in zip(frames, poses, strict=True)]
    few = [options.left_share * frame.wrong for frame in frames]
    tried: list[list[_Loan]] = [[] for _ in frames]
    while loans := _loans(merits, few, tried, options):
        for loan in loans:
            tried[loan.frame].append(loan)
        poses_of = [
            (frames[lender].centred, result[lender], frames[index].centred)
            for index, lender in loans
        ]
        state = _Borrowers(mesh, poses_of, options.lending)
        own = [frames[loan.frame] for loan in loans]
        found = _solved(state, jobs)
        found = relieved_poses(scene, mesh, own, found, jobs=jobs, options=options.relief)
        for (index, _), points in zip(loans, found, strict=True):
            if (merit := _better(scene, frames[index], points, merits[index], options)) is not None:
                result[index], merits[index] = points, merit
    return result


def with_alone(
    scene: Scene,
    frames: Sequence[OpenedPose],
    poses: list[FloatArray],
    alone: Callable[[OpenedPose], FloatArray],
    *,
    options: BorrowingOptions = BorrowingOptions(),
) -> list[FloatArray]:
    """Return what was found (V, 3), that of strained and dirty frames solved alone if better."""
    result = list(poses)
    for index, (frame, points) in enumerate(zip(frames, poses, strict=True)):
        merit = _merit(scene, frame, points)
        if not merit.strained and not merit.wrong:
            continue
        found = alone(frame)
        if _better(scene, frame, found, merit, options) is not None:
            result[index] = found
    return result


def _loans(
    merits: Sequence[_Merit],
    few: Sequence[float],
    tried: Sequence[Sequence[_Loan]],
    options: BorrowingOptions,
) -> list[_Loan]:
    """Return the next loan of each frame in need that may still try one.

    few: so much may be wrong with a lender (T,).
    """
    result = []
    for index, merit in enumerate(merits):
        if len(tried[index]) == options.tries:
            continue
        for lender in (index - 1, index + 1):
            loan = _Loan(index, lender)
            if not 0 <= lender < len(merits) or loan in tried[index]:
                continue
            other = merits[lender]
            good = few[lender] > 0.0 and not other.strained and other.wrong <= few[lender]
            rough = merit.distortion > max(options.smooth, options.rough * other.distortion)
            if good and (merit.strained or rough):
                result.append(loan)
                break
    return result


def _solved(state: _Borrowers, jobs: int | None) -> list[FloatArray]:
    """Return the poses (V, 3) that loans lead to."""
    surface, count = state.surface, len(state.loans)

    def solved_by(pool: WorkerPool) -> list[FloatArray]:
        pool.start(state)
        return list(pool.map("solved", range(count)))

    return with_workers(surface, worthwhile_jobs(jobs, count, len(surface.faces)), solved_by)


def _merit(scene: Scene, frame: OpenedPose, points: FloatArray) -> _Merit:
    """Return how good a pose (V, 3) of a frame is."""
    excess = strain_of(scene, frame.centred, points)
    bent = 0.0
    if scene.strain_meter.parts.ties is not None:
        bent = distortion(frame.centred, points, scene.strain_meter.parts.edges)
    return _Merit(bool(excess), badness(excess), wrong_of(scene, frame, points), bent)


def _better(
    scene: Scene,
    frame: OpenedPose,
    points: FloatArray,
    than: _Merit,
    options: BorrowingOptions,
) -> _Merit | None:
    """Return how good a pose (V, 3) of a frame is, if it is better than what was found."""
    merit = _merit(scene, frame, points)
    most = max(than.wrong, options.left_share * frame.wrong)
    if merit >= than or merit.wrong > most or _too_far(scene, frame, points):
        return None
    return merit


def _too_far(scene: Scene, frame: OpenedPose, points: FloatArray) -> bool:
    """Return whether a correction goes beyond the limit of displacements."""
    limit = scene.options.maximum_displacement
    if limit is None:
        return False
    return bool(lengths(points - frame.centred).max() > limit * (1.0 - ROUNDING))
