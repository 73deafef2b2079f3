"""How far a run is: a bar on a terminal, elsewhere a line now and then."""

from __future__ import annotations

import math
import os
import sys
import threading
import time as clock
from collections.abc import Callable

import click

# Seconds until the first line, and between lines at most: a farm takes silence for death.
FIRST, LONGEST = 30.0, 300.0
# What forks must not do so while a line is on its way: the child would never get the stream.
_SPEAKING = threading.Lock()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=_SPEAKING.acquire,
        after_in_parent=_SPEAKING.release,
        after_in_child=_SPEAKING.release,
    )


class ProgressBar:
    """Shows how many frames of a phase are done, and how fast; on stderr, until it is closed."""

    def __init__(self, phase: str, total: int) -> None:
        """Show an empty bar."""
        from rich.console import Console as RichConsole
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
        from rich.progress import TimeRemainingColumn as Remaining

        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]}"),
            Remaining(),
        )
        self._bar = Progress(*columns, console=RichConsole(stderr=True), transient=True)
        self._start = clock.monotonic()
        self._bar.start()
        self._task = self._bar.add_task(phase, total=total, rate="")

    def show(self, done: float) -> None:
        """Show that so many frames are done."""
        rate = done / max(clock.monotonic() - self._start, 1e-9)
        self._bar.update(self._task, completed=done, rate=f"{rate:.1f}/s")

    def close(self) -> None:
        """Take the bar away."""
        self._bar.stop()


def wanted(total: int) -> bool:
    """Whether a bar is worth it: for several frames, on a terminal."""
    return total > 1 and sys.stderr.isatty()


class Heartbeat:
    """Tells how far a run is, from time to time, where no terminal shows a bar."""

    def __init__(
        self, tell: Callable[[str], None], *, now: Callable[[], float] = clock.monotonic
    ) -> None:
        """Begin to count the seconds of the run. tell: prints a line; now: a clock, seconds."""
        self._tell, self._now, self._start = tell, now, now()
        self._phase, self._total, self._done = "", 0, 0.0

    def start(self, phase: str, total: int) -> None:
        """Name what is going on, of so many frames."""
        self._phase, self._total, self._done = phase, total, 0.0

    def advance(self, done: float) -> None:
        """Take note that so many frames are done."""
        self._done = done

    def end(self) -> None:
        """Something without a name goes on."""
        self._phase = ""

    def line(self) -> str:
        """Say how far the run is."""
        minutes, seconds = divmod(round(self._now() - self._start), 60)
        hours, minutes = divmod(minutes, 60)
        ago = f"{hours}:{minutes:02}:{seconds:02}"
        if not self._phase:
            return f"at work for {ago}"
        return f"{self._phase}: {math.floor(self._done)} of {self._total} done after {ago}"

    def run(self, wait: Callable[[float], bool]) -> None:
        """Tell it again and again, until `wait` for so many seconds says that the run is over."""
        while not wait(min(max(FIRST, (self._now() - self._start) / 4), LONGEST)):
            with _SPEAKING:
                self._tell(self.line())


def heartbeat(tell: Callable[[str], None]) -> Heartbeat | None:
    """Return a heartbeat that beats until the command ends; None on a terminal, and without one.

    None as well where the environment has DTREPAIR_HEARTBEAT=0.
    """
    context = click.get_current_context(silent=True)
    if context is None or sys.stderr.isatty() or os.environ.get("DTREPAIR_HEARTBEAT") == "0":
        return None
    beat, over = Heartbeat(tell), threading.Event()
    context.call_on_close(over.set)
    threading.Thread(target=beat.run, args=(over.wait,), name="heartbeat", daemon=True).start()
    return beat
