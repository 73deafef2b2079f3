"""Devices by their names: what does not run there is told."""

from __future__ import annotations

import pytest

from dtrepair import device
from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.stages.devices import device_of_method, use_device


def test_the_default_method_runs_on_the_cpu_and_that_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(device, "resolve_device", lambda name: f"{name}:0")
    assert device_of_method("auto", "full") == ("cpu", [])
    assert device_of_method("auto", "paper") == ("auto:0", [])
    there, warnings = device_of_method("cuda", "full")
    assert there == "cpu" and "runs on the CPU" in warnings[0]


def test_a_device_that_is_not_there_is_a_usage_error() -> None:
    with pytest.raises(UsageError, match="--device: device should be auto"):
        use_device("gpu")
    with pytest.raises(UsageError, match="--device: device should be auto"):
        device_of_method("gpu", "full")
