"""The check for machines with a GPU runs on the CPU, and fails where something differs."""

from __future__ import annotations

import pytest
import torch

from benchmarks import gpu_check
from dtrepair.repair.paper.gpu_operators import Forces

SMALL = ["--cpu", "--triangles", "800", "--frames", "3"]


def test_all_checks_hold_on_the_cpu(capsys: pytest.CaptureFixture[str]) -> None:
    assert gpu_check.main(SMALL) == 0
    out = capsys.readouterr().out
    assert "Device: the CPU (cpu)" in out and "All checks hold." in out
    assert out.count("| yes |") == 13 and "| 60 iterations |" in out


def test_what_differs_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    right = Forces.__call__
    monkeypatch.setattr(Forces, "__call__", lambda *own: 1.001 * right(*own))
    monkeypatch.setattr(gpu_check, "timings", lambda *_: [("60 iterations", 1.0)])
    assert gpu_check.main(SMALL) == 1
    out = capsys.readouterr().out
    assert "| forces, conical | NO | 1.0e-03 relative |" in out
    assert "| repairs: points | NO |" in out and "checks failed" in out


def test_a_machine_without_a_gpu_is_told_what_to_do(capsys: pytest.CaptureFixture[str]) -> None:
    if torch.cuda.is_available():
        pytest.skip("there is a GPU")
    assert gpu_check.main([]) == 2
    assert "PyTorch sees 0 CUDA devices" in capsys.readouterr().err
