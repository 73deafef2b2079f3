"""What a console shows of a run: a bar on a terminal, warnings, frames, where errors come from."""

from __future__ import annotations

import io
import sys

import pytest

from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.console_observer import ConsoleObserver
from dtrepair.cli.terminal.repair_text import say
from dtrepair.pipeline import FrameDone, ProgressKept, Trouble
from dtrepair.pipeline.observer import Progress
from dtrepair.report.record import CountRecord, FrameRecord


class _Terminal(io.StringIO):
    def __init__(self, is_terminal: bool = True) -> None:
        super().__init__()
        self._is_terminal = is_terminal

    def isatty(self) -> bool:
        return self._is_terminal


def run_of_four(monkeypatch: pytest.MonkeyPatch, console: Console, screen: _Terminal) -> str:
    """What four items with half an item of work ahead show on a screen."""
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    with Progress(ConsoleObserver(console), "working", 4) as progress:
        for _ in progress.over("abcd"):
            progress.ahead(0.5)
    return screen.getvalue()


def test_a_bar_is_shown_on_a_terminal_and_taken_away(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = run_of_four(monkeypatch, Console(), _Terminal())
    assert "working" in shown and "4/4" in shown
    assert "\x1b[?25h" in shown  # the cursor is back


def test_no_bar_is_shown_to_files_or_when_quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    assert run_of_four(monkeypatch, Console(quiet=True), _Terminal()) == ""
    assert run_of_four(monkeypatch, Console(), _Terminal(is_terminal=False)) == ""


def test_a_single_frame_needs_no_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = _Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    with Progress(ConsoleObserver(Console()), "working", 1) as progress:
        assert list(progress.over("a")) == ["a"]
    assert screen.getvalue() == ""


def raised() -> ValueError:
    """An error with a place where it comes from."""
    try:
        raise ValueError("wires crossed")
    except ValueError as error:
        return error


@pytest.mark.parametrize("verbosity", [0, 1, 2])
def test_remarks_are_printed_as_far_as_they_are_asked_for(
    capsys: pytest.CaptureFixture[str], verbosity: int
) -> None:
    observer = ConsoleObserver(Console(verbosity=verbosity), say)
    count = CountRecord()
    fine = FrameRecord(time=1.0, status="clean", before=count, after=count)
    observer.remark(FrameDone(fine, raised()))
    observer.remark(Trouble(raised()))
    observer.remark(ProgressKept(3))  # no command is running that could end
    out, err = capsys.readouterr()
    assert out == "" and err.count("frame 1: 0 -> 0") == (verbosity > 0)
    assert err.count("ValueError: wires crossed") == (2 if verbosity > 1 else 0)


def test_a_frame_without_a_result_is_a_warning(capsys: pytest.CaptureFixture[str]) -> None:
    observer = ConsoleObserver(Console(), say)
    observer.remark(FrameDone(FrameRecord(time=2.0, status="failed", message="NaN")))
    observer.warning("beware")
    assert capsys.readouterr().err.splitlines() == [
        "dtrepair: warning: frame 2: failed: NaN",
        "dtrepair: warning: beware",
    ]
