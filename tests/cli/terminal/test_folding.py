"""Rows of a table that say the same become one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from dtrepair.cli.terminal.console import FOLDED, Console, folded
from dtrepair.cli.terminal.keyposes_text import print_spans
from dtrepair.report.sections import KeyposesRecord, SamplesRecord, SpanRecord


def test_long_runs_are_folded_and_short_ones_are_not() -> None:
    same = [(str(k), str(k), ("0",)) for k in range(FOLDED)]
    assert folded(same) == [["0 to 2", "0"]]
    assert folded(same[1:]) == [["1", "0"], ["2", "0"]]
    other = ("9", "9", ("4",))
    rows = [*same, other, *same[:2]]
    assert folded(rows) == [["0 to 2", "0"], ["9", "4"], ["0", "0"], ["1", "0"]]
    assert folded([("1", "5", ("x",))] * FOLDED, each=", each of {}") == [
        ["1 to 5, each of 3", "x"]
    ]


def test_spans_that_say_the_same_are_one_row(capsys: pytest.CaptureFixture[str]) -> None:
    def span(start: int, dirty: int) -> SpanRecord:
        found = SamplesRecord(samples=4, dirty=dirty, pairs=dirty)
        return SpanRecord(start=start, end=start + 1.0, before=found, after=found)

    # Clean ones are not told; those on either side of them are not one run.
    spans = [span(start, 0 if start == 4 else 4) for start in range(8)]
    report: Any = SimpleNamespace(
        output=None, keyposes=KeyposesRecord(interpolation="linear", spans=tuple(spans))
    )
    print_spans(Console(), report)
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert rows == [
        ["in-betweens", "dirty"],
        "0 to 4, each 4 of 4".split(),
        "5 to 8, each 4 of 4".split(),
        "32 of 32 in-betweens clean".split(),
    ]
