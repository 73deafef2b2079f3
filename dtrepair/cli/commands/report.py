"""`dtrepair report`: a JSON report as a self-contained HTML page."""

from __future__ import annotations

import os

import click

from dtrepair.cli.exit_codes import exit_codes
from dtrepair.cli.options.file_names import FILE
from dtrepair.cli.options.sections import Command
from dtrepair.cli.options.verbosity import console_options
from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.console_observer import ConsoleObserver
from dtrepair.cli.terminal.failures import one_line_errors
from dtrepair.cli.terminal.outputs import PAGES, check_ending
from dtrepair.pipeline.errors import CLEAN, INPUT, OUTPUT, InputError
from dtrepair.pipeline.stages.outputs import check_writable, refuse_overwriting


@click.command("report", cls=Command, epilog=exit_codes(INPUT, OUTPUT, clean="written"))
@click.argument("report_path", type=FILE, metavar="REPORT.json")
@click.option(
    "-o", "--output", type=FILE, metavar="OUT.html", required=True, help="The page to write."
)
@click.option(
    "--pictures",
    "count",
    type=click.IntRange(min=0),
    default=6,
    show_default=True,
    metavar="N",
    help="Contacts to draw and to look at in space, the worst ones.",
)
@console_options
@one_line_errors
def command(*, report_path: str, output: str, count: int, console: Console) -> int:
    """Make an HTML page of a report: advice, a timeline, contacts to look at in space, tables.

    The page needs no network and no other file. Pictures need the input and the output of the run:
    where the report names them, or beside the report.

    \b
    Example:
        dtrepair repair shot.usd -o shot_repaired.usdc --report report.json
        dtrepair report report.json -o report.html
    """
    from dtrepair.pipeline.page.gather import PageOptions
    from dtrepair.pipeline.page.write import write_page
    from dtrepair.report.record import read_report
    from dtrepair.report.schema import ReportError

    refuse_overwriting(output, report_path)
    check_writable(output)
    check_ending(output, "page", PAGES)
    try:
        report = read_report(report_path)
    except ReportError as error:
        raise InputError(str(error)) from None
    except OSError as error:
        raise InputError(f"{report_path}: cannot be read: {error.strerror}") from None
    write_page(
        report,
        output,
        beside=os.path.dirname(report_path),
        options=PageOptions(contacts=count),
        observer=ConsoleObserver(console),
    )
    console.result(f"written: {output}")
    return CLEAN
