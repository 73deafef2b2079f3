"""Options are checked, frozen and named; every outcome has its meaning."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest

from dtrepair.intersect import MODES
from dtrepair.repair.options import (
    ENERGIES,
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
