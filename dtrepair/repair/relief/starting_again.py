"""Frames that ended badly start again: from their neighbours, or by themselves.

Solved each for itself, a limb may leave another one by the short way in one frame and collapse in
the next. From a neighbour's correction, turned with its surroundings, the short way is found again,
and the character does not jump from one way to the other.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import partial
from itertools import pairwise

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.relief.borrowing import Borrowing, BorrowingOptions, Loan, Merit
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh


def started_again(
    scene: Scene,
    mesh: WeldedMesh,
    frames: Sequence[OpenedPose],
    poses: list[FloatArray],
    *,
    leads: FloatArray | None = None,
    alone: Callable[[OpenedPose], FloatArray] | None = None,
    jobs: int | None = 1,
    options: BorrowingOptions = BorrowingOptions(),
) -> list[FloatArray]:
    """Return what was found (V, 3) for the frames, better where a neighbour shows how.

    Lenders are within the bounds, and little is left of what was wrong with them.

    Args:
        scene, mesh: What was solved.
        frames, poses: The input, and what was found for it.
        leads: How far each frame was led before it was solved (T, V, 3): one that borrows begins
            there, or it would jump beside the others; None: none was.
        alone: Solves a pose by itself, where it still is strained or has pairs.
        jobs: Workers; None: one a processor.
        options: The numbers.

    Raises:
        WorkerLost: a worker ended.
    """
    state = Borrowing(scene, mesh, frames, poses, jobs, options, leads=leads)
    rough, most, tied = options.rough, 2 * len(frames), mesh.surface.ties is not None
    if tied:
        rough = options.rough_attached
        most = max(1, options.triangles * len(frames) // len(mesh.surface.faces))
    tried = _lent(
        lambda tried: _loans(state.merits, state.few, tried, rough, options),
        state.solved,
        state.take,
        most,
    )
    if tied:
        _lent(
            lambda again: _loans_in_step(state, tried | again, options),
            partial(state.solved, in_step=True),
            state.take_in_step,
            2 * most,
        )
        _runs_in_step(state, 2 * most)
    # A limit of displacements leaves it no more room than it left the window.
    if alone is not None and scene.options.maximum_displacement is None:
        for index, merit in enumerate(state.merits):
            if merit.strained or merit.wrong:
                state.take(index, alone(frames[index]))
    return state.result


def _lent(
    next_loans: Callable[[frozenset[Loan]], list[Loan]],
    solved: Callable[[list[Loan]], list[FloatArray]],
    take: Callable[[int, FloatArray], None],
    most: int,
) -> frozenset[Loan]:
    """Make at most so many loans, as long as there are next ones, and return them.

    solved: finds the poses (V, 3) that loans lead to; take: is given a frame and that pose.
    """
    tried = frozenset[Loan]()
    while loans := next_loans(tried)[: most - len(tried)]:
        tried |= frozenset(loans)
        for loan, points in zip(loans, solved(loans), strict=True):
            take(loan.frame, points)
    return tried


def _loans(
    merits: Sequence[Merit],
    few: Sequence[float],
    tried: Collection[Loan],
    rougher: float,
    options: BorrowingOptions,
) -> list[Loan]:
    """Return the next loan, of those not tried, of each frame in need of one, strained ones first.

    few: so much may be wrong with a lender (T,); rougher: see `BorrowingOptions.rough`.
    """
    result = []
    for index, merit in enumerate(merits):
        for lender in (index - 1, index + 1):
            loan = Loan(index, lender)
            if not 0 <= lender < len(merits) or loan in tried:
                continue
            other = merits[lender]
            good = few[lender] > 0.0 and not other.strained and other.wrong <= few[lender]
            rough = merit.distortion > max(options.smooth, rougher * other.distortion)
            rough |= merit.wrung > max(options.wrung, other.wrung)
            if good and merit.badness <= options.hopeless and (merit.strained or rough):
                result.append(loan)
                break
    return sorted(result, key=lambda loan: not merits[loan.frame].strained)


def _loans_in_step(
    state: Borrowing, tried: Collection[Loan], options: BorrowingOptions
) -> list[Loan]:
    """Return the next loan, of those not tried, of each frame that stands out, the farthest first.

    Strained frames had their turn.
    """
    out, merits, result = state.standing_out(), state.merits, []
    for index in np.argsort(-out)[: np.count_nonzero(out > options.stands_out)].tolist():
        loans = [
            Loan(index, lender)
            for lender in (index - 1, index + 1)
            if not merits[lender].strained and merits[lender].wrong <= merits[index].wrong
        ]
        loans = [loan for loan in loans if loan not in tried and not merits[index].strained]
        if loans:
            result.append(min(loans, key=lambda loan: float(out[loan.lender])))
    return result


def _runs_in_step(state: Borrowing, most: int) -> None:
    """Solve runs of frames between two jumps from what is before or behind them, if that is nearer.

    With at most so many loans. No single frame of such a run stands out but its ends, and these as
    far from one side as from the other.
    """
    options = state.options
    for first, last in pairwise(np.flatnonzero(state.steps() > options.jump).tolist()):
        run, steps = list(range(first + 1, last + 1)), state.steps()
        # The run before may have taken the first jump away.
        jumps = min(steps[first], steps[last]) > options.jump
        # Strained frames have loans of their own.
        strained = any(state.merits[index].strained for index in run)
        if strained or not jumps or len(run) > options.run or 2 * len(run) > most:
            continue
        most -= 2 * len(run)
        best = known = state.snapshot()
        least = options.less * steps[first : last + 1].sum()
        for own, lender in ((run, first), (run[::-1], last + 1)):
            lent, found = state.merits[lender], state.merits[own[0]]
            good = not lent.strained and lent.wrong <= found.wrong
            if good and state.taken_on(own, lender, least):
                way = state.steps()[first : last + 1].sum()
                if way < least:
                    best, least = state.snapshot(), way
            state.put_back(known)
        state.put_back(best)
