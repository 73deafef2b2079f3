"""`dtrepair keyposes`: repair the key samples only, and make the poses between them clean."""

from __future__ import annotations

import click

from dtrepair.cli.exit_codes import exit_codes
from dtrepair.cli.options.file_names import FILE
from dtrepair.cli.options.keyposes import key_options
from dtrepair.cli.options.method import method_options
from dtrepair.cli.options.reporting import report_options
from dtrepair.cli.options.sections import Command
from dtrepair.cli.options.settings import as_settings
from dtrepair.cli.options.shared import (
    jobs_option,
    key_selection_options,
    object_options,
    run_options,
)
from dtrepair.cli.options.verbosity import console_options
from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.console_observer import ConsoleObserver
from dtrepair.cli.terminal.failures import one_line_errors
from dtrepair.cli.terminal.interrupts import clean_up_if_forced
from dtrepair.cli.terminal.keyposes_text import print_keys, print_spans
from dtrepair.cli.terminal.outputs import Reports, already_written, check_report_places, put_reports
from dtrepair.cli.terminal.repair_text import print_plan, print_table, say
from dtrepair.pipeline.errors import CLEAN, INPUT, OUTPUT, UsageError, exit_code
from dtrepair.pipeline.keyposes.settings import KeyposeSettings
from dtrepair.pipeline.keyposes.stage import plan_keyposes, repair_keyposes


@click.command(
    "keyposes",
    cls=Command,
    epilog=exit_codes(
        INPUT,
        OUTPUT,
        clean="keys and in-betweens are clean",
        remaining="intersections remain, or were found by --verify-only",
        frames="some keys failed, the rest is written",
    ),
)
@click.argument("source_path", type=FILE, metavar="STAGE")
@click.option("-o", "--output", type=FILE, metavar="OUT", help="The layer to write.")
@click.option("--verify-only", is_flag=True, help="Count only, and write nothing.")
@click.option(
    "--rest",
    type=FILE,
    metavar="STAGE|MESH|TIME",
    help="Rest pose; default: the default-time points, else the key with fewest intersections.",
)
@report_options()
@click.option(
    "--skip-existing",
    is_flag=True,
    help="Do nothing if OUT is there already, of this input as it is now and these choices.",
)
@click.option("--dry-run", is_flag=True, help="Say what would be done, and write nothing.")
@as_settings(KeyposeSettings, key_options, object_options, key_selection_options, method_options)
@run_options
@jobs_option
@console_options
@one_line_errors
def command(
    *,
    source_path: str,
    output: str | None,
    settings: KeyposeSettings,
    verify_only: bool,
    reports: Reports,
    skip_existing: bool,
    dry_run: bool,
    device: str,
    jobs: int | None,
    console: Console,
) -> int:
    """Repair the keys of a stage, and make the poses between them clean.

    Keys are the samples of the points, of skins those of the joints, and of the transforms where
    several meshes meet; of animation with a sample on every frame those that --frames names one by
    one. Each is repaired for itself, with a little room; clean ones stay bit for bit. Then N
    in-betweens of each span between keys are counted exactly as USD interpolates them, and whole
    frames of skins there. Where some intersect, the two keys are moved by up to 2 % of their size
    at a time, if that is enough; else in-betweens are repaired and added as keys, the fewest that
    were found. Spans between new keys have N samples each, too.

    \b
    Example:
        dtrepair keyposes poses.usd -o poses_repaired.usdc --samples 8 --report report.json
        dtrepair keyposes poses.usd --verify-only
        dtrepair keyposes baked.usd --frames 1,9,17,25 -o baked_repaired.usdc
    """
    if verify_only and output is not None:
        raise UsageError("--verify-only writes nothing: leave out -o, or --verify-only")
    if not verify_only and output is None:
        raise UsageError("name an output with -o OUT, or --verify-only, which writes nothing")
    check_report_places(reports, console, source_path, others=[output])
    if output is not None:
        read = source_path, [settings.rest] if settings.rest else []
        known = settings.recorded, KeyposeSettings().recorded
        done = already_written(output, console, reports, *read, known) if skip_existing else None
        if done is not None:
            return done
        clean_up_if_forced(output)
    inputs = (source_path, output, settings)
    observer = ConsoleObserver(console, say, output=output)
    if dry_run:
        print_plan(console, plan_keyposes(*inputs, device=device, observer=observer))
        return CLEAN
    report = repair_keyposes(*inputs, jobs=jobs, device=device, observer=observer)
    put_reports(report, reports, observer)
    if output is not None:
        print_table(console, report.frames, output)
    else:
        print_keys(console, report.frames)
    print_spans(console, report)
    return exit_code(report)
