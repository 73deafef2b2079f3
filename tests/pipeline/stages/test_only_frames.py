"""Layers of the chosen frames alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd

from dtrepair.pipeline import (
    OutputOptions,
    RepairSettings,
    Selection,
    UsageError,
    plan_repair,
    repair_stage,
)
from tests.command_line import CLOSED, OPEN, read_samples, run, tube_obj, tube_stage
from tests.observers import Recorder

ONLY = OutputOptions(only_frames=True)


def test_chosen_frames_alone_are_written(tmp_path: Path) -> None:
    stage = tube_stage(tmp_path / "in.usdc", (OPEN, OPEN, CLOSED, OPEN, OPEN, CLOSED, OPEN))
    outputs = {}
    for name, writing in (("all", OutputOptions()), ("only", ONLY)):
        outputs[name] = tmp_path / f"{name}.usdc"
        chosen = Selection(frames="2:4")
        report = repair_stage(
            stage, outputs[name], selection=chosen, writing=writing, alone=True, jobs=1
        )
    every, only = (read_samples(path) for path in outputs.values())
    assert list(only) == [2.0, 3.0, 4.0] and len(every) == 7
    assert all(np.array_equal(every[time], only[time]) for time in only)
    assert not np.array_equal(only[3.0], read_samples(stage)[3.0])
    opened = Usd.Stage.Open(str(outputs["only"]))
    assert (opened.GetStartTimeCode(), opened.GetEndTimeCode()) == (2.0, 4.0)
    assert outputs["only"].stat().st_size < 0.8 * outputs["all"].stat().st_size
    assert report.settings["only_frames"] is True
    assert RepairSettings.from_report(report.settings).writing == ONLY


@pytest.mark.parametrize(
    "frames, expected",
    [
        ("2:4", "the layer holds frames 2:4 alone; in all others, what it changes stays as in"),
        ("2", "the layer holds frame 2 alone; in all others, what it changes stays as in it"),
        ("1:6", None),
        (None, "has no effect, as all frames are chosen; choose some by --frames"),
    ],
)
def test_what_becomes_of_other_frames_is_told(
    tmp_path: Path, frames: str | None, expected: str | None
) -> None:
    stage = tube_stage(tmp_path / "in.usdc", (OPEN, OPEN, CLOSED, OPEN, OPEN, CLOSED))
    observer = Recorder()
    chosen = Selection(frames=frames)
    plan_repair(stage, tmp_path / "a.usdc", selection=chosen, writing=ONLY, observer=observer)
    told = [text for text in observer.warnings if "only-frames" in text]
    assert len(told) == (expected is not None)
    assert all(text.startswith(f"--only-frames: {expected}") for text in told)
    repair_stage(stage, tmp_path / "b.usdc", selection=chosen, jobs=1, observer=observer)
    assert [text for text in observer.warnings if "only-frames" in text] == told


@pytest.mark.parametrize("frames", ["2:5", None])
def test_of_a_chunk_the_joined_layer_is_told(tmp_path: Path, frames: str | None) -> None:
    stage = tube_stage(tmp_path / "in.usdc", (OPEN, CLOSED, OPEN, CLOSED, OPEN, CLOSED))
    observer, chosen = Recorder(), Selection(frames=frames)
    output = tmp_path / "a.usdc"
    plan_repair(
        stage, output, selection=chosen, writing=ONLY, chunk="1/2", alone=True, observer=observer
    )
    told = [text for text in observer.warnings if "only-frames" in text]
    start = "--only-frames: the joined layer holds frames 2:5 alone"
    assert [text.startswith(start) for text in told] == ([] if frames is None else [True])


def test_chunks_of_chosen_frames_join(tmp_path: Path) -> None:
    stage = tube_stage(tmp_path / "in.usdc", (OPEN, CLOSED, OPEN, CLOSED, OPEN, CLOSED))
    options = ("--alone", "--only-frames", "--frames", "2:5", "--jobs", 1)
    parts = [tmp_path / f"{number}.usdc" for number in (1, 2)]
    for number, part in enumerate(parts, 1):
        assert run("repair", stage, "-o", part, "--chunk", f"{number}/2", *options).code == 0
    assert run("join", *parts, "-o", tmp_path / "joined.usdc").code == 0
    assert run("repair", stage, "-o", tmp_path / "whole.usdc", *options).code == 0
    joined, whole = (read_samples(tmp_path / f"{name}.usdc") for name in ("joined", "whole"))
    assert list(joined) == list(whole) == [2.0, 3.0, 4.0, 5.0]
    assert all(np.array_equal(joined[time], whole[time]) for time in whole)
    opened = Usd.Stage.Open(str(tmp_path / "joined.usdc"))
    assert (opened.GetStartTimeCode(), opened.GetEndTimeCode()) == (2.0, 5.0)


def test_normals_are_an_option(tmp_path: Path) -> None:
    stage = tube_stage(tmp_path / "in.usda", (OPEN, CLOSED))
    edited = Usd.Stage.Open(str(stage))
    tube = edited.GetPrimAtPath("/Root/Tube")
    count = len(tube.GetAttribute("points").Get(1.0))
    tube.CreateAttribute("normals", Sdf.ValueTypeNames.Normal3fArray).Set([(0, 0, 1)] * count)
    edited.Save()
    found, times = {}, {}
    for way in ("keep", "drop", "recompute"):
        assert run("repair", stage, "-o", tmp_path / f"{way}.usda", "--normals", way).code == 0
        layer = Sdf.Layer.FindOrOpen(str(tmp_path / f"{way}.usda"))
        attribute = layer.GetAttributeAtPath("/Root/Tube.normals")
        found[way] = attribute and type(attribute.default)
        times[way] = layer.ListTimeSamplesForPath("/Root/Tube.normals")
    assert found == {"keep": None, "drop": Sdf.ValueBlock, "recompute": type(None)}
    assert times == {"keep": [], "drop": [], "recompute": [1.0, 2.0]}


def test_what_has_no_effect_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--normals: has no effect with --shapes"):
        OutputOptions(shapes=True, normals="keep")
    with pytest.raises(UsageError, match="--only-frames: has no effect with --delta"):
        OutputOptions(delta=True, only_frames=True)
    with pytest.raises(UsageError, match="expected one of recompute, keep, drop, got 'x'"):
        OutputOptions(normals="x")
    mesh = tube_obj(tmp_path / "a.obj")
    for option in (("--only-frames",), ("--normals", "drop")):
        done = run("repair", mesh, "-o", tmp_path / "b.obj", *option)
        assert done.code == 2 and f"{option[0]}: only for USD stages" in done.err
