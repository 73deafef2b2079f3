"""Advice of many frames: one line for each kind."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.repair_text import (
    advice_lines,
    largest_move,
    moved_line,
    print_contacts,
    strained_line,
)
from dtrepair.diagnosis import (
    EASE,
    Advice,
    Deformation,
    Diagnosis,
    RemainingContact,
    RemainingEnclosure,
    Status,
)
from dtrepair.report.record import (
    CountRecord,
    FramePrimRecord,
    FrameRecord,
    MotionRecord,
    read_report,
)
from tests.command_line import CLOSED, OPEN, run, tube_stage
from tests.meshes import knot


def records(*left: Diagnosis, status: Status = Status.IMPROVED) -> list[FrameRecord]:
    return [FrameRecord(time=float(t), status=status, left=each) for t, each in enumerate(left)]


def of(*contacts: RemainingContact, advice: Advice = Advice.RAISE_DIFFUSION) -> Diagnosis:
    return Diagnosis(contacts=contacts, advice=(advice,))


def test_frames_that_differ_by_counts_share_a_line() -> None:
    both = RemainingContact("/A", "/B", 2)
    found = records(
        of(RemainingContact("/A", "/A", 12)),
        of(RemainingContact("/A", "/A", 1, held=1), advice=Advice.FREE_PINS),
        of(RemainingContact("/A", "/A", 7), both),
    )
    meaning = Status.IMPROVED.meaning
    assert list(advice_lines(found)) == [
        "advice: in frames 0, 2 /A still intersects itself; /A and /B still intersect: "
        f"{meaning}: raise --diffusion",
        f"advice: in frame 1 /A still intersects itself: {meaning}: free pinned vertices",
    ]


def test_a_move_is_told_in_stage_units_and_per_cent() -> None:
    count = CountRecord()
    still = FramePrimRecord("/A", count, count, size=8.0)
    far = MotionRecord(displacement_max=0.05, rigid_rms=0.0, edge_distortion=0.0, edge_change=0.0)
    moved = FramePrimRecord("/B", count, count, motion=far, size=4.0)
    frame = FrameRecord(time=1.0, status="clean", displacement_max=0.05)
    assert largest_move(replace(frame, prims=(still, moved))) == "0.2 (5 %)"
    assert largest_move(replace(frame, prims=(still,))) == "0.4 (5 %)"
    assert largest_move(replace(frame, displacement_max=0.0)) == "0"
    # What moved farther counts, not what moved more for its size.
    less = replace(moved, motion=replace(far, displacement_max=0.04), size=20.0)
    assert largest_move(replace(frame, prims=(moved, less))) == "0.8 (4 %)"


def test_frames_that_move_without_an_intersection_are_told() -> None:
    none, some = CountRecord(), CountRecord(triangles=2, pairs=1)
    prims = (FramePrimRecord("/A", none, none, size=8.0),)
    values = [(none, 0.0), (none, 0.01), (none, 0.02), (some, 0.3), (none, 0.01), (None, 0.2)]
    found = [
        FrameRecord(
            time=float(t), status="clean", before=count, displacement_max=moved, prims=prims
        )
        for t, (count, moved) in enumerate(values)
    ]
    assert moved_line(found) == (
        "moved, though nothing intersects there: frames 1, 2, 4; by up to 0.16 (2 %) in frame 2, /A"
    )
    assert moved_line([found[0], found[3]]) == moved_line([replace(found[1], time=None)]) == ""


def test_strained_frames_that_are_left_as_they_came_are_told() -> None:
    found = [
        FrameRecord(time=float(t), status=status, displacement_max=moved)
        for t, (status, moved) in enumerate(
            [("strained", 0.0), ("strained", 0.1), ("strained", 0.0), ("unchanged", 0.0)]
        )
    ]
    assert strained_line(found) == (
        "3 frames strained, of which 2 are left as before: see the lines below"
    )
    assert "of which 1 is left as before" in strained_line(found[:2])
    assert strained_line(found[1:2]) == "1 frame strained: see the lines below"


def test_units_are_those_of_the_stage(tmp_path: Path) -> None:
    from pxr import Gf, Usd, UsdGeom

    told = []
    for scale in (1.0, 100.0):
        path = tube_stage(tmp_path / f"{scale:g}.usda", (CLOSED,))
        stage = Usd.Stage.Open(str(path))
        tube = UsdGeom.Xformable(stage.GetPrimAtPath("/Root/Tube"))
        tube.AddTransformOp().Set(Gf.Matrix4d().SetScale(scale))
        stage.GetRootLayer().Save()
        done = run("repair", path, "-o", tmp_path / "out.usdc", "--report", tmp_path / "r.json")
        (line,) = [line for line in done.out.splitlines() if line.endswith(" clean")]
        (size,) = [prim["size"] for prim in report_of(tmp_path / "r.json")["prims"]]
        move, share = re.findall(r"([\d.]+) \(([\d.]+) %\)", line)[0]
        assert float(move) == pytest.approx(float(share) / 100 * size, rel=0.01)
        told.append((float(move), float(share), float(size)))
    assert np.divide(told[1], told[0]) == pytest.approx([100.0, 1.0, 100.0], rel=0.01)


def report_of(path: Path) -> dict[str, Any]:
    """The only frame of a report."""
    (frame,) = json.loads(path.read_text())["frames"]
    assert isinstance(frame, dict)
    return frame


def test_few_contacts_are_named() -> None:
    found = records(*(of(RemainingContact(f"/A{n}", f"/A{n}", 1)) for n in range(5)))
    (line,) = advice_lines(found)
    assert "; /A2 still intersects itself and 2 more: fewer" in line and "in frames 0:4 " in line


def test_a_limit_is_called_what_the_command_line_calls_it() -> None:
    found = of(RemainingContact("/A", "/A", 1), advice=Advice.RAISE_MAXIMUM_DISPLACEMENT)
    (line,) = advice_lines(records(found))
    assert line.endswith(": raise --maximum-displacement")


def test_frames_that_are_much_deformed_are_told() -> None:
    found = records(
        Diagnosis(deformations=(Deformation("/A", 1.3),)),
        Diagnosis(deformations=(Deformation("/A", 2.1, 0.49),)),
        status=Status.CLEAN,
    )
    assert list(advice_lines(found)) == [f"advice: in frames 0, 1 /A is much deformed: {EASE}"]


def test_a_single_frame_needs_no_number() -> None:
    inside = Diagnosis(enclosures=(RemainingEnclosure("pea", "head"),))
    assert list(advice_lines(records(inside))) == ["advice: pea lies wholly inside head"]
    assert list(advice_lines(records(Diagnosis(), Diagnosis(too_close=3)))) == []


def test_a_clip_that_cannot_be_solved_has_one_line_of_advice(tmp_path: Path) -> None:
    angles = (OPEN, *(CLOSED + 0.05 * step for step in range(4)))
    path = tube_stage(tmp_path / "a.usda", angles)
    limit = ("--maximum-displacement", 1e-4)
    done = run("repair", path, "-o", tmp_path / "b.usdc", *limit)
    assert done.code == 1
    advice = [line for line in done.out.splitlines() if line.startswith("advice: ")]
    assert len(advice) == 1 and "in frames 2:5 /Root/Tube still intersects itself: " in advice[0]
    ways = "raise --maximum-displacement, or raise --effort, or raise --diffusion"
    assert advice[0].endswith(f": {ways}")


def test_a_plan_of_one_frame(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (), rest=CLOSED)
    plan = run("repair", path, "-o", tmp_path / "b.usda", "--dry-run")
    assert "1 frame (default) would be written to " in plan.out
    pair = "/Root/Tube,/Root/Tube"
    for option in ("--attach", "--detach", "--ignore"):
        plan = run("repair", path, "-o", tmp_path / "b.usda", "--dry-run", option, pair)
        assert f"{option} {pair}\n" in plan.out


def test_pairs_closer_than_the_clearance_are_told(tmp_path: Path) -> None:
    points, faces = knot()
    trimesh.Trimesh(points, faces, process=False).export(tmp_path / "a.obj")
    # The strands move out of contact, and no farther.
    options = ["--clearance", "0.3", "--maximum-displacement", "0.2"]
    report = tmp_path / "r.json"
    done = run("repair", tmp_path / "a.obj", "-o", tmp_path / "b.obj", *options, "--report", report)
    assert done.code == 0 and "\n--clearance is not reached in 1 of 1 frame\n" in done.out
    assert (
        "warning: --clearance 0.3 is not reached: " in done.err
        and "a smaller --clearance" in done.err
    )
    document = read_report(report)
    assert document["summary"]["too_close"] == 1
    assert any("--clearance 0.3 is not reached" in text for text in document["warnings"])
    kept = run("repair", tmp_path / "a.obj", "-o", tmp_path / "b.obj", "--report", report)
    assert "not reached" not in kept.out + kept.err
    assert "too_close" not in read_report(report)["summary"]


def test_what_meets_more_than_before_is_marked(capsys: pytest.CaptureFixture[str]) -> None:
    contacts = [
        {"first": "/A", "second": "/B", "before": 94, "after": 121},
        {"first": "/A", "second": "/C", "before": 7, "after": 7},
    ]
    print_contacts(Console(), contacts)
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[2:]]
    assert rows == [["94", "121", "(more)", "/A", "/B"], ["7", "7", "/A", "/C"]]
