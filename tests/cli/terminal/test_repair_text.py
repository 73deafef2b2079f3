"""Advice of many frames: one line for each kind."""

from pathlib import Path

import trimesh

from dtrepair.cli.terminal.repair_text import advice_lines
from dtrepair.report.record import FrameRecord
from tests.command_line import CLOSED, OPEN, run, tube_stage
from tests.meshes import knot


def records(*messages: str, status: str = "improved") -> list[FrameRecord]:
    return [FrameRecord(time=float(t), status=status, message=m) for t, m in enumerate(messages)]


def test_frames_that_differ_by_counts_share_a_line() -> None:
    found = records(
        "/A still intersects itself (12 pairs): raise the diffusion",
        "/A still intersects itself (1 pair, all of them where nothing may move): free it",
        "/A still intersects itself (7 pairs); /A and /B still intersect (2 pairs): "
        "raise the diffusion",
    )
    assert list(advice_lines(found)) == [
        "advice: in 2 frames /A still intersects itself; /A and /B still intersect: "
        "raise the diffusion",
        "advice: in 1 frame /A still intersects itself: free it",
    ]


def test_few_contacts_are_named() -> None:
    found = records(*(f"/A{n} still intersects itself (1 pair) and 2 more: x" for n in range(5)))
    (line,) = advice_lines(found)
    assert line.endswith("; /A2 still intersects itself and 2 more: x") and "in 5 frames" in line


def test_clean_frames_that_are_much_deformed_are_told() -> None:
    found = records(
        "/A is clean but much deformed (lengths by a factor of 1.30): look at it",
        "/A is clean but much deformed (lengths by a factor of 2.10, volume to 49%): look at it",
        status="clean",
    )
    assert list(advice_lines(found)) == [
        "advice: in 2 frames /A is clean but much deformed: look at it"
    ]


def test_a_single_frame_needs_no_number() -> None:
    assert list(advice_lines(records("pea lies wholly inside head"))) == [
        "advice: pea lies wholly inside head"
    ]
    assert list(advice_lines(records("it is fine", status="clean"))) == []
    assert list(advice_lines(records("added key", ""))) == []


def test_a_clip_that_cannot_be_solved_has_one_line_of_advice(tmp_path: Path) -> None:
    angles = (OPEN, *(CLOSED + 0.05 * step for step in range(4)))
    path = tube_stage(tmp_path / "a.usda", angles)
    limit = ("--maximum-displacement", 1e-4)
    done = run("repair", path, "-o", tmp_path / "b.usdc", *limit)
    assert done.code == 1
    advice = [line for line in done.out.splitlines() if line.startswith("advice: ")]
    assert len(advice) == 1 and "in 4 frames /Root/Tube still intersects itself: " in advice[0]
    assert advice[0].endswith(": raise --maximum-displacement, or raise the diffusion")


def test_a_plan_of_one_frame(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (), rest=CLOSED)
    plan = run("repair", path, "-o", tmp_path / "b.usda", "--dry-run")
    assert "1 frame (default) would be written to " in plan.out


def test_pairs_closer_than_the_clearance_are_told(tmp_path: Path) -> None:
    points, faces = knot()
    trimesh.Trimesh(points, faces, process=False).export(tmp_path / "a.obj")
    # The strands move out of contact, and no farther.
    options = ["--clearance", "0.3", "--maximum-displacement", "0.2"]
    done = run("repair", tmp_path / "a.obj", "-o", tmp_path / "b.obj", *options)
    assert done.code == 0 and "in 1 frame pairs stay closer than --clearance" in done.out
