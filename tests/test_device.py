"""Device names, and the silent start of Warp."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import pytest
import torch

from dtrepair import device
from dtrepair.device import resolve_device, start_warp


def pretend(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    """Let Warp and PyTorch see `count` CUDA devices."""
    warp = SimpleNamespace(get_cuda_device_count=lambda: count)
    monkeypatch.setattr(device, "start_warp", lambda: warp)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: count > 0)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)


def test_cpu_is_the_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, 2)
    assert resolve_device("cpu") == "cpu"


def test_auto_takes_the_first_gpu_or_the_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, 0)
    assert resolve_device("auto") == "cpu"
    pretend(monkeypatch, 2)
    assert resolve_device("auto") == "cuda:0"


def test_cuda_with_and_without_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, 2)
    assert resolve_device("cuda") == "cuda:0"
    assert resolve_device("cuda:1") == "cuda:1"


@pytest.mark.parametrize("name", ["gpu", "cuda:", "cuda:x", "cuda:-1", "", "CPU", "cuda1"])
def test_unknown_names_are_named(name: str) -> None:
    with pytest.raises(ValueError, match="device should be auto, cpu, cuda or cuda:N, got"):
        resolve_device(name)


@pytest.mark.parametrize(("name", "count"), [("cuda", 0), ("cuda:2", 2)])
def test_devices_that_are_not_there_are_named(
    monkeypatch: pytest.MonkeyPatch, name: str, count: int
) -> None:
    pretend(monkeypatch, count)
    with pytest.raises(ValueError, match=f"PyTorch sees {count} CUDA devices; use 'cpu'"):
        resolve_device(name)


def test_warp_starts_silently() -> None:
    code = (
        "import numpy as np\n"
        "from dtrepair import find_intersections\n"
        "from dtrepair.device import start_warp\n"
        "assert start_warp() is start_warp()\n"
        "find_intersections(np.eye(3), [[0, 1, 2]])\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (run.stdout, run.stderr) == ("", "")


def test_standard_error_still_works_after_the_start() -> None:
    code = "import sys; from dtrepair.device import start_warp; start_warp(); sys.stderr.write('x')"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stderr == "x"


def test_start_warp_is_the_module() -> None:
    import warp

    assert start_warp() is warp
