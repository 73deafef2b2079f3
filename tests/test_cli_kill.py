"""Repairs stopped by signals: SIGINT and SIGTERM at once, SIGKILL without a trace in the output."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from command_line import run, tube_stage

FRAMES = 40


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """A clip that intersects here and there."""
    angles = 6.2 + 0.25 * np.sin(0.5 * np.arange(FRAMES))
    return tube_stage(tmp_path_factory.mktemp("clip") / "a.usdc", angles)


def listing(folder):
    return sorted(os.listdir(folder))


def started(clip, output, *options):
    command = [sys.executable, "-m", "dtrepair", "repair", clip, "-o", output, "--alone", *options]
    return subprocess.Popen(
        [str(part) for part in command],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )


def wait_for_progress(folder, process):
    """Wait until a frame is kept; the process must not end before."""
    while not list(folder.glob(".b.usdc.resume/[0-9a-f]*.npz")):
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_a_run_at_once(tmp_path, clip, number):
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


def test_killed_runs_leave_the_old_output_and_resume(tmp_path, clip):
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
