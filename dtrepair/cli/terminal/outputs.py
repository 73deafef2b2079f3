"""What is at an output already, and where `--report` and `--picture` go."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.streams import say
from dtrepair.pipeline.errors import CLEAN, OutputError, UsageError
from dtrepair.pipeline.observer import SILENT, Observer
from dtrepair.pipeline.stages.outputs import (
    check_writable,
    earlier_than,
    has_record,
    is_readable,
    other_result,
    recorded_exit_code,
    refuse_overwriting,
    writing,
)
from dtrepair.pipeline.stages.sources import is_stage
from dtrepair.report.record import Report, render_report, write_report

STDOUT = "-"
PAGES = (".html", ".htm")
PICTURES = (".png", ".jpg", ".jpeg")


@dataclass(frozen=True)
class Reports:
    """Where the report goes, as JSON or page, to any number of places, and a picture."""

    report: tuple[str, ...] = ()
    picture: str | None = None


NOWHERE = Reports()


def check_report_places(
    reports: Reports, console: Console, *inputs: str | None, others: Iterable[str | None] = ()
) -> None:
    """Refuse files that cannot be written, inputs, each other, and the `others`, outputs as well.

    Standard output is kept for a report that goes there.
    """
    others = list(others)
    if reports.picture is not None:
        check_picture_name(reports.picture)
        refuse_overwriting(reports.picture, *inputs, others=others)
        check_writable(reports.picture)
        others.append(reports.picture)
    for path in reports.report:
        if path == STDOUT and console.results_on_stderr:
            raise UsageError("--report -: given twice; leave one out")
        if path == STDOUT:
            console.results_on_stderr = True
        else:
            refuse_overwriting(path, *inputs, others=others)
            check_writable(path)
            check_ending(path, "report", (".json", *PAGES))
            others.append(path)


def check_ending(path: str, what: str, endings: Sequence[str]) -> None:
    """Refuse a file with another ending than one of some; it may have none, or be no file."""
    ending = os.path.splitext(path)[1].lower()
    new_or_file = os.path.isfile(path) or not os.path.exists(path)
    if ending and ending not in endings and new_or_file:
        raise UsageError(f"{path}: name the {what} {' or '.join(endings[:2])}, not {ending}")


def check_picture_name(path: str) -> None:
    """Refuse a name that does not end as a picture does."""
    if not path.lower().endswith(PICTURES):
        raise UsageError(f"{path}: name the picture .png, .jpg or .jpeg")


def put_reports(report: Report, reports: Reports, observer: Observer = SILENT) -> None:
    """Write what was asked for: reports as JSON or page, and a picture. Raises OutputError."""
    for path in reports.report:
        if path == STDOUT:
            error = say(render_report(report), newline=False)
            # Whoever closed a pipe wants no more of it.
            if error is not None and not isinstance(error, BrokenPipeError):
                raise OutputError(f"standard output: cannot be written: {error.strerror}")
        elif path.lower().endswith(PAGES):
            from dtrepair.pipeline.page.write import write_page

            write_page(report, path, observer=observer)
        else:
            with writing(path):
                write_report(report, path)
    if reports.picture is not None:
        from dtrepair.pipeline.page.picture import write_picture

        write_picture(report, reports.picture, observer=observer)


def already_written(
    output: str,
    console: Console,
    reports: Reports = NOWHERE,
    over: str | None = None,
    inputs: Sequence[str] = (),
    choices: tuple[Mapping[str, Any], Mapping[str, Any]] | None = None,
) -> int | None:
    """Return the exit code of a whole output that --skip-existing finds; tell of what it finds.

    None: there is none, or it is written again.

    reports: what is not written then, which is told. over: the stage that a layer lies over;
    inputs: what else it is made of: an output of other contents than now is made again. choices:
    those of the run as a record holds them, and their defaults; None: it may have any. Raises
    UsageError for a layer that says that it is the result of another run.
    """
    if not os.path.exists(output):
        return None
    if not is_readable(output):
        console.warn([f"{output}: exists, but cannot be read: it is written again"])
        return None
    if is_stage(output):
        if choices is not None and (other := other_result(output, over, *choices)):
            raise UsageError(
                f"{output}: exists, and is {other}: --skip-existing takes only a result of this "
                "input and these choices for done; name another output, or remove it"
            )
        if not has_record(output):
            console.warn([f"{output}: has no record of dtrepair, and may not be its output"])
            return _skipped(output, reports, console)
    if newer := earlier_than(output, [*([over] if over else []), *inputs]):
        console.warn([f"{output}: exists, of an earlier {newer}: it is written again"])
        return None
    return _skipped(output, reports, console)


def _skipped(output: str, reports: Reports, console: Console) -> int:
    """Say that an output is left as it is, and what is not written; return its exit code."""
    unwritten = [name for name, value in vars(reports).items() if value]
    end = f"; no {' and no '.join(unwritten)} is written" if unwritten else ""
    code = recorded_exit_code(output)
    end += "; it is not clean, as its run has said" if code != CLEAN else ""
    console.result(f"{output}: exists; skipped{end}")
    return code
