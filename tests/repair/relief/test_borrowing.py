"""Loans: which are solved and relaxed, and where a line of them ends."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.relief import borrowing
from dtrepair.repair.relief.borrowing import Borrowing, BorrowingOptions, Loan
from tests.repair.relief.test_starting_again import bent_wing


def test_a_run_ends_where_its_steps_are_too_long() -> None:
    scene, frame, mesh, whole, bent = bent_wing()

    def reached(run: list[int], lender: int, most: float) -> tuple[bool, int]:
        poses = [whole, bent, bent, whole]
        state = Borrowing(scene, mesh, [frame] * 4, poses, 1, BorrowingOptions())
        done = state.taken_on(run, lender, most)
        return done, sum(own is not bent for own in state.result[1:3])

    assert reached([1, 2], 0, np.inf) == reached([2, 1], 3, np.inf) == (True, 2)
    assert reached([1, 2], 0, 0.0) == reached([2, 1], 3, 0.0) == (False, 1)


def test_what_stands_out_no_less_is_not_relaxed(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, frame, mesh, whole, bent = bent_wing()
    asked, made = list[int](), list[int]()

    def relieved(*known: Any, **options: Any) -> list[FloatArray]:
        asked.append(len(known[3]))
        return list(known[3])

    def solved(state: Any, jobs: int | None) -> list[FloatArray]:
        made.append(len(state.loans))
        return [lent] * made[-1]

    monkeypatch.setattr(borrowing, "relieved_poses", relieved)
    monkeypatch.setattr(borrowing, "_solved", solved)
    for lent, relaxed in ((bent, 0), (whole, 1), (frame.centred, 0)):
        poses = [whole, bent, whole]
        state = Borrowing(scene, mesh, [frame] * 3, poses, 1, BorrowingOptions())
        made, asked = [], []
        (found,) = state.solved([Loan(1, 0)], in_step=True)
        # What was not relaxed is not handed out, nor left behind.
        assert found is (lent if relaxed else bent) and asked == [relaxed]
        assert state.result[1] is bent
        # Loans to strained frames always are, but each once, and none is solved again ...
        assert state.solved([Loan(1, 0)])[0] is lent and asked == [relaxed, 1 - relaxed]
        assert made == [1, 0]
        # ... while what lends is the same.
        state.result[0] = whole.copy()
        state.solved([Loan(1, 0)])
        assert made == [1, 0, 1] and asked[2] == 1


def test_a_frame_that_borrows_keeps_its_own_lead() -> None:
    scene, frame, mesh, whole, bent = bent_wing()
    lead = np.array([0.3, 0.1, 0.0])
    poses, moved = [whole + 0.5 * lead, bent + lead], list[float]()
    leads = np.multiply.outer([0.5, 1.0], np.tile(lead, (len(whole), 1)))
    for known in (leads, None):
        state = Borrowing(scene, mesh, [frame] * 2, poses, 1, BorrowingOptions(), leads=known)
        (found,) = state.solved([Loan(1, 0)])
        moved.append(float((found - whole).mean(axis=0) @ lead / (lead @ lead)))
    assert moved[0] == pytest.approx(1.0, abs=0.05)
    assert abs(moved[1] - 1.0) > 0.2
