"""Strains of many frames: one line for each part and measure, with frames and the worst number."""

from __future__ import annotations

from dataclasses import replace

from dtrepair.cli.terminal.strain_text import LINES, strain_lines
from dtrepair.diagnosis import KEPT, LEFT_OUT, Advice, Diagnosis, Status, Strain, StrainKind
from dtrepair.report.record import FrameRecord

HAND = Strain(
    body="/Hero",
    part=2,
    parts=9,
    kind=StrainKind.EDGES,
    value=12.0,
    bound=5.0,
    vertex=7,
    place=(1.0, 2.0, 0.5),
)


def record(time: float | None, *strains: Strain, left_out: bool = True) -> FrameRecord:
    advice = (Advice.TAKE_AT_ANY_COST,) if left_out else ()
    left = Diagnosis(strains=strains, advice=advice)
    return FrameRecord(time=time, status=Status.STRAINED, left=left)


def test_frames_of_one_part_share_a_line_with_the_worst_of_them() -> None:
    found = [record(3.0, HAND), record(4.5, replace(HAND, value=40.0, vertex=8)), record(6.0)]
    assert list(strain_lines(found)) == [
        "strained: frames 3, 4.5, worst in 4.5: /Hero, part 2 of 9, at (1, 2, 0.5), vertex 8: "
        f"40 edges four times longer or shorter, at most 5 may be: {LEFT_OUT}; "
        "take what is strained with --at-any-cost"
    ]


def test_other_parts_and_measures_have_lines_of_their_own() -> None:
    volume = replace(HAND, kind=StrainKind.VOLUME, value=0.4, bound=0.2)
    lines = list(strain_lines([record(1.0, HAND, volume, replace(HAND, part=3))]))
    assert len(lines) == 3 and all(line.startswith("strained: frame 1: ") for line in lines)
    assert any("volume changed by 40%, at most 20%" in line for line in lines)
    little = replace(volume, value=0.2025)
    assert little.measure == "volume changed by 20.25%, at most 20.00%"


def test_a_pose_without_a_time_and_what_was_taken_at_any_cost() -> None:
    (line,) = strain_lines([record(None, HAND, HAND, left_out=False)])
    assert line.startswith("strained: /Hero") and line.endswith(KEPT)
    assert list(strain_lines([record(1.0)])) == []


def test_many_frames_and_parts_are_counted() -> None:
    (line,) = strain_lines([record(float(time), HAND) for time in range(9)])
    assert line.startswith("strained: frames 0:8, worst in 0: ")
    (line,) = strain_lines([record(2.0 * time, HAND) for time in range(9)])
    assert " 8, 10 and 3 more, worst in 0: " in line
    parts = [replace(HAND, part=part) for part in range(1, LINES + 3)]
    lines = list(strain_lines([record(1.0, *parts)]))
    assert len(lines) == LINES + 1 and lines[-1].startswith("strained: 2 more parts and measures")
