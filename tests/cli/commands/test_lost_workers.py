"""Workers that are killed: their frames are solved again, with the same bytes, or none is there."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from dtrepair.repair import repairer
from dtrepair.repair.independent import repair_poses
from dtrepair.repair.parallel.process_pool import ATTEMPTS, can_fork
from dtrepair.repair.parallel.worker_pool import ProcessWorkerPool
from tests.command_line import assert_fails, run, swaying, tube_stage

pytestmark = pytest.mark.skipif(not can_fork(), reason="needs processes that can be forked")

FRAMES = 14  # fewer are done before workers have started


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip that intersects here and there."""
    return tube_stage(tmp_path_factory.mktemp("clip") / "a.usdc", swaying(FRAMES))


@pytest.fixture(params=[(), ("--alone",)], ids=["together", "alone"])
def mode(request: pytest.FixtureRequest) -> tuple[str, ...]:
    options: tuple[str, ...] = request.param
    return options


@pytest.fixture
def kill(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[int], Path]:
    """Kills so many worker processes at work; the folder has a file for each of them."""
    here, killed = os.getpid(), tmp_path / "killed"
    killed.mkdir()
    call, solve = ProcessWorkerPool._called, repair_poses

    def most(number: int) -> Path:
        def die() -> None:
            if os.getpid() == here:
                return
            # Workers that look at the same time must not take the same turn.
            for turn in range(number):
                with suppress(FileExistsError):
                    (killed / str(turn)).touch(exist_ok=False)
                    os.kill(os.getpid(), signal.SIGKILL)

        def called(*arguments: Any) -> Any:
            die()
            return call(*arguments)

        def solved(*arguments: Any, **options: Any) -> Any:
            die()
            return solve(*arguments, **options)

        monkeypatch.setattr(ProcessWorkerPool, "_called", called)
        monkeypatch.setattr(repairer, "repair_poses", solved)
        return killed

    return most


def test_a_lost_worker_changes_no_byte(
    tmp_path: Path, clip: Path, mode: tuple[str, ...], kill: Callable[[int], Path]
) -> None:
    whole, output = tmp_path / "whole.usdc", tmp_path / "b.usdc"
    assert run("repair", clip, "-o", whole, "--jobs", 2, *mode).code == 0
    killed = kill(1)
    done = run("repair", clip, "-o", output, "--jobs", 2, *mode)
    assert done.code == 0 and done.err == "" and len(os.listdir(killed)) == 1
    assert output.read_bytes() == whole.read_bytes()


def test_workers_lost_again_and_again_end_the_run(
    tmp_path: Path, clip: Path, mode: tuple[str, ...], kill: Callable[[int], Path]
) -> None:
    output = tmp_path / "b.usdc"
    output.write_text("old")
    killed = kill(99)
    done = run("repair", clip, "-o", output, "--jobs", 2, *mode)
    assert_fails(done, 7, "worker processes ended", "fewer jobs")
    assert output.read_text() == "old" and len(os.listdir(killed)) >= ATTEMPTS
