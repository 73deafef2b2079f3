"""What is at an output already, and where `--report` goes: a file, or - for standard output."""

from __future__ import annotations

import os
from collections.abc import Iterable

from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.streams import say
from dtrepair.pipeline.errors import OutputError
from dtrepair.pipeline.stages.outputs import (
    check_writable,
    is_readable,
    refuse_overwriting,
    writing,
)
from dtrepair.report.record import Report, render_report, write_report

STDOUT = "-"


def check_report_place(
    path: str | None, console: Console, *inputs: str | None, others: Iterable[str | None] = ()
) -> None:
    """Refuse a file that cannot be written, an input, or one of the `others`, outputs as well.

    Standard output is kept for a report that goes there.
    """
    if path == STDOUT:
        console.results_on_stderr = True
    elif path is not None:
        refuse_overwriting(path, *inputs, others=others)
        check_writable(path)


def put_report(report: Report, path: str | None) -> None:
    """Write a report where it was asked for; nothing for None. Raises OutputError."""
    if path == STDOUT:
        error = say(render_report(report), newline=False)
        # Whoever closed a pipe wants no more of it.
        if error is not None and not isinstance(error, BrokenPipeError):
            raise OutputError(f"standard output: cannot be written: {error.strerror}")
    elif path is not None:
        with writing(path):
            write_report(report, path)


def already_written(output: str, console: Console) -> bool:
    """Return whether --skip-existing finds a whole output; tell that, and what cannot be read."""
    if not os.path.exists(output):
        return False
    if is_readable(output):
        console.result(f"{output}: exists; skipped")
        return True
    console.warn([f"{output}: exists, but cannot be read: it is written again"])
    return False
