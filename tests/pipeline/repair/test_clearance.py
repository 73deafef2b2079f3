"""A clearance that is not reached is told, with its frames, by all that repairs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from dtrepair.diagnosis import Diagnosis
from dtrepair.pipeline.repair.records import clearance_warnings
from dtrepair.repair.surface.surface import SurfaceOptions
from dtrepair.report.record import FrameRecord
from tests.command_line import CLOSED, OPEN, run, tube_stage

# As far as a vertex may go the ends come out of contact, and no farther.
ASKED = ("--clearance", "0.06", "--maximum-displacement", "0.07")


def record(time: float | None, close: int) -> FrameRecord:
    return FrameRecord(time=time, status="clean", left=Diagnosis(too_close=close))


def test_frames_and_the_worst_of_them_are_named() -> None:
    found = [record(1.0, 0), record(2.0, 3), record(3.0, 7), record(9.5, 1)]
    (line,) = clearance_warnings(found, 0.25)
    assert line.startswith("--clearance 0.25 is not reached in frames 2, 3, 9.5: 7 pairs of tri")
    assert "in frame 3 closer" in line and "a smaller --clearance may be reached" in line
    (line,) = clearance_warnings([record(None, 1)], 0.25)
    assert line.startswith("--clearance 0.25 is not reached: 1 pair of triangles closer")
    assert clearance_warnings(found[:1], 0.25) == ()


@pytest.mark.parametrize("command", ["repair", "keyposes"])
def test_it_is_told_once(tmp_path: Path, command: str) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED, OPEN))
    done = run(command, path, "-o", tmp_path / "b.usdc", *ASKED)
    assert done.code == 0
    (line,) = (text for text in done.err.splitlines() if "is not reached" in text)
    assert "--clearance 0.06 is not reached in frame 2: " in line
    assert "--clearance is not reached in 1 of " in done.out


def test_help_says_that_it_is_a_warning() -> None:
    told = " ".join(run("repair", "--help").out.split())
    assert "0 every frame is clean (a --clearance that is not reached is a warning);" in told
    for command in ("repair", "keyposes", "transfer"):
        told = " ".join(run(command, "--help").out.split())
        assert "a warning names the frames; the exit code does not tell it." in told


def test_help_and_guide_say_within_how_many_edges_it_does_not_hold() -> None:
    assert SurfaceOptions().neighbour_rings == 6
    guide = Path(__file__).parents[3] / "docs/guide/choosing.md"
    for text in (run("repair", "--help").out, guide.read_text(encoding="utf-8")):
        assert re.search(r"within six edges .*along the surface", " ".join(text.split()))


def test_of_a_transfer_too(tmp_path: Path) -> None:
    source, target = (tube_stage(tmp_path / name, (OPEN, CLOSED)) for name in ("a.usda", "b.usda"))
    done = run("transfer", source, target, "-o", tmp_path / "c.usdc", "--repair", *ASKED)
    assert "--clearance 0.06 is not reached in frame 2" in done.err
    assert "--clearance is not reached in 1 of 2 frames" in done.out
