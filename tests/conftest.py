"""Fixtures that several test files need."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

# The examples of property tests are the same everywhere, and how long one takes is no matter.
settings.register_profile("fixed", derandomize=True, database=None, deadline=None, max_examples=40)
settings.load_profile("fixed")

# On a busy machine any command may take so long that it would tell how far it is.
os.environ["DTREPAIR_HEARTBEAT"] = "0"

# Each process of the tests needs a gigabyte at times.
MOST_PROCESSES = 8


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One process for each processor that this one may use."""
    if hasattr(os, "sched_getaffinity"):
        return min(len(os.sched_getaffinity(0)), MOST_PROCESSES)
    return min(os.cpu_count() or 1, MOST_PROCESSES)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real meshes: DTREPAIR_DATA, else `../shared/data` beside the checkout."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("DTREPAIR_DATA", beside))
    if not folder.is_dir():
        pytest.skip("no shared data here: set DTREPAIR_DATA to its folder")
    return folder


@pytest.fixture(scope="session", autouse=True)
def _interrupts_arrive() -> Iterator[None]:
    """Shells start background jobs with SIGINT ignored, which every process below inherits."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
