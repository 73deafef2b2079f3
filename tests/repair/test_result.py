"""Results are values that do not change; words are made of them last."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, fields

import numpy as np
import pytest

from dtrepair.diagnosis import Status
from dtrepair.repair.result import Count, RepairResult, Solved, Stage


def test_every_outcome_that_leaves_something_to_do_says_what() -> None:
    assert [status.value for status in Status] == [
        "clean",
        "strained",
        "improved",
        "unchanged",
        "failed",
        "skipped",
    ]
    for status in Status:
        silent = status in (Status.CLEAN, Status.SKIPPED)
        assert (status.meaning == "") == silent
        assert f"{status}" == status.value


def test_results_hold_their_numbers() -> None:
    result = RepairResult(np.zeros((1, 3)), Count(2, 1), Count(0, 0), 3, Status.CLEAN)
    assert result.before == Count(triangles=2, pairs=1, inter_pairs=0)
    with pytest.raises(FrozenInstanceError):
        setattr(result, "iterations", 4)  # noqa: B010
    names = {field.name for field in fields(RepairResult)}
    assert {"points", "before", "after", "iterations", "status", "diagnosis", "stages"} <= names
    assert result.message == ""


def test_iterations_are_summed_over_stages() -> None:
    stages = [Stage("push 20", 3, 0, 0.1, 7, 0.0), Stage("fill", 0, 0, 0.1, 2, 0.0)]
    assert Solved(np.zeros((1, 3)), stages).iterations == 9
    assert Solved(np.zeros((1, 3))).iterations == 0
