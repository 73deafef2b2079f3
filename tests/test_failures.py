"""Devices as the command line takes them: what does not run there is told."""

from __future__ import annotations

import pytest

from dtrepair import device
from dtrepair.cli.failures import Failure, device_warnings, use_device


def test_auto_is_the_cpu_for_a_method_that_runs_there_only(monkeypatch) -> None:
    monkeypatch.setattr(device, "resolve_device", lambda name: f"resolved {name}")
    assert use_device("auto", method="full") == "cpu"
    assert use_device("auto", method="paper") == use_device("auto") == "resolved auto"
    assert use_device("cuda", method="full") == "resolved cuda"


def test_a_device_that_only_counts_is_told() -> None:
    assert "counts intersections only" in device_warnings("cuda:0", "full")[0]
    assert device_warnings("cuda:0", "paper") == device_warnings("cpu", "full") == []


def test_a_device_that_is_not_there_is_a_usage_error() -> None:
    with pytest.raises(Failure, match="--device: device should be auto"):
        use_device("gpu")
