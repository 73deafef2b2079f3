"""Progress on a terminal: it moves with the work that is done ahead, never back, never too far."""

from __future__ import annotations

import io
import sys
from collections.abc import Generator, Iterator
from typing import Any

import pytest
import rich.progress

from dtrepair import Body, SceneRepairer
from dtrepair.cli.terminal.console import Console
from tests.repair.clip.test_animation import swing


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def on_terminal(monkeypatch: pytest.MonkeyPatch) -> _Terminal:
    """From now on stderr says that it is a terminal; what is written there."""
    screen = _Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    return screen


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """How many items the bar showed as done, update by update."""
    numbers: list[float] = []

    class Recording(rich.progress.Progress):
        def update(self, *given: Any, **fields: Any) -> None:
            numbers.append(fields["completed"])
            super().update(*given, **fields)

    monkeypatch.setattr(rich.progress, "Progress", Recording)
    return numbers


def test_the_bar_counts_items_and_the_work_ahead_of_them(
    monkeypatch: pytest.MonkeyPatch, shown: list[float]
) -> None:
    terminal, console = on_terminal(monkeypatch), Console()

    def items() -> Iterator[str]:
        yield "first"
        for ahead in (0.5, 2.0, 1.0, 9.0):
            console.expect(ahead)
        yield from ("second", "third", "fourth")

    assert len(list(console.progress(items(), total=4, what="working"))) == 4
    # One item is done; 0.5 and 2 more; it does not go back, nor beyond the four there are.
    assert shown == [1.0, 1.5, 3.0, 3.0, 4.0, 4.0, 4.0, 4.0]
    assert "working" in terminal.getvalue() and "4/4" in terminal.getvalue()


def test_work_ahead_is_heard_only_while_a_bar_is_shown(
    monkeypatch: pytest.MonkeyPatch, shown: list[float]
) -> None:
    on_terminal(monkeypatch)
    console = Console()
    console.expect(3.0)
    bar = console.progress(iter("ab"), total=2, what="working")
    next(bar)
    assert isinstance(bar, Generator)
    bar.close()
    console.expect(3.0)
    assert shown == []


@pytest.mark.parametrize("console", [Console(quiet=True), Console()])
def test_no_bar_is_shown_to_files_or_when_quiet(
    console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = on_terminal(monkeypatch)
    if not console.quiet:
        monkeypatch.setattr(terminal, "isatty", lambda: False)
    assert list(console.progress("ab", total=2, what="working")) == ["a", "b"]
    assert terminal.getvalue() == ""


def test_a_window_of_frames_tells_how_far_it_is() -> None:
    rest, faces, frames = swing()
    animator = SceneRepairer([Body(rest, faces)]).animator
    told: list[float] = []
    poses = ((float(time), [pose]) for time, pose in enumerate(frames))
    assert sum(1 for _ in animator.stream(poses, jobs=1, progress=told.append)) == len(frames)
    assert len(told) > 3 and told == sorted(told)
    assert 0.0 < told[0] and told[-1] <= len(frames)
