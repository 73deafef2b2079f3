"""A heartbeat: lines on stderr while a run goes on that no terminal shows."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from typing import Any

import click
import pytest

from dtrepair.cli.terminal import progress
from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.console_observer import ConsoleObserver
from dtrepair.cli.terminal.progress import FIRST, LONGEST, Heartbeat
from dtrepair.pipeline.observer import Progress
from tests.command_line import run, tube_obj


@pytest.fixture(autouse=True)
def wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DTREPAIR_HEARTBEAT", raising=False)


def test_lines_come_after_half_a_minute_and_then_less_often() -> None:
    seconds, lines, waited = [100.0], list[str](), list[float]()
    beat = Heartbeat(lines.append, now=lambda: seconds[0])

    def wait(pause: float) -> bool:
        waited.append(pause)
        seconds[0] += pause
        if len(waited) == 2:
            beat.start("repairing", 60)
            beat.advance(12.4)
        if len(waited) == 4:
            beat.end()
            seconds[0] += 7200.0
        return len(waited) == 6

    beat.run(wait)
    assert waited == [FIRST, FIRST, FIRST, FIRST, LONGEST, LONGEST]
    assert lines == [
        "at work for 0:00:30",
        "repairing: 12 of 60 done after 0:01:00",
        "repairing: 12 of 60 done after 0:01:30",
        "at work for 2:02:00",
        "at work for 2:07:00",
    ]


def beating() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == "heartbeat"]


class Listening(Console):
    """A console that tells whether a line of the phase was printed."""

    def __init__(self) -> None:
        super().__init__()
        self.heard = threading.Event()

    def tell(self, text: str) -> None:
        super().tell(text)
        if text.startswith("working: 0 of 1 done after 0:0"):
            self.heard.set()


def test_it_beats_while_a_command_runs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "FIRST", 0.0)
    console = Listening()
    with click.Context(click.Command("repair")):
        observer = ConsoleObserver(console)
        (thread,) = beating()
        with Progress(observer, "working", 1):
            assert console.heard.wait(60.0)
    thread.join()
    assert "dtrepair: working: 0 of 1 done after 0:00:" in capsys.readouterr().err


def test_it_is_silent_when_quiet_on_a_terminal_and_without_a_command(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ConsoleObserver(Console())
    with click.Context(click.Command("repair")):
        ConsoleObserver(Console(quiet=True))
        with monkeypatch.context() as patched:
            patched.setenv("DTREPAIR_HEARTBEAT", "0")
            ConsoleObserver(Console())
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
        ConsoleObserver(Console())
        assert not beating()


def test_a_short_run_says_nothing_and_ends_its_thread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Heartbeat] = []

    class Kept(Heartbeat):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            made.append(self)

    monkeypatch.setattr(progress, "Heartbeat", Kept)
    assert run("check", tube_obj(tmp_path / "a.obj")).err == "" and len(made) == 1
    for thread in beating():
        thread.join()
