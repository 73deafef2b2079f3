"""Options are checked, frozen and named; every outcome has its meaning."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, fields
from typing import Any

import numpy as np
import pytest

from dtrepair.repair.options import (
    ENERGIES,
    METHODS,
    MODES,
    OPTIMIZERS,
    REST_CONTACTS,
    Count,
    RepairOptions,
    RepairResult,
    Solved,
    Stage,
    Status,
)

NAMES = {
    "method": METHODS,
    "mode": MODES,
    "optimizer": OPTIMIZERS,
    "energy": ENERGIES,
    "rest_contacts": REST_CONTACTS,
}


def made(name: str, value: Any) -> RepairOptions:
    """Options with one of them chosen."""
    return RepairOptions(**{name: value})


@pytest.mark.parametrize("name", NAMES)
def test_names_are_checked(name: str) -> None:
    for allowed in NAMES[name]:
        assert getattr(made(name, allowed), name) == allowed
    with pytest.raises(ValueError, match=f"{name} should be one of .*, got 'wrong'"):
        made(name, "wrong")
    with pytest.raises(ValueError, match=f"{name} should be one of"):
        made(name, None)


@pytest.mark.parametrize(
    "name, wrong, least",
    [
        ("iterations", 0, 1),
        ("tighten", -1, 0),
        ("regularization", -1e-9, 0.0),
        ("clearance", -1.0, 0.0),
        ("regularization", float("nan"), 0.0),
        ("clearance", float("nan"), 0.0),
        ("maximum_displacement", -0.5, 0.0),
        ("maximum_displacement", float("nan"), 0.0),
    ],
)
def test_numbers_have_a_least_value(name: str, wrong: float, least: float) -> None:
    with pytest.raises(ValueError, match=f"{name} should be at least"):
        made(name, wrong)
    assert getattr(made(name, least), name) == least


@pytest.mark.parametrize("wrong", [0.0, -99.0, float("nan")])
def test_diffusion_is_positive(wrong: float) -> None:
    with pytest.raises(ValueError, match="diffusion should be positive"):
        RepairOptions(diffusion=wrong)


@pytest.mark.parametrize(
    "name", ["diffusion", "regularization", "clearance", "maximum_displacement"]
)
def test_numbers_are_finite(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} should be finite"):
        made(name, float("inf"))


@pytest.mark.parametrize("name", ["iterations", "tighten"])
def test_counts_are_whole(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} should be a whole number, got 2.5"):
        made(name, 2.5)
    assert getattr(made(name, np.int64(3)), name) == 3


@pytest.mark.parametrize("control", [{"maximum_displacement": 0.1}, {"clearance": 0.1}])
def test_the_paper_has_no_such_controls(control: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="should be left out with the method paper"):
        RepairOptions(method="paper", **control)
    assert RepairOptions(**control).method == "full"


def test_options_are_frozen_and_keyword_only() -> None:
    options = RepairOptions()
    with pytest.raises(FrozenInstanceError):
        setattr(options, "method", "paper")  # noqa: B010
    with pytest.raises(TypeError):
        RepairOptions("paper")  # type: ignore[call-arg]
    assert RepairOptions() == RepairOptions() and hash(RepairOptions()) == hash(RepairOptions())


def test_every_outcome_that_leaves_something_to_do_says_what() -> None:
    assert [status.value for status in Status] == [
        "clean",
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
    assert {"points", "before", "after", "iterations", "status", "message", "stages"} <= names


def test_iterations_are_summed_over_stages() -> None:
    stages = [Stage("push 20", 3, 0, 0.1, 7, 0.0), Stage("fill", 0, 0, 0.1, 2, 0.0)]
    assert Solved(np.zeros((1, 3)), stages).iterations == 9
    assert Solved(np.zeros((1, 3))).iterations == 0
