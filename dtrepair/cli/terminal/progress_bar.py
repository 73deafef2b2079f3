"""A progress bar on a terminal."""

from __future__ import annotations

import sys
import time as clock


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
