"""Options are checked, frozen and named; every outcome has its meaning."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest

from dtrepair.intersect import MODES
from dtrepair.repair.options import (
    BRAKE_MASKS,
    ENERGIES,
    LAPLACIANS,
    METHODS,
    OPTIMIZERS,
    REST_CONTACTS,
    RepairOptions,
)

NAMES = {
    "method": METHODS,
    "mode": MODES,
    "optimizer": OPTIMIZERS,
    "energy": ENERGIES,
    "rest_contacts": REST_CONTACTS,
    "laplacian": LAPLACIANS,
    "brake_mask": BRAKE_MASKS,
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
        made(name, "")


@pytest.mark.parametrize(
    "name, wrong, least",
    [
        ("iterations", 0, 1),
        ("tighten", -1, 0),
        ("regularization", -1e-9, 0.0),
        ("clearance", -1.0, 0.0),
        ("regularization", float("nan"), 0.0),
        ("clearance", float("nan"), 0.0),
    ],
)
def test_numbers_have_a_least_value(name: str, wrong: float, least: float) -> None:
    with pytest.raises(ValueError, match=f"{name} should be at least"):
        made(name, wrong)
    assert getattr(made(name, least), name) == least


POSITIVE = ["diffusion", "inner_mobility", "kernel_power", "learning_rate", "brake_band"]


@pytest.mark.parametrize("wrong", [0.0, -0.5, float("nan")])
def test_a_largest_displacement_is_above_zero(wrong: float) -> None:
    """With 0 nothing could move, and nothing be repaired."""
    with pytest.raises(ValueError, match=r"maximum_displacement should be above 0, got"):
        made("maximum_displacement", wrong)


@pytest.mark.parametrize("name", POSITIVE)
@pytest.mark.parametrize("wrong", [0.0, -99.0, float("nan")])
def test_some_numbers_are_positive(name: str, wrong: float) -> None:
    with pytest.raises(ValueError, match=f"{name} should be positive"):
        made(name, wrong)


def test_inner_layers_move_no_more_freely_than_outer_ones() -> None:
    with pytest.raises(ValueError, match="inner_mobility should be at most 1"):
        RepairOptions(inner_mobility=1.5)
    assert RepairOptions(inner_mobility=1.0).inner_mobility == 1.0


@pytest.mark.parametrize("wrong", [2, 0, -1])
def test_an_even_exponent_is_refused(wrong: int) -> None:
    with pytest.raises(ValueError, match=f"exponent should be odd and positive, got {wrong}"):
        RepairOptions(kernel_exponent=wrong)


@pytest.mark.parametrize(
    "chosen",
    [
        {"kernel_exponent": 3, "energy": "conical"},
        {"kernel_power": 6.0, "energy": "point-to-plane"},
        {"brake_band": 2.0, "optimizer": "adam"},
        {"brake_mask": "vertex", "optimizer": "gradient-descent"},
    ],
    ids=str,
)
def test_numbers_belong_to_what_has_them(chosen: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(chosen))} is of .*, got"):
        RepairOptions(**chosen)


@pytest.mark.parametrize("name", [*POSITIVE, "regularization", "clearance", "maximum_displacement"])
def test_numbers_are_finite(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} should be finite"):
        made(name, float("inf"))


@pytest.mark.parametrize("name", ["iterations", "tighten", "kernel_exponent"])
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
