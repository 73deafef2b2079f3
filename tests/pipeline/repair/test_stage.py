"""A repair from a script: silent, observed, cancelled, resumed, and run again from its report."""

from __future__ import annotations

import json
import os
from dataclasses import fields
from pathlib import Path
from typing import get_type_hints

import pytest

from dtrepair import RepairOptions
from dtrepair.pipeline import (
    Cancelled,
    FrameDone,
    InputError,
    ObjectOptions,
    ObjectSettings,
    PrimTable,
    ProgressKept,
    RepairSettings,
    Selection,
    UsageError,
    exit_code,
    plan_repair,
    repair_stage,
)
from dtrepair.pipeline.observer import Remark
from dtrepair.pipeline.repair.settings import RepairChoices
from dtrepair.repair.parallel.process_pool import can_fork
from dtrepair.report.record import render_report
from tests.command_line import CLOSED, OPEN, read_samples, run, tube_stage
from tests.pipeline.hosts import Listener

ANGLES = (OPEN, CLOSED, CLOSED + 0.05, CLOSED + 0.1, OPEN, CLOSED)


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return tube_stage(tmp_path / "a.usdc", ANGLES)


def listing(folder: Path) -> list[str]:
    return sorted(os.listdir(folder))


def test_a_run_says_nothing_and_writes_what_the_command_writes(
    tmp_path: Path, clip: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    report = repair_stage(clip, tmp_path / "b.usdc")
    assert capfd.readouterr() == ("", "")
    assert exit_code(report) == 0 and len(report.frames) == len(ANGLES)
    assert run("repair", clip, "-o", tmp_path / "c.usdc").code == 0
    assert (tmp_path / "b.usdc").read_bytes() == (tmp_path / "c.usdc").read_bytes()


def test_a_report_has_the_measures_of_the_published_tables(tmp_path: Path, clip: Path) -> None:
    paper = RepairOptions(method="paper", iterations=1)
    report = repair_stage(clip, tmp_path / "b.usdc", options=paper)
    for frame in report.frames:
        assert frame.after is not None
        assert frame.geodesic is not None and frame.normal_consistency is not None
        # The ends of the tube meet: they are far apart along it.
        assert (frame.geodesic > 0.5) == (frame.after.pairs > 0)
        assert (frame.normal_consistency < 1.0) == (frame.displacement_max > 0.0)
        assert frame.normal_consistency > 0.8
    assert any(frame.geodesic for frame in report.frames)
    assert any(frame.displacement_max for frame in report.frames)
    written = report.document()["frames"]
    assert [frame["geodesic"] for frame in written] == [f.geodesic for f in report.frames]


def test_an_observer_hears_of_the_frames(tmp_path: Path, clip: Path) -> None:
    host = Listener()
    choices = Selection(frames="2:4")
    repair_stage(str(clip), str(tmp_path / "b.usdc"), selection=choices, observer=host)
    assert host.phases == [("repairing", 3)] and host.ended == 1
    assert host.times == [2.0, 3.0, 4.0]
    (warning,) = host.warnings
    assert warning.startswith("--frames is a trial: leave it out for the final repair, ")
    assert (
        "; the correction breaks off at frames 2, 4 and pops, or fades unseen, there, " in warning
    )
    assert "most at /Root/Tube (by " in warning and len(warning) < 250
    assert host.done == sorted(host.done) and host.done[-1] == 3.0
    assert any(done % 1.0 for done in host.done)  # of the window in work


def test_a_cancelled_run_leaves_the_old_output_and_can_be_resumed(
    tmp_path: Path, clip: Path
) -> None:
    whole, output = tmp_path / "whole.usdc", tmp_path / "b.usdc"
    repair_stage(str(clip), str(whole), alone=True)
    output.write_text("old")
    host = Listener(frames=3)
    with pytest.raises(Cancelled):
        repair_stage(str(clip), str(output), alone=True, jobs=1, observer=host)
    assert host.times == [1.0, 2.0, 3.0] and host.ended == 1
    kept = [remark.entries for remark in host.remarks if isinstance(remark, ProgressKept)]
    assert kept and kept == sorted(kept)
    assert output.read_text() == "old"
    assert listing(tmp_path) == [".b.usdc.resume", "a.usdc", "b.usdc", "whole.usdc"]

    again = Listener()
    repair_stage(str(clip), str(output), alone=True, jobs=1, resume=True, observer=again)
    assert output.read_bytes() == whole.read_bytes()
    assert again.warnings == [] and listing(tmp_path) == ["a.usdc", "b.usdc", "whole.usdc"]


def children() -> set[str]:
    """The processes that this one has started."""
    files = Path("/proc/self/task").glob("*/children")
    return {number for file in files for number in file.read_text().split()}


@pytest.mark.skipif(not can_fork(), reason="processes cannot be forked here")
@pytest.mark.parametrize("error", [None, RuntimeError("the host is gone")])
def test_a_run_that_is_left_early_leaves_no_process(
    tmp_path: Path, clip: Path, error: Exception | None
) -> None:
    class Host(Listener):
        def remark(self, remark: Remark) -> None:
            super().remark(remark)
            if error is not None and isinstance(remark, FrameDone):
                raise error

    before, host = children(), Host(frames=1)
    kind = Cancelled if error is None else RuntimeError
    with pytest.raises(kind) as caught:
        repair_stage(str(clip), str(tmp_path / "b.usdc"), alone=True, jobs=2, observer=host)
    # Even as long as the exception holds on to all that was at work.
    assert caught.tb is not None and children() <= before
    assert host.ended == 1 and not (tmp_path / "b.usdc").exists()


def test_a_run_is_cancelled_while_a_window_is_solved(tmp_path: Path) -> None:
    clip = tube_stage(tmp_path / "a.usdc", (CLOSED, CLOSED + 0.05, CLOSED + 0.1))
    host = Listener(within=0.0)
    with pytest.raises(Cancelled):
        repair_stage(str(clip), str(tmp_path / "b.usdc"), observer=host)
    assert host.times == [] and host.warnings == [] and len(host.done) == 1
    assert listing(tmp_path) == ["a.usdc"]


def test_the_settings_of_a_report_give_the_same_bytes_again(tmp_path: Path, clip: Path) -> None:
    settings = RepairSettings(
        selection=Selection(frames="1:4", strict=True),
        options=RepairOptions(tighten=2, skip=("unbend",), maximum_displacement=9.0),
        objects=ObjectOptions(ignore=("/Root/Tube,/Root/Tube",)),
        tables=(PrimTable("/Root", ObjectSettings(diffusion=50.0)),),
        rest="default",
        chunk="1/2",
        alone=True,
    )
    paths = [tmp_path / name for name in ("b.usdc", "c.usdc")]
    report = repair_stage(str(clip), str(paths[0]), settings)
    # As it is read from a file, with the lists of JSON.
    recorded = json.loads(render_report(report))["settings"]
    again = RepairSettings.from_report(recorded)
    assert again == RepairSettings.from_report(report.settings)
    for name in ("selection", "options", "objects", "tables", "rest", "alone", "chunk"):
        assert getattr(again, name) == getattr(settings, name)
    repair_stage(str(clip), str(paths[1]), again)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    whole = RepairSettings.from_report({**recorded, "chunk": None})
    assert whole.chunk is None and whole.objects.ignore == ("/Root/Tube,/Root/Tube",)


def test_what_meshes_had_of_their_own_gives_the_same_bytes_again(
    tmp_path: Path, clip: Path
) -> None:
    paths = [tmp_path / name for name in ("b.usdc", "c.usdc")]
    rigid = RepairSettings(objects=ObjectOptions(rigid="/Root/Tube"))
    again = RepairSettings.from_report(repair_stage(clip, paths[0], rigid).settings)
    assert again.tables == (PrimTable("/Root/Tube", ObjectSettings(rigid=True), "/Root/Tube"),)
    repair_stage(clip, paths[1], again)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_settings_of_another_command_are_refused() -> None:
    with pytest.raises(UsageError, match="'interpolation'"):
        RepairSettings.from_report({"interpolation": "linear"})


def test_choices_are_the_fields_of_the_settings_and_replace_them(
    tmp_path: Path, clip: Path
) -> None:
    hints = {key: get_type_hints(RepairSettings)[key.name] for key in fields(RepairSettings)}
    assert {key.name: hint for key, hint in hints.items()} == get_type_hints(RepairChoices)
    settings = RepairSettings(selection=Selection(frames="1:3"), alone=True)
    plan = plan_repair(
        str(clip), str(tmp_path / "b.usdc"), settings, selection=Selection(frames="2")
    )
    assert plan.times == (2.0,)


def test_a_plan_writes_nothing(tmp_path: Path, clip: Path) -> None:
    output = str(tmp_path / "b.usdc")
    plan = plan_repair(str(clip), output, objects=ObjectOptions(rigid="/Root"))
    (mesh,) = plan.meshes
    assert (mesh.path, mesh.vertices, mesh.rest) == ("/Root/Tube", 200, "default time")
    assert mesh.settings == ObjectSettings(rigid=True) and not mesh.collider
    assert plan.times == tuple(float(time) for time in read_samples(clip))
    assert plan.output == output and listing(tmp_path) == ["a.usdc"]


def test_what_goes_wrong_has_a_code(tmp_path: Path, clip: Path) -> None:
    output = str(tmp_path / "b.usdc")
    with pytest.raises(InputError, match=r"missing\.usd"):
        repair_stage(str(tmp_path / "missing.usd"), output)
    with pytest.raises(UsageError, match="so the output is a layer over it"):
        repair_stage(str(clip), str(tmp_path / "b.obj"))
    with pytest.raises(UsageError, match="/Nothing"):
        repair_stage(str(clip), output, selection=Selection(prim="/Nothing"))
    with pytest.raises(UsageError, match="expected K/N"):
        repair_stage(str(clip), output, chunk="3/2")
    with pytest.raises(UsageError, match="--device"):
        repair_stage(str(clip), output, options=RepairOptions(method="paper"), device="gpu")
    with pytest.raises(UsageError, match="--layer"):
        repair_stage(
            str(clip),
            output,
            options=RepairOptions(method="paper"),
            objects=ObjectOptions(layer=("hand=1",)),
        )
    for choices in ({"resume": True}, {"settings": RepairSettings(chunk="1/2")}):
        with pytest.raises(UsageError, match="--distributed"):
            repair_stage(str(clip), output, distributed="local", **choices)
    assert listing(tmp_path) == ["a.usdc"]
