"""Runs of frames between two jumps: which are solved again, from where, and what is kept."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.relief.borrowing import BorrowingOptions, Merit
from dtrepair.repair.relief.starting_again import _runs_in_step

GOOD = Merit(strained=False, badness=0.0, wrong=0, distortion=0.0)
STRAINED, WRONG = GOOD._replace(strained=True), GOOD._replace(wrong=3)


class Line:
    """Frames whose correction is a number; what solving them from either side gives is told.

    lent: the correction that a run gets from a lender; worse: lenders from whom it is worse.
    """

    def __init__(
        self,
        *found: float,
        lent: dict[int, float],
        worse: Sequence[int] = (),
        merits: dict[int, Merit] | None = None,
        **options: Any,
    ) -> None:
        self.result, self.lent, self.worse = list(found), lent, worse
        self.merits = [(merits or {}).get(k, GOOD) for k in range(len(found))]
        self.options = BorrowingOptions(jump=0.5, **options)
        self.asked: list[tuple[list[int], int]] = []
        self.most: list[float] = []

    def steps(self) -> FloatArray:
        return np.abs(np.diff(self.result))

    def snapshot(self) -> list[float]:
        return list(self.result)

    def put_back(self, kept: list[float]) -> None:
        self.result = list(kept)

    def taken_on(self, run: Sequence[int], lender: int, most: float) -> bool:
        self.asked.append((list(run), lender))
        self.most.append(most)
        for frame in run:
            self.result[frame] = self.lent[lender]
        return lender not in self.worse

    def run(self, most: int = 100) -> list[float]:
        _runs_in_step(self, most)  # type: ignore[arg-type]
        return self.result


def test_a_run_is_solved_from_both_sides_and_keeps_the_nearer_way() -> None:
    for nearer, lent in ((0.1, {0: 0.1, 3: 0.3}), (0.2, {0: 0.4, 3: 0.2})):
        line = Line(0.0, 1.0, 1.0, 0.0, lent=lent)
        assert line.run() == [0.0, nearer, nearer, 0.0]
        assert line.asked == [([1, 2], 0), ([2, 1], 3)]
        # The second way has to be nearer than the first one.
        assert line.most == [1.2, 2.0 * lent[0]]


@pytest.mark.parametrize(("lent", "taken"), [(0.55, True), (0.65, False), (1.3, False)])
def test_it_is_kept_where_steps_shrink_clearly(lent: float, taken: bool) -> None:
    line = Line(0.0, 1.0, 1.0, 0.0, lent={0: lent, 3: lent})
    assert line.run() == [0.0, *[lent if taken else 1.0] * 2, 0.0]


def test_what_is_worse_is_put_back() -> None:
    line = Line(0.0, 1.0, 1.0, 0.0, lent={0: 0.0, 3: 0.0}, worse=(0, 3))
    assert line.run() == [0.0, 1.0, 1.0, 0.0]
    line = Line(0.0, 1.0, 1.0, 0.0, lent={0: 0.0, 3: 0.2}, worse=(0,))
    assert line.run() == [0.0, 0.2, 0.2, 0.0]


def test_lenders_are_within_the_bounds_and_no_worse() -> None:
    for merit in (STRAINED, WRONG):
        line = Line(0.0, 1.0, 1.0, 0.0, lent={3: 0.2}, merits={0: merit})
        assert line.run() == [0.0, 0.2, 0.2, 0.0] and line.asked == [([2, 1], 3)]
    line = Line(0.0, 1.0, 1.0, 0.0, lent={0: 0.1, 3: 0.2}, merits=dict.fromkeys((0, 1, 2), WRONG))
    assert line.run() == [0.0, 0.1, 0.1, 0.0]


def test_strained_frames_are_in_no_run() -> None:
    line = Line(0.0, 1.0, 1.0, 0.0, lent={0: 0.1, 3: 0.2}, merits={2: STRAINED})
    assert line.run() == [0.0, 1.0, 1.0, 0.0] and not line.asked


def test_only_short_runs_are_and_no_more_than_may_be() -> None:
    found, lent = (0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0), {0: 0.0, 3: 0.0, 4: 0.0, 6: 0.0}
    assert Line(*found, lent=lent).run() == [0.0] * 7
    assert Line(*found, lent=lent, run=1).run() == [0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    assert Line(*found, lent=lent).run(most=3) == [0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    # The first run is what may be solved.
    assert Line(*found, lent=lent).run(most=5) == [0.0] * 4 + [0.0, 1.0, 0.0]
    assert Line(0.0, 1.0, 1.0, 0.0, lent=lent).run(most=4) == [0.0] * 4


def test_a_jump_that_is_gone_begins_no_run() -> None:
    line = Line(0.0, 1.0, 0.0, 1.0, 1.0, lent={0: 0.0, 2: 0.0, 1: 9.0, 3: 9.0})
    assert line.run() == [0.0, 0.0, 0.0, 1.0, 1.0]
    assert line.asked == [([1], 0), ([1], 2)]
