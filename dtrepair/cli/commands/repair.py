"""`dtrepair repair`: repair every selected frame, write a layer over the input or a mesh file."""

from __future__ import annotations

from typing import Any

import click

from dtrepair.cli.exit_codes import exit_codes
from dtrepair.cli.options.distributed import distributed_option
from dtrepair.cli.options.file_names import FILE
from dtrepair.cli.options.method import method_options
from dtrepair.cli.options.output import output_options
from dtrepair.cli.options.reporting import report_options
from dtrepair.cli.options.sections import Command
from dtrepair.cli.options.settings import as_settings
from dtrepair.cli.options.shared import (
    jobs_option,
    object_options,
    run_options,
    selection_options,
)
from dtrepair.cli.options.verbosity import console_options
from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.console_observer import ConsoleObserver
from dtrepair.cli.terminal.failures import one_line_errors
from dtrepair.cli.terminal.interrupts import clean_up_if_forced
from dtrepair.cli.terminal.outputs import Reports, already_written, check_report_places, put_reports
from dtrepair.cli.terminal.repair_text import print_plan, print_table, say
from dtrepair.pipeline.errors import ALONE, CLEAN, FRAMES, INPUT, OUTPUT, exit_code
from dtrepair.pipeline.repair.settings import RepairSettings
from dtrepair.pipeline.repair.stage import plan_repair, repair_stage


@click.command(
    "repair",
    cls=Command,
    epilog=exit_codes(
        INPUT,
        FRAMES,
        OUTPUT,
        ALONE,
        clean="every frame is clean (a --clearance that is not reached is a warning)",
        remaining="intersections remain, or frames are strained",
        workers="workers were lost, nothing is written, --resume goes on",
    ),
)
@click.argument("source_path", type=FILE, metavar="STAGE|MESH")
@click.option(
    "-o", "--output", type=FILE, metavar="OUT", required=True, help="The layer or mesh to write."
)
@click.option(
    "--rest",
    type=FILE,
    metavar="STAGE|MESH|TIME",
    help="Rest pose; default: the default-time points, else the frame with fewest intersections.",
)
@report_options()
@click.option("--resume", is_flag=True, help="Go on with an interrupted run of the same command.")
@click.option(
    "--skip-existing",
    is_flag=True,
    help="Do nothing if OUT is there already, of this input as it is now and these choices.",
)
@click.option("--dry-run", is_flag=True, help="Say what would be done, and write nothing.")
@click.option(
    "--chunk",
    metavar="K/N",
    help="Part K of N of the frames, for a farm; `join` gives what one run would have given.",
)
@distributed_option
@click.option("--alone", is_flag=True, help="Repair each frame for itself, not steady in time.")
@as_settings(RepairSettings, object_options, output_options, selection_options, method_options)
@run_options
@jobs_option
@console_options
@one_line_errors
def command(
    *,
    source_path: str,
    output: str,
    settings: RepairSettings,
    reports: Reports,
    skip_existing: bool,
    dry_run: bool,
    jobs: int | None,
    console: Console,
    **running: Any,
) -> int:
    """Repair the self-intersections of a USD stage or a mesh file.

    A stage gives a layer over it that holds new points only. Frames are repaired together, so that
    the correction is steady in time: it eases in over some frames before a contact, and out after
    it; frames farther off stay bit for bit as they are. Several meshes are repaired together in
    world space. A mesh file gives a mesh file with the same vertices and faces. Lengths are in
    stage units, with per cent of the size, the diagonal of the bounding box, in brackets.

    Single objects may have settings of their own: tables [[prim]] in the file of --config with a
    path and any of diffusion, mobility (0 to 1), rigid, pin, direction, attach, detach and layer,
    or constant primvars such as primvars:dtrepair:diffusion on the prim or above it. A table wins
    over a primvar, and both over the options.

    \b
    Example:
        dtrepair repair shot.usd --prim "/Hero//" -o shot_repaired.usdc --report report.json
        dtrepair repair body.obj -o body_repaired.obj
    """
    check_report_places(reports, console, source_path, others=[output])
    read = source_path, [settings.rest] if settings.rest else []
    known = settings.recorded, RepairSettings().recorded
    if skip_existing:
        done = already_written(output, console, reports, *read, known)
        if done is not None:
            return done
    inputs = (source_path, output, settings)
    replaced = None if running["resume"] else output
    running["observer"] = ConsoleObserver(console, say, output=replaced)
    if dry_run:
        print_plan(console, plan_repair(*inputs, **running))
        return CLEAN
    clean_up_if_forced(output)
    report = repair_stage(*inputs, jobs=jobs, **running)
    put_reports(report, reports, running["observer"])
    print_table(console, report.frames, output)
    return exit_code(report)
