"""`dtrepair repair`: what is written, what is left alone, and how a run ends."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtrepair.files.mesh_files import read_mesh
from dtrepair.repair.result import RepairResult
from dtrepair.report.record import read_report
from tests.command_line import (
    CLOSED,
    OPEN,
    assert_fails,
    read_samples,
    run,
    tube_obj,
    tube_stage,
)


def test_mesh_file_is_repaired_in_place_of_its_points(tmp_path: Path) -> None:
    path = tube_obj(tmp_path / "a.obj")
    done = run("repair", path, "-o", tmp_path / "b.obj", "--report", tmp_path / "r.json")
    assert done.code == 0 and done.err == ""
    assert "1 of 1 frame clean" in done.out
    before, after = read_mesh(path), read_mesh(tmp_path / "b.obj")
    assert np.array_equal(before.corners, after.corners)
    assert np.array_equal(before.counts, after.counts)
    assert run("check", tmp_path / "b.obj").code == 0
    report = read_report(tmp_path / "r.json")
    frame = report["frames"][0]
    assert frame["status"] == "clean" and frame["after"]["triangles"] == 0
    size = np.linalg.norm(np.ptp(before.points, axis=0))
    moved = np.linalg.norm(after.points - before.points, axis=1) / size
    assert frame["displacement_max"] == pytest.approx(moved.max(), rel=1e-4)
    assert frame["displacement_mean"] == pytest.approx(moved.mean(), rel=1e-4)
    assert 0 < frame["displacement_max"] < 0.2


def test_clean_mesh_file_comes_back_byte_for_byte(tmp_path: Path) -> None:
    path = tube_obj(tmp_path / "a.obj", OPEN)
    assert run("repair", path, "-o", tmp_path / "b.obj").code == 0
    assert (tmp_path / "b.obj").read_bytes() == path.read_bytes()


def test_alone_leaves_clean_frames_bit_for_bit(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED, 5.5, CLOSED + 0.2), times=(-1, 0.5, 2, 3))
    bytes_before = path.read_bytes()
    done = run("repair", path, "-o", tmp_path / "b.usdc", "--alone", "--samples")
    assert done.code == 0
    assert path.read_bytes() == bytes_before
    before, after = read_samples(path), read_samples(tmp_path / "b.usdc")
    assert list(after) == [-1, 0.5, 2, 3]
    assert [np.array_equal(before[t], after[t]) for t in before] == [True, False, True, False]
    assert run("check", tmp_path / "b.usdc", "--samples").code == 0
    rows = [line.split() for line in done.out.splitlines()[1:]]
    assert [row[0] for row in rows[:2]] == ["0.5", "3"]  # only frames with something to do


def test_frames_away_from_contacts_stay_bit_for_bit(tmp_path: Path) -> None:
    angles = np.r_[np.full(25, OPEN), CLOSED, np.full(25, OPEN)]
    path = tube_stage(tmp_path / "a.usdc", angles)
    assert run("repair", path, "-o", tmp_path / "b.usdc").code == 0
    assert run("check", tmp_path / "b.usdc").code == 0
    before, after = read_samples(path), read_samples(tmp_path / "b.usdc")
    changed = [time for time in before if not np.array_equal(before[time], after[time])]
    assert 26 in changed
    assert min(changed) > 5 and max(changed) < 47


def test_selected_frames_only(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (CLOSED, CLOSED, CLOSED))
    assert run("repair", path, "-o", tmp_path / "b.usdc", "--frames", "2").code == 0
    before, after = read_samples(path), read_samples(tmp_path / "b.usdc")
    assert [np.array_equal(before[t], after[t]) for t in before] == [True, False, True]


def test_points_at_the_default_time_are_written_there(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (), rest=CLOSED)
    assert run("repair", path, "-o", tmp_path / "b.usda").code == 0
    assert read_samples(tmp_path / "b.usda") == {}
    assert run("check", tmp_path / "b.usda").code == 0
    assert run("check", path).code == 1


def test_join_of_two_ranges_is_the_whole(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (CLOSED, OPEN, CLOSED + 0.1, CLOSED))
    for name, frames in (("b", "1:2"), ("c", "3:4")):
        done = run("repair", path, "-o", tmp_path / f"{name}.usdc", "--frames", frames)
        assert done.code == 0
    joined = run("join", tmp_path / "c.usdc", tmp_path / "b.usdc", "-o", tmp_path / "d.usdc")
    assert joined.code == 0 and "from 2 layers" in joined.out
    assert run("check", tmp_path / "d.usdc").code == 0
    whole = run("repair", path, "-o", tmp_path / "e.usdc")
    assert whole.code == 0
    first, second = read_samples(tmp_path / "d.usdc"), read_samples(tmp_path / "e.usdc")
    assert list(first) == list(second)
    assert_fails(run("join", tmp_path / "b.usdc", "-o", tmp_path / "b.usdc"), 2, "b.usdc")
    parts = [tmp_path / "b.usdc", tmp_path / "c.usdc"]
    again = run("join", *parts, "-o", tmp_path / "d.usdc", "--skip-existing")
    assert again.code == 0 and "exists" in again.out
    again = run("join", parts[0], "-o", tmp_path / "d.usdc", "--skip-existing")
    assert_fails(again, 2, "was joined of other layers")


def test_report_describes_the_run(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED, CLOSED + 0.1))
    assert run("repair", path, "-o", tmp_path / "b.usdc", "--report", tmp_path / "r.json").code == 0
    report = read_report(tmp_path / "r.json")
    assert report["command"] == "repair" and report["output"].endswith("b.usdc")
    assert report["prims"][0]["path"] == "/Root/Tube"
    assert report["prims"][0]["rest_intersections"] == 0
    assert report["settings"]["rest"] == ["default time"]
    assert report["settings"]["method"] == "full"
    assert report["summary"]["clean"] == 3 and report["summary"]["triangles_after"] == 0
    assert report["summary"]["jitter"] > 0
    assert {"total", "read", "factor", "detect", "solve", "write"} <= set(report["seconds"])
    check = run("check", path, "--json", "-").json
    assert [f["before"] for f in report["frames"]] == [f["before"] for f in check["frames"]]


def test_unsolved_frames_end_with_1_and_advice(tmp_path: Path) -> None:
    # One iteration of the published loop does not separate the ends.
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    done = run("repair", path, "-o", tmp_path / "b.usdc", "--method", "paper", "--iterations", 1)
    assert done.code == 1
    assert "1 of 2 frames clean" in done.out and "advice: " in done.out
    check = run("check", tmp_path / "b.usdc", "--json", "-")
    assert check.code == 1
    before = run("check", path, "--json", "-").json["summary"]["pairs_before"]
    assert check.json["summary"]["pairs_before"] <= before


def test_failed_frame_is_kept_and_ends_with_4(tmp_path: Path) -> None:
    from pxr import Usd

    path = tube_stage(tmp_path / "a.usda", (CLOSED, CLOSED, CLOSED))
    stage = Usd.Stage.Open(str(path))
    points = stage.GetPrimAtPath("/Root/Tube").GetAttribute("points")
    points.Set([(float("nan"), 0, 0)] * 200, 2)
    stage.Save()
    done = run("repair", path, "-o", tmp_path / "b.usdc", "--report", tmp_path / "r.json")
    assert done.code == 4
    assert "frame 2" in done.err and "2 of 3 frames clean" in done.out
    statuses = [frame["status"] for frame in read_report(tmp_path / "r.json")["frames"]]
    assert statuses == ["clean", "failed", "clean"]
    assert np.isnan(read_samples(tmp_path / "b.usdc")[2][:, 0]).all()
    points.Block()
    del points, stage


def test_solver_errors_fail_one_frame_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from dtrepair.repair.independent import repair_poses

    path = tube_stage(tmp_path / "a.usda", (CLOSED, CLOSED + 0.1, CLOSED))
    calls = []

    def sometimes(*arguments: Any, **options: Any) -> list[list[RepairResult]]:
        calls.append(1)
        if len(calls) == 2:
            raise ArithmeticError("no factor")
        return repair_poses(*arguments, **options)

    monkeypatch.setattr("dtrepair.repair.repairer.repair_poses", sometimes)
    done = run("repair", path, "-o", tmp_path / "b.usdc", "--alone", "--jobs", 1)
    assert done.code == 4 and "frame 2: failed: ArithmeticError: no factor" in done.err
    before, after = read_samples(path), read_samples(tmp_path / "b.usdc")
    assert [np.array_equal(before[t], after[t]) for t in before] == [False, True, False]
    calls.clear()
    again = run("repair", path, "-o", tmp_path / "b.usdc", "--alone", "--jobs", 1, "-vv")
    assert "Traceback" in again.err


def test_blocked_sample_is_skipped_and_stays_blocked(tmp_path: Path) -> None:
    from pxr import Sdf, Usd

    path = tube_stage(tmp_path / "a.usda", (CLOSED, CLOSED, CLOSED))
    layer = Sdf.Layer.FindOrOpen(str(path))
    layer.SetTimeSample("/Root/Tube.points", 2, Sdf.ValueBlock())
    layer.Save()
    del layer
    done = run("repair", path, "-o", tmp_path / "b.usdc")
    assert done.code == 0 and "skipped" in done.out
    stage = Usd.Stage.Open(str(tmp_path / "b.usdc"))
    assert stage.GetPrimAtPath("/Root/Tube").GetAttribute("points").Get(2) is None


def test_dry_run_and_skip_existing_write_nothing(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda")
    before = sorted(tmp_path.iterdir())
    plan = run("repair", path, "-o", tmp_path / "b.usdc", "--dry-run")
    assert plan.code == 0 and sorted(tmp_path.iterdir()) == before
    assert "/Root/Tube" in plan.out and "3 frames (1 to 3)" in plan.out
    old = tube_stage(tmp_path / "b.usdc").read_bytes()
    again = run("repair", tmp_path / "none.usd", "-o", tmp_path / "b.usdc", "--skip-existing")
    assert again.code == 0 and "exists" in again.out
    assert (tmp_path / "b.usdc").read_bytes() == old


def test_verbose_tells_each_frame_on_stderr(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    done = run("repair", path, "-o", tmp_path / "b.usdc", "-v")
    lines = done.err.splitlines()
    assert lines[0].startswith("frame 1: 0 -> 0") and lines[1].startswith("frame 2: ")
    assert "iteration" not in done.err  # frames that are solved together have none of their own
    alone = run("repair", path, "-o", tmp_path / "c.usdc", "-v", "--alone").err.splitlines()
    assert "iteration" not in alone[0]
    assert re.search(r" triangles, [1-9]\d* iterations?, ", alone[1])


def test_an_error_in_the_middle_leaves_the_old_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tube_stage(tmp_path / "a.usda", (CLOSED, CLOSED))
    (tmp_path / "b.usdc").write_text("old")
    before = sorted(os.listdir(tmp_path))

    def stop(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("dtrepair.cli.commands.repair.say", stop)
    assert_fails(run("repair", path, "-o", tmp_path / "b.usdc"), 130, "interrupted")
    assert (tmp_path / "b.usdc").read_text() == "old"
    assert sorted(os.listdir(tmp_path)) == before


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["{obj}"], 2, ["--output"]),
        (["{obj}", "-o", "{dir}/b.usda"], 2, ["the input is a mesh file", "b.obj"]),
        (["{obj}", "-o", "{dir}/b.dae"], 2, ["expected one of obj"]),
        (["{obj}", "-o", "{obj}"], 2, ["is an input of this run"]),
        (["{obj}", "-o", "{dir}/none/b.obj"], 5, ["none/b.obj", "cannot be written"]),
        (["{obj}", "-o", "{dir}/b.obj", "--collider", "/A"], 2, ["--collider", "USD stages"]),
        (["{usd}", "-o", "{dir}/b.obj"], 2, ["is a USD stage", ".usdc"]),
        (["{usd}", "-o", "{usd}"], 2, ["part of the input stage"]),
        (["{usd}", "-o", "{dir}/b.usdz"], 2, ["usdz"]),
        (["{usd}", "-o", "{dir}/none/b.usdc"], 5, ["none"]),
        (["{usd}", "-o", "{dir}/b.usdc", "--frames", "9"], 2, ["none of the frames"]),
        (["{usd}", "-o", "{dir}/b.usdc", "--collider", "/Root//"], 2, ["nothing may move"]),
        (["{usd}", "-o", "{dir}/b.usdc", "--collider", "/No"], 2, ["/No"]),
        (["{usd}", "-o", "{dir}/b.usdc", "--diffusion", "0"], 2, ["--diffusion", "positive"]),
        (["{usd}", "-o", "{dir}/b.usdc", "--energy", "tpe"], 2, ["--energy", "--method full"]),
        (["{usd}", "-o", "{dir}/b.usdc", "--report", "{dir}/b.usdc"], 2, ["another output"]),
        (["{usd}", "-o", "{dir}/b.usdc", "--report", "{dir}/none/r"], 5, ["cannot be written"]),
        (["{dir}/none.usd", "-o", "{dir}/b.usdc"], 3, ["no such file"]),
    ],
)
def test_errors_leave_no_file(
    tmp_path: Path, arguments: list[str], code: int, words: list[str]
) -> None:
    names = {
        "obj": str(tube_obj(tmp_path / "a.obj")),
        "usd": str(tube_stage(tmp_path / "a.usda")),
        "dir": str(tmp_path),
    }
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert_fails(run("repair", *(text.format(**names) for text in arguments)), code, *words)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_full_disk_ends_with_5_and_keeps_the_old_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tube_obj(tmp_path / "a.obj")
    (tmp_path / "b.obj").write_text("old")

    def full(*arguments: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("dtrepair.files.mesh_files.write_atomically", full)
    done = run("repair", path, "-o", tmp_path / "b.obj")
    assert_fails(done, 5, "b.obj", "No space left on device")
    assert (tmp_path / "b.obj").read_text() == "old"


def test_settings_are_recorded_in_the_layer(tmp_path: Path) -> None:
    from pxr import Sdf

    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    assert run("repair", path, "-o", tmp_path / "b.usda", "--diffusion", "50").code in (0, 1)
    record = Sdf.Layer.FindOrOpen(str(tmp_path / "b.usda")).customLayerData["dtrepair"]
    assert record["settings"]["diffusion"] == 50
    assert record["counts"]["triangles_after"] == 0
    assert json.loads(json.dumps(record["settings"]["method"])) == "full"
