"""What a terminal sees of modelled contacts."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.modelled_text import (
    modelled_line,
    print_faults,
    print_modelled,
    print_worn,
    worn_line,
)
from dtrepair.cli.terminal.repair_text import print_met
from dtrepair.report.parts import (
    AttachedList,
    AttachedRecord,
    OtherPartPairs,
    PairCounts,
    PartPairs,
    WornRecord,
)
from dtrepair.report.record import Report
from tests.command_line import OPEN, assert_fails, run, tube_obj
from tests.jointed_arm import FRAMES, arm_stage
from tests.report.part_records import part, record


def test_check_lists_the_pairs_of_parts_that_are_modelled(tmp_path: Path) -> None:
    path = arm_stage(tmp_path / "a.usda", np.linspace(0.0, 0.2, FRAMES))
    found = run("check", path, "--modelled")
    header, row, worn, *rest = found.out.splitlines()
    assert worn == (
        "no open sheet would be taken as worn; what is closed, as rings or coats, is led too"
    )
    assert header.split()[:5] == ["pairs", "most", "in", "a", "frame"]
    assert "bind pose" in row and "/Root/Arm part 1 (" in row and "with /Root/Arm part 2" in row
    report = run("check", path, "--json", "-").json
    at_rest, in_a_frame = (int(number) for number in row.split()[:2])
    assert at_rest == report["attached"]["listed"][0]["pairs"]
    assert in_a_frame == max(frame["before"]["modelled_pairs"] for frame in report["frames"])
    assert rest == run("check", path).out.splitlines()


def test_what_meets_in_frames_only_is_called_so(capsys: pytest.CaptureFixture[str]) -> None:
    frames = (SimpleNamespace(modelled=PartPairs(listed=(record(1, 46),))),)
    report: Any = SimpleNamespace(attached=AttachedList(), passing=(), frames=frames)
    print_modelled(Console(), report)
    row = capsys.readouterr().out.splitlines()[1]
    assert row.split()[:4] == ["0", "46", "frames", "only"]


@pytest.mark.parametrize("others", [0, 3])
def test_what_no_frame_lists_is_explained(others: int, capsys: pytest.CaptureFixture[str]) -> None:
    frame = SimpleNamespace(modelled=PartPairs(others=OtherPartPairs(parts=others)))
    found = AttachedList(listed=(attached(2),))
    report: Any = SimpleNamespace(attached=found, passing=(), frames=(frame,))
    print_modelled(Console(), report)
    _, row, *rest = capsys.readouterr().out.splitlines()
    assert row.split()[1] == ("?" if others else "0")
    assert len(rest) == (others > 0) and all(own.startswith("?: a frame lists") for own in rest)


def test_of_one_mesh_it_is_said_which_parts_met(tmp_path: Path) -> None:
    path = arm_stage(tmp_path / "a.usda", np.linspace(0.0, 0.5, FRAMES))
    out = run("check", path, "--strict").out
    title, header, row = out.splitlines()[-4:-1]
    what = "which parts of /Root/Arm met which, in all frames together"
    assert title == f"{what} (1 is the part with most triangles):"
    assert header.split() == ["pairs", "around", "of", "and"]
    pairs = row.split()[0]
    assert row.split()[4:] == ["part", "1", "part", "2"] and f" {pairs} pairs" in out
    repaired = run("repair", path, "-o", tmp_path / "b.usda", "--rest-contacts", "repair").out
    assert title in repaired.splitlines() and f"\n{pairs} " in repaired


@pytest.mark.parametrize("checked", [True, False])
def test_parts_of_several_meshes_are_told_by_their_paths(
    checked: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    other = replace(record(1, 7, 2), second=part(None, "/Hero/Belt"))
    itself = replace(record(3, 5), second=part(3))
    others = OtherPartPairs(parts=4, counts=PairCounts(pairs_before=9, pairs_after=10))
    found = PartPairs(listed=(other, itself), others=others)
    print_faults(Console(), found, single=False, checked=checked)
    title, _, *rows = capsys.readouterr().out.splitlines()
    assert title.startswith("which parts met which, in all frames together (")
    after = [[], [], []] if checked else [["2"], ["0"], ["10", "(more)"]]
    assert [row.split() for row in rows] == [
        ["7", *after[0], "7", "0", "0", "/Hero/Body", "part", "1", "/Hero/Belt"],
        ["5", *after[1], "5", "0", "0", "/Hero/Body", "part", "3", "itself"],
        ["9", *after[2], "4", "other", "pairs", "of", "parts"],
    ]


@pytest.mark.parametrize(("verbosity", "several"), [(0, False), (1, True)])
def test_of_several_meshes_parts_are_told_with_v(
    verbosity: int, several: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    contacts = [{"first": "/A", "second": "/B", "before": 5, "after": 0}]
    totals = {"contacts": contacts, "faults": asdict(PartPairs(listed=(record(1, 5),)))}
    print_met(Console(verbosity=verbosity), totals)
    out = capsys.readouterr().out
    assert "what met what" in out and ("which parts met which" in out) == several
    print_met(Console(verbosity=verbosity), {"contacts": []})
    assert capsys.readouterr().out == ""


def test_it_is_said_where_nothing_is_modelled(tmp_path: Path) -> None:
    found = run("check", tube_obj(tmp_path / "a.obj", OPEN), "--modelled")
    assert found.out.splitlines()[0] == "nothing is taken as modelled"
    assert found.code == 0


def attached(number: int) -> AttachedRecord:
    centre = (0.0, 0.0, 0.0)
    return AttachedRecord(
        first=part(1), second=part(number), pairs=9, pose="bind pose", centre=centre
    )


def test_one_line_says_what_is_taken_as_modelled() -> None:
    line = modelled_line(AttachedList(listed=tuple(map(attached, range(2, 8))), others=3))
    assert line == (
        "taken as modelled: 9 pairs of parts: /Hero/Body part 1 with /Hero/Body part 2, "
        "/Hero/Body part 1 with /Hero/Body part 3, /Hero/Body part 1 with /Hero/Body part 4 "
        "and 6 more; --rest-contacts repair treats them as faults, --attach, --detach and "
        "--ignore override, check --modelled lists them"
    )
    assert modelled_line(AttachedList(listed=(attached(2),))).startswith(
        "taken as modelled: 1 pair of parts: /Hero/Body part 1 with /Hero/Body part 2; "
    )


def test_it_is_said_once_for_a_run_and_not_as_a_warning(tmp_path: Path) -> None:
    path = arm_stage(tmp_path / "a.usda", np.zeros(3))
    for arguments in (
        ("check", path),
        ("repair", path, "-o", tmp_path / "b.usda"),
        ("keyposes", path, "--verify-only"),
    ):
        (line,) = run(*arguments).err.splitlines()
        assert line.startswith("dtrepair: taken as modelled: 1 pair of parts: /Root/Arm part 1")
        assert run(*arguments, "-q").err == ""
    assert run("check", path, "--rest-contacts", "repair").err == ""
    strict = run("check", path, "--strict")
    assert strict.err == "" and strict.code == 1
    assert strict.out.splitlines()[-1].endswith(" pairs, every contact counted")
    told = run("check", path, "--strict", "--rest-contacts", "auto")
    assert told.code == 0 and "taken as modelled" in told.err
    assert "every contact" not in told.out


def test_help_of_check_tells_what_strict_counts() -> None:
    shown = {name: " ".join(run(name, "--help").out.split()) for name in ("check", "repair")}
    assert "and count modelled contacts like all others." in shown["check"]
    assert "Wins over --strict." in shown["check"]
    assert "[default: (auto, with --strict repair)]" in shown["check"]
    assert "--strict The same as --strict-references; it is not check --strict" in shown["repair"]
    for text in shown.values():
        assert "--strict-references Refuse a stage with broken references." in text


@pytest.mark.parametrize("command", ["check", "repair", "keyposes"])
def test_broken_references_are_refused_without_another_way_to_count(
    tmp_path: Path, command: str
) -> None:
    path = arm_stage(tmp_path / "a.usda", np.zeros(3))
    output = [] if command == "check" else ["-o", tmp_path / "b.usda"]
    whole = run(command, path, *output, "--strict-references")
    assert whole.code == 0 and "taken as modelled" in whole.err
    assert "strict_references" not in run("check", path, "--json", "-").json["settings"]
    text = path.read_text()
    path.write_text(text + '\ndef "Prop" (references = @./nowhere.usda@)\n{\n}\n')
    assert "nowhere" in run(command, path, *output).err
    for option in ("--strict-references", "--strict"):
        assert_fails(run(command, path, *output, option), 3, "nowhere", "mend the reference")


def test_one_line_says_what_is_taken_as_worn() -> None:
    one, other = part(1), replace(part(2), path="/Hero/Coat", number=None)
    among = "another order with primvars:dtrepair:layer for each face"
    within = WornRecord(over=part(2), under=one)
    assert worn_line([within]) == (
        f"taken as worn: /Hero/Body part 2 over /Hero/Body part 1; {among}"
    )
    coats = [WornRecord(over=other, under=part(number)) for number in range(1, 9)]
    line = worn_line([*coats, within])
    assert line.startswith("taken as worn: /Hero/Coat over /Hero/Body part 1, ")
    assert line.endswith(
        "and 6 more; another order with --layer or primvars:dtrepair:layer for each face"
    )


def test_feathers_over_feathers_are_one_line_of_a_check(capsys: pytest.CaptureFixture[str]) -> None:
    feathers = [WornRecord(over=part(k), under=part(9)) for k in range(1, 5)]
    coat = replace(part(2), path="/Hero/Coat", number=None)
    coats = [WornRecord(over=coat, under=part(k)) for k in range(1, 4)]
    print_worn(
        Console(), Report(command="check", version="1", input="a.usd", worn=(*feathers, *coats))
    )
    assert capsys.readouterr().out.splitlines() == [
        "worn: parts of /Hero/Body over parts of /Hero/Body, 4 pairs",
        *(f"worn: {own.over} over {own.under}" for own in coats),
    ]
