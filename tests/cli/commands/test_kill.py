"""Repairs stopped by signals: SIGINT and SIGTERM at once, SIGKILL without a trace in the output."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.command_line import run, swaying, tube_stage

FRAMES = 120


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip that intersects here and there."""
    return tube_stage(tmp_path_factory.mktemp("clip") / "a.usdc", swaying(FRAMES))


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


def frames_kept(folder: Path) -> list[Path]:
    return list(folder.glob(".b.usdc.resume/[0-9a-f]*.npz"))


def wait_for_progress(folder: Path, process: subprocess.Popen[str]) -> None:
    """Wait until frames are kept; the process must not end before.

    Two: the process has counted the first one when the second one is there.
    """
    while len(frames_kept(folder)) < 2:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)


def workers_of(process: subprocess.Popen[str]) -> list[str]:
    """Numbers of the worker processes, once there are any."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    while not (found := children.read_text().split()):
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    return found


def ends(number: int | str) -> bool:
    """Wait for the end of a process; a minute means that it goes on."""
    for _ in range(6000):
        if not runs(number):
            return True
        time.sleep(0.01)
    return False


def runs(number: int | str) -> bool:
    """Whether a process is there and has not ended."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="worker processes are for Linux")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_no_worker_process_outlives_a_run(
    tmp_path: Path, clip: Path, number: signal.Signals
) -> None:
    output = tmp_path / "b.usdc"
    output.write_text("old")
    process = started(clip, output, "--jobs", 2, mode=[])
    workers = workers_of(process)
    process.send_signal(number)
    process.communicate(timeout=60)  # ends with the last of those that could write
    assert process.returncode in (128 + number, -number)
    assert all(ends(worker) for worker in workers)
    assert output.read_text() == "old"
    if number != signal.SIGKILL:
        assert set(listing(tmp_path)) <= {"b.usdc", ".b.usdc.resume"}


def test_one_job_forks_no_process(
    tmp_path: Path, clip: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse() -> int:
        raise AssertionError("one job should do its work itself")

    monkeypatch.setattr(os, "fork", refuse)
    done = run("repair", clip, "-o", tmp_path / "b.usdc", "--jobs", 1, "--frames", "1:8")
    assert done.code == 0 and "8 of 8 frames" in done.out, done.err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_a_run_at_once(tmp_path: Path, clip: Path, number: signal.Signals) -> None:
    output = tmp_path / "b.usdc"
    process = started(clip, output, "--jobs", 2)
    wait_for_progress(tmp_path, process)
    workers = workers_of(process) if sys.platform == "linux" else []
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert all(ends(worker) for worker in workers)
    assert err.strip().startswith("dtrepair: error: interrupted; no output was written; --resume")
    assert listing(tmp_path) == [".b.usdc.resume"]
    assert len(frames_kept(tmp_path)) < FRAMES


def test_killed_runs_leave_the_old_output_and_resume(tmp_path: Path, clip: Path) -> None:
    whole, output = tmp_path / "whole.usdc", tmp_path / "b.usdc"
    assert run("repair", clip, "-o", whole, "--alone").code == 0
    output.write_text("old")
    moments = random.Random(3)
    for _ in range(2):
        process = started(clip, output, "--resume", "--jobs", 2)
        wait_for_progress(tmp_path, process)
        workers = workers_of(process) if sys.platform == "linux" else []
        time.sleep(moments.uniform(0.0, 0.4))
        process.kill()
        process.communicate()
        assert all(ends(worker) for worker in workers)
        assert output.read_text() == "old"
    assert any(name.endswith(".tmp") for name in listing(tmp_path))
    assert run("repair", clip, "-o", output, "--alone", "--resume").code == 0
    assert output.read_bytes() == whole.read_bytes()
    assert listing(tmp_path) == ["b.usdc", "whole.usdc"]
