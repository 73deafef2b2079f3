"""`dtrepair check`: count intersecting triangles, per prim and frame."""

from __future__ import annotations

import click

from dtrepair.cli.exit_codes import exit_codes
from dtrepair.cli.options.fields import field_option
from dtrepair.cli.options.file_names import FILE
from dtrepair.cli.options.reporting import report_options
from dtrepair.cli.options.sections import Command
from dtrepair.cli.options.settings import as_settings
from dtrepair.cli.options.shared import (
    ATTACH,
    DETACH,
    IGNORE,
    REST_CONTACTS,
    check_selection_options,
    jobs_option,
    run_options,
)
from dtrepair.cli.options.verbosity import console_options
from dtrepair.cli.terminal.check_text import print_check
from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.console_observer import ConsoleObserver
from dtrepair.cli.terminal.failures import one_line_errors
from dtrepair.cli.terminal.modelled_text import print_modelled, print_worn
from dtrepair.cli.terminal.outputs import STDOUT, Reports, check_report_places, put_reports
from dtrepair.intersect import MODES
from dtrepair.pipeline.check import check_stage
from dtrepair.pipeline.check_settings import CheckSettings
from dtrepair.pipeline.errors import INPUT, OUTPUT, exit_code


@click.command(
    "check",
    cls=Command,
    epilog=exit_codes(
        INPUT,
        OUTPUT,
        clean="nothing intersects",
        remaining="something does",
        frames="some frames are unusable",
    ),
)
@click.argument("source_path", type=FILE, metavar="STAGE|MESH")
@report_options("--json")
@IGNORE
@ATTACH
@DETACH
@field_option(
    CheckSettings,
    "mode",
    type=click.Choice(MODES),
    help="Pairs within a mesh, between meshes, or both.",
)
@REST_CONTACTS
@field_option(
    CheckSettings,
    "find_worn",
    flag="--modelled",
    help="List the pairs of parts whose contacts count as modelled, and where they are, and what "
    "a repair would take as worn.",
)
@as_settings(CheckSettings, check_selection_options)
@run_options
@jobs_option
@console_options
@one_line_errors
def command(
    *,
    source_path: str,
    reports: Reports,
    settings: CheckSettings,
    device: str,
    jobs: int | None,
    console: Console,
) -> int:
    """Count the intersecting triangles of a USD stage or a mesh file.

    Exact, in float32 coordinates: pairs of triangles that share no vertex (vertices at one position
    count as one) and have a common point; touching counts. One mesh is counted in its own space,
    several together in world space. What lies wholly inside something closed intersects nothing; it
    is told, and does not change the exit code. With -v each frame has a row, and each mesh of it
    that intersects.

    \b
    Example:
        dtrepair check shot.usd --prim "/Hero//" --frames 1:100x10
        dtrepair check hero.usd --modelled
        dtrepair check body.obj --report -
    """
    check_report_places(reports, console, source_path)
    observer = ConsoleObserver(console)
    report = check_stage(source_path, settings, jobs=jobs, device=device, observer=observer)
    if STDOUT not in reports.report:
        if settings.find_worn:
            print_modelled(console, report)
            print_worn(console, report)
        print_check(console, report)
    put_reports(report, reports, observer)
    console.refuse_lost_results()
    return exit_code(report)
