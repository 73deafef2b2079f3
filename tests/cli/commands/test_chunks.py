"""Chunks of a clip for a farm: what `join` makes of them is what one run writes, bit for bit."""

from __future__ import annotations

from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.repair.clip import clip_options
from dtrepair.report.record import read_report
from tests.command_line import CLOSED, OPEN, assert_fails, read_samples, run, swaying, tube_stage

Samples = dict[float, NDArray[np.float32]]

FRAMES = 15
NEAR = 6.3  # the ends just pass through each other


@pytest.fixture
def small_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows of 8 frames that overlap by 2."""
    small = partial(clip_options.ClipOptions, window=8, overlap=2)
    monkeypatch.setattr(clip_options, "ClipOptions", small)
    monkeypatch.setattr("dtrepair.pipeline.repair.stage.open_journal", lambda *some, **more: None)


def clip(path: Path) -> Path:
    return tube_stage(path, swaying(FRAMES))


def joined(
    tmp_path: Path, path: Path, count: int, *options: object, code: tuple[int, ...] = (0,)
) -> tuple[Samples, list[list[float]]]:
    """The samples of the joined chunks, and how many frames each one wrote."""
    parts, frames = [], []
    for number in range(1, count + 1):
        part, report = tmp_path / f"part{number}.usdc", tmp_path / "r.json"
        arguments = ["-o", part, "--chunk", f"{number}/{count}", "--report", report, *options]
        done = run("repair", path, *arguments)
        assert done.code in code, done
        parts.append(part)
        frames.append([frame["time"] for frame in read_report(report)["frames"]])
    assert run("join", *reversed(parts), "-o", tmp_path / "joined.usdc").code == 0
    return read_samples(tmp_path / "joined.usdc"), frames


def assert_same(first: Samples, second: Samples) -> None:
    assert list(first) == list(second)
    assert all(np.array_equal(first[time], second[time]) for time in first)


def test_joined_chunks_are_one_run_bit_for_bit(tmp_path: Path, small_windows: None) -> None:
    path = clip(tmp_path / "a.usdc")
    assert run("repair", path, "-o", tmp_path / "whole.usdc").code == 0
    samples, frames = joined(tmp_path, path, 2)
    assert list(chain(*frames)) == list(range(1, FRAMES + 1)) and all(frames)
    given = read_samples(path)
    assert any((samples[time] != given[time]).any() for time in given)
    assert_same(samples, read_samples(tmp_path / "whole.usdc"))
    assert run("check", tmp_path / "joined.usdc").code == 0


def test_more_chunks_than_windows_share_the_frames(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usdc", (NEAR, OPEN, NEAR, OPEN))
    assert run("repair", path, "-o", tmp_path / "whole.usdc").code == 0
    samples, frames = joined(tmp_path, path, 3)
    assert frames == [[1], [2], [3, 4]]
    assert_same(samples, read_samples(tmp_path / "whole.usdc"))


def test_chunks_that_end_within_windows(tmp_path: Path, small_windows: None) -> None:
    path = clip(tmp_path / "a.usdc")
    options = ["--frames", "1:10"]
    assert run("repair", path, "-o", tmp_path / "whole.usdc", *options).code == 0
    samples, frames = joined(tmp_path, path, 3, *options)
    assert frames == [[1, 2, 3], [4, 5, 6], [7, 8, 9, 10]]
    assert_same(samples, read_samples(tmp_path / "whole.usdc"))


def test_a_chunk_of_one_frame_after_a_cut(tmp_path: Path) -> None:
    # The last frame differs far more from its neighbour than those do: a window of its own.
    path = tube_stage(tmp_path / "a.usdc", [*(NEAR + 0.01 * np.arange(3)), 14.0])
    assert run("repair", path, "-o", tmp_path / "whole.usdc").code in (0, 1)
    samples, frames = joined(tmp_path, path, 2, code=(0, 1))
    assert frames == [[1, 2, 3], [4]]
    assert_same(samples, read_samples(tmp_path / "whole.usdc"))


def test_frames_alone_are_split_evenly(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usdc", (NEAR, OPEN, NEAR, NEAR + 0.01, OPEN))
    assert run("repair", path, "-o", tmp_path / "whole.usdc", "--alone").code == 0
    samples, frames = joined(tmp_path, path, 2, "--alone")
    assert frames == [[1, 2], [3, 4, 5]]
    assert_same(samples, read_samples(tmp_path / "whole.usdc"))


def test_unusable_frames_belong_to_one_chunk(tmp_path: Path, small_windows: None) -> None:
    from pxr import Sdf

    path = clip(tmp_path / "a.usdc")
    layer = Sdf.Layer.FindOrOpen(str(path))
    for time in (1, 9, 10, 15):
        layer.SetTimeSample("/Root/Tube.points", time, Sdf.ValueBlock())
    layer.Save()
    del layer
    options = ["--frames", "1:12,15"]
    assert run("repair", path, "-o", tmp_path / "whole.usdc", *options).code == 0
    samples, frames = joined(tmp_path, path, 2, *options)
    assert list(chain(*frames)) == [*range(1, 13), 15]
    whole = read_samples(tmp_path / "whole.usdc")
    assert list(samples) == list(whole)
    assert all(np.array_equal(samples[t], whole[t]) for t in samples if whole[t].ndim == 2)


@pytest.mark.parametrize("chunk", ["0/2", "3/2", "2", "a/b", "1/0", "-1/2"])
def test_bad_chunks_are_refused(tmp_path: Path, chunk: str) -> None:
    path = tube_stage(tmp_path / "a.usda")
    done = run("repair", path, "-o", tmp_path / "b.usdc", "--chunk", chunk)
    assert_fails(done, 2, "--chunk", "K/N")


def test_a_missing_chunk_is_told_when_joining(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (CLOSED, OPEN, CLOSED))
    parts = [tmp_path / f"part{number}.usdc" for number in (1, 2, 3)]
    for number, part in enumerate(parts, 1):
        assert run("repair", path, "-o", part, "--alone", "--chunk", f"{number}/3").code == 0
    done = run("join", parts[0], parts[2], "-o", tmp_path / "joined.usdc")
    assert done.code == 3 and "chunk 2/3 is missing" in done.err
    assert not (tmp_path / "joined.usdc").exists()
    assert run("join", *parts, "-o", tmp_path / "joined.usdc").code == 0


def test_empty_chunks_and_plans_of_chunks_are_told(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (CLOSED, OPEN, CLOSED))
    done = run("repair", path, "-o", tmp_path / "b.usdc", "--chunk", "1/4")
    assert done.code == 0 and "--chunk 1/4: has no frames" in done.err
    done = run("repair", path, "-o", tmp_path / "b.usdc", "--chunk", "1/2", "--alone", "--dry-run")
    assert "1 frame (1) would be written" in done.out and "no frames" not in done.err


def test_mesh_files_have_no_chunks(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    done = run("repair", tmp_path / "a.obj", "-o", tmp_path / "b.obj", "--chunk", "1/2")
    assert done.code == 2 and "--chunk: only for USD stages" in done.err


@pytest.mark.parametrize("command", [("check",), ("repair", "-o", "b.usdc", "--dry-run")])
def test_a_mode_that_counts_nothing_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tube_stage(tmp_path / "a.usda", (CLOSED,))
    done = run(*command[:1], path, "--mode", "inter", *command[1:])
    assert "--mode inter: only one mesh" in done.err


def test_a_chunk_of_other_settings_or_inputs_is_refused(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usdc", (CLOSED, OPEN, CLOSED))
    parts = [tmp_path / f"part{number}.usdc" for number in (1, 2, 3)]

    def chunk(number: int, *options: object) -> None:
        arguments = ["--alone", "--chunk", f"{number}/3", *options]
        assert run("repair", path, "-o", parts[number - 1], *arguments).code == 0

    for number in (1, 2, 3):
        chunk(number)
    chunk(2, "--diffusion", 20)
    done = run("join", *parts, "-o", tmp_path / "joined.usdc")
    assert_fails(done, 3, "part1.usdc", "part2.usdc", "diffusion (", "and 20", "write them again")
    chunk(2)
    assert run("join", *parts, "-o", tmp_path / "joined.usdc").code == 0
    (tmp_path / "joined.usdc").unlink()
    tube_stage(path, (CLOSED, OPEN, CLOSED + 0.1))
    chunk(3)
    done = run("join", *parts, "-o", tmp_path / "joined.usdc")
    assert_fails(done, 3, "differ in the content of the input")
    assert not (tmp_path / "joined.usdc").exists()
