"""Interrupted repairs: the old output stays, nothing is left behind, --resume ends the same."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.repair_text import say
from dtrepair.pipeline.observer import FrameDone
from dtrepair.repair import repairer
from dtrepair.repair.clip import clip_options
from dtrepair.repair.clip.window_method import WindowMethod
from dtrepair.repair.independent import repair_poses
from tests.command_line import CLOSED, OPEN, Outcome, assert_fails, run, swaying, tube_stage

FRAMES = 20
SMALL = partial(clip_options.ClipOptions, window=10, overlap=3)  # three windows


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip that intersects here and there."""
    return tube_stage(tmp_path_factory.mktemp("clip") / "a.usdc", swaying(FRAMES))


@pytest.fixture(scope="module")
def whole(clip: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """What an undisturbed run with small windows writes."""
    output = tmp_path_factory.mktemp("whole") / "b.usdc"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(clip_options, "ClipOptions", SMALL)
        assert run("repair", clip, "-o", output).code == 0
    assert listing(output.parent) == ["b.usdc"]
    return output.read_bytes()


@pytest.fixture
def windows(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Small windows, and the number of those that were solved, not remembered."""
    monkeypatch.setattr(clip_options, "ClipOptions", SMALL)
    solved: list[int] = []
    solve = WindowMethod.__call__

    def counted(self: WindowMethod, *arguments: Any, **options: Any) -> Any:
        solved.append(1)
        return solve(self, *arguments, **options)

    monkeypatch.setattr(WindowMethod, "__call__", counted)
    return solved


def listing(folder: Path) -> list[str]:
    return sorted(os.listdir(folder))


def interrupted(
    monkeypatch: pytest.MonkeyPatch, clip: Path, output: Path, at: float, *options: object
) -> Outcome:
    """Run until frame `at` is written, then press Ctrl-C."""

    def press(console: Console, done: FrameDone) -> None:
        if done.record.time == at:
            raise KeyboardInterrupt
        say(console, done)

    with monkeypatch.context() as patch:
        patch.setattr("dtrepair.cli.commands.repair.say", press)
        return run("repair", clip, "-o", output, *options)


def test_a_resumed_run_ends_with_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clip: Path, windows: list[int], whole: bytes
) -> None:
    output = tmp_path / "b.usdc"
    output.write_text("old")
    for at, solved in ((3, 1), (10, 1)):  # in the first window, in the second
        windows.clear()
        stopped = interrupted(monkeypatch, clip, output, at, "--resume")
        assert_fails(stopped, 130, "interrupted", "no output was written", "--resume")
        assert output.read_text() == "old" and len(windows) == solved
        assert listing(tmp_path) == [".b.usdc.resume", "b.usdc"]
    windows.clear()
    resumed = run("repair", clip, "-o", output, "--resume")
    assert resumed.code == 0 and resumed.err == ""
    assert len(windows) == 1
    assert output.read_bytes() == whole
    assert listing(tmp_path) == ["b.usdc"]


def test_frames_repaired_alone_are_resumed_one_by_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clip: Path
) -> None:
    assert run("repair", clip, "-o", tmp_path / "whole.usdc", "--alone").code == 0
    stopped = interrupted(monkeypatch, clip, tmp_path / "b.usdc", 15, "--alone", "--jobs", 1)
    assert_fails(stopped, 130, "--resume")
    calls = []

    def counted(*arguments: Any, **options: Any) -> Any:
        calls.append(1)
        return repair_poses(*arguments, **options)

    monkeypatch.setattr(repairer, "repair_poses", counted)
    resumed = run("repair", clip, "-o", tmp_path / "b.usdc", "--alone", "--resume", "--jobs", 1)
    assert resumed.code == 0 and len(calls) == FRAMES - 15
    assert (tmp_path / "b.usdc").read_bytes() == (tmp_path / "whole.usdc").read_bytes()
    assert listing(tmp_path) == ["b.usdc", "whole.usdc"]


def test_other_settings_or_inputs_start_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clip: Path
) -> None:
    output = tmp_path / "b.usdc"
    options = ["--alone", "--frames", "1:6"]
    interrupted(monkeypatch, clip, output, 4, *options)
    other = run("repair", clip, "-o", output, "--resume", *options, "--diffusion", "98")
    assert other.code in (0, 1) and "is not resumed" in other.err
    assert listing(tmp_path) == ["b.usdc"]
    interrupted(monkeypatch, clip, output, 4, *options)
    changed = tube_stage(tmp_path / "a.usdc", [CLOSED] * 6, rest=OPEN + 0.1)
    other = run("repair", changed, "-o", output, "--resume", *options)
    assert other.code == 0 and "is not resumed" in other.err


def test_a_run_of_one_window_tells_of_the_longer_one_that_is_not_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clip: Path
) -> None:
    output = tmp_path / "b.usdc"
    interrupted(monkeypatch, clip, output, 4, "--alone", "--frames", "1:6")
    other = run("repair", clip, "-o", output, "--resume", "--frames", "1:3")
    assert other.code == 0 and "is not resumed" in other.err
    assert listing(tmp_path) == ["b.usdc"]


def test_poses_that_changed_are_solved_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clip: Path
) -> None:
    # The rest and the settings are the same, so the journal is used; the poses differ.
    options = ["--alone", "--frames", "1:4"]
    first = tube_stage(tmp_path / "a.usdc", [CLOSED] * 4)
    interrupted(monkeypatch, first, tmp_path / "b.usdc", 2, *options)
    tube_stage(first, [CLOSED, *np.full(3, CLOSED + 0.1)])
    assert run("repair", first, "-o", tmp_path / "b.usdc", "--resume", *options).code == 0
    assert run("repair", first, "-o", tmp_path / "c.usdc", *options).code == 0
    assert (tmp_path / "b.usdc").read_bytes() == (tmp_path / "c.usdc").read_bytes()


def test_without_resume_a_run_starts_over_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clip: Path
) -> None:
    options = ["--alone", "--frames", "1:8"]
    interrupted(monkeypatch, clip, tmp_path / "b.usdc", 6, *options)
    done = run("repair", clip, "-o", tmp_path / "b.usdc", *options)
    assert done.code == 0 and "--resume would go on" in done.err
    assert listing(tmp_path) == ["b.usdc"]


def test_broken_entries_are_solved_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clip: Path
) -> None:
    options = ["--alone", "--frames", "1:8"]
    assert run("repair", clip, "-o", tmp_path / "whole.usdc", *options).code == 0
    interrupted(monkeypatch, clip, tmp_path / "b.usdc", 7, *options)
    entries = sorted((tmp_path / ".b.usdc.resume").glob("*.npz"))
    assert len(entries) == 7
    entries[0].write_bytes(b"")
    entries[1].write_bytes(entries[1].read_bytes()[:100])
    broken = bytearray(entries[2].read_bytes())
    broken[len(broken) // 3] ^= 255
    entries[2].write_bytes(broken)
    assert run("repair", clip, "-o", tmp_path / "b.usdc", "--resume", *options).code == 0
    assert (tmp_path / "b.usdc").read_bytes() == (tmp_path / "whole.usdc").read_bytes()


def test_progress_that_cannot_be_kept_is_a_warning(tmp_path: Path, clip: Path) -> None:
    (tmp_path / ".b.usdc.resume").write_text("a file in the way")
    done = run("repair", clip, "-o", tmp_path / "b.usdc", "--alone", "--frames", "1:4")
    assert done.code == 0 and "progress cannot be kept" in done.err
    assert (tmp_path / "b.usdc").exists()


def test_a_wrong_window_is_solved_again_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clip: Path, windows: list[int], whole: bytes
) -> None:
    output = tmp_path / "b.usdc"
    interrupted(monkeypatch, clip, output, 3)
    (entry,) = (tmp_path / ".b.usdc.resume").glob("*.npz")
    np.savez(entry, vertices=np.zeros(0, dtype=int))  # a file without the points
    windows.clear()
    resumed = run("repair", clip, "-o", output, "--resume")
    assert resumed.code == 0 and resumed.err == "" and len(windows) == 3
    assert output.read_bytes() == whole
