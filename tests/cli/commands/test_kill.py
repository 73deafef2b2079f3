"""Repairs stopped by signals: SIGINT and SIGTERM at once, SIGKILL without a trace in the output."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.command_line import run, tube_stage

FRAMES = 40


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip that intersects here and there."""
    angles = 6.2 + 0.25 * np.sin(0.5 * np.arange(FRAMES))
    return tube_stage(tmp_path_factory.mktemp("clip") / "a.usdc", angles)


def listing(folder: Path) -> list[str]:
    return sorted(os.listdir(folder))


def started(
    clip: Path, output: Path, *options: object, mode: Sequence[str] = ("--alone",)
) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "dtrepair", "repair", clip, "-o", output, *mode, *options]
    return subprocess.Popen(
        [str(part) for part in command],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )


def wait_for_progress(folder: Path, process: subprocess.Popen[str]) -> None:
    """Wait until a frame is kept; the process must not end before."""
    while not list(folder.glob(".b.usdc.resume/[0-9a-f]*.npz")):
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)


def workers_of(process: subprocess.Popen[str]) -> list[str]:
    """Numbers of the worker processes, once there are any."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    while not (found := children.read_text().split()):
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    return found


def runs(number: int | str) -> bool:
    """Whether a process is there and has not ended."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="worker processes are for Linux")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
@pytest.mark.parametrize("options", [[], ["--alone"]], ids=["together", "alone"])
def test_no_worker_process_outlives_a_run(
    tmp_path: Path, clip: Path, options: list[str], number: signal.Signals
) -> None:
    output = tmp_path / "b.usdc"
    output.write_text("old")
    process = started(clip, output, "--jobs", 2, *options, mode=[])
    workers = workers_of(process)
    start = time.perf_counter()
    process.send_signal(number)
    process.communicate(timeout=30)  # ends with the last of those that could write
    assert time.perf_counter() - start < 2.5
    assert process.returncode in (128 + number, -number)
    # The system ends the workers of a killed process a moment after it.
    while any(runs(worker) for worker in workers) and time.perf_counter() - start < 5:
        time.sleep(0.01)
    assert not any(runs(worker) for worker in workers)
    assert output.read_text() == "old"
    if number != signal.SIGKILL:
        assert set(listing(tmp_path)) <= {"b.usdc", ".b.usdc.resume"}


@pytest.mark.skipif(sys.platform != "linux", reason="worker processes are for Linux")
def test_one_job_starts_no_process(tmp_path: Path, clip: Path) -> None:
    output = tmp_path / "b.usdc"
    looks: Counter[str] = Counter()
    with started(clip, output, "--jobs", 1, "--frames", "1:8", mode=[]) as process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        while process.poll() is None:
            try:
                looks.update(children.read_text().split())
            except OSError:  # it has ended
                pass
            time.sleep(0.02)
        out, err = process.communicate()
    assert process.returncode == 0 and "8 of 8 frames" in out, err
    # Libraries ask the system for the processor's name, in a process of a few milliseconds.
    assert all(count < 5 for count in looks.values())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_a_run_at_once(tmp_path: Path, clip: Path, number: signal.Signals) -> None:
    output = tmp_path / "b.usdc"
    process = started(clip, output)
    wait_for_progress(tmp_path, process)
    start = time.perf_counter()
    process.send_signal(number)
    _, err = process.communicate(timeout=30)
    assert time.perf_counter() - start < 2.5
    assert process.returncode == 128 + number
    assert err.strip().startswith("dtrepair: error: interrupted; no output was written; --resume")
    assert listing(tmp_path) == [".b.usdc.resume"]


def test_killed_runs_leave_the_old_output_and_resume(tmp_path: Path, clip: Path) -> None:
    whole, output = tmp_path / "whole.usdc", tmp_path / "b.usdc"
    assert run("repair", clip, "-o", whole, "--alone").code == 0
    output.write_text("old")
    moments = random.Random(3)
    for _ in range(2):
        process = started(clip, output, "--resume")
        wait_for_progress(tmp_path, process)
        time.sleep(moments.uniform(0.0, 0.4))
        process.kill()
        process.communicate()
        assert output.read_text() == "old"
    assert any(name.endswith(".tmp") for name in listing(tmp_path))
    assert run("repair", clip, "-o", output, "--alone", "--resume").code == 0
    assert output.read_bytes() == whole.read_bytes()
    assert listing(tmp_path) == ["b.usdc", "whole.usdc"]
