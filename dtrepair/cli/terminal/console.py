"""What a command says: results on stdout, progress and remarks on stderr."""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

import click

Item = TypeVar("Item")


class Console:
    """Prints according to -q and -v; progress only on a terminal or with -v."""

    def __init__(self, *, quiet: bool = False, verbosity: int = 0) -> None:
        """Choose what is printed: `quiet` nothing but errors, `verbosity` 1 each frame, 2 all."""
        self.quiet = quiet
        self.verbosity = verbosity
        self.results_on_stderr = False  # where stdout is kept for a report
        self._advance: Callable[[float], None] | None = None

    def result(self, text: str) -> None:
        """Print a result on stdout, or stderr where a report goes there, unless quiet."""
        if not self.quiet:
            click.echo(text, err=self.results_on_stderr)

    def table(self, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
        """Print aligned columns as results: the first to the left, the others to the right."""
        if self.quiet:
            return
        lines = [tuple(header), *(tuple(row) for row in rows)]
        widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
        for line in lines:
            cells = [line[0].ljust(widths[0])]
            cells += [cell.rjust(width) for cell, width in zip(line[1:], widths[1:], strict=True)]
            click.echo("  ".join(cells).rstrip(), err=self.results_on_stderr)

    def remark(self, text: str) -> None:
        """Print a line on stderr with -v."""
        if self.verbosity and not self.quiet:
            click.echo(text, err=True)

    def trace(self, error: BaseException | None) -> None:
        """Print on stderr where an error comes from, with -vv."""
        if error is not None and self.verbosity > 1:
            import traceback

            self.remark("".join(traceback.format_exception(error)).rstrip())

    def warn(self, texts: Iterable[str]) -> None:
        """Print warnings on stderr, unless quiet."""
        if not self.quiet:
            for text in texts:
                click.echo(f"dtrepair: warning: {text}", err=True)

    def expect(self, ahead: float) -> None:
        """Move the progress bar: so many items' worth of work is done beyond those yielded."""
        if self._advance is not None:
            self._advance(ahead)

    def progress(self, items: Iterable[Item], *, total: int, what: str) -> Iterator[Item]:
        """Yield `items` behind a progress bar, where one is wanted."""
        if self.quiet or total < 2 or not sys.stderr.isatty():
            yield from items
            return
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
        with Progress(*columns, console=RichConsole(stderr=True), transient=True) as bar:
            task = bar.add_task(what, total=total, rate="")
            start, yielded, shown = clock.monotonic(), 0, 0.0

            def advance(ahead: float) -> None:
                nonlocal shown
                shown = max(shown, min(yielded + ahead, total))
                rate = shown / max(clock.monotonic() - start, 1e-9)
                bar.update(task, completed=shown, rate=f"{rate:.1f}/s")

            self._advance = advance
            try:
                for item in items:
                    yield item
                    yielded += 1
                    advance(0.0)
            finally:
                self._advance = None
