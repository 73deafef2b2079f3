"""`dtrepair keyposes`: repair the key samples only, and make the poses between them clean."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from dtrepair.cli.options.config import kept_tables
from dtrepair.cli.options.keyposes import key_options
from dtrepair.cli.options.method import method_options
from dtrepair.cli.options.shared import (
    console_options,
    jobs_option,
    key_selection_options,
    object_options,
    run_options,
)
from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.console_observer import ConsoleObserver
from dtrepair.cli.terminal.failures import one_line_errors
from dtrepair.cli.terminal.interrupts import clean_up_if_forced
from dtrepair.cli.terminal.keyposes_text import print_keys, print_spans
from dtrepair.cli.terminal.outputs import already_written, check_report_place, put_report
from dtrepair.cli.terminal.repair_text import print_plan, print_table, say
from dtrepair.keyposes.options import KeyOptions
from dtrepair.pipeline.errors import CLEAN, UsageError, exit_code
from dtrepair.pipeline.keyposes.settings import KeyposeSettings
from dtrepair.pipeline.keyposes.stage import plan_keyposes, repair_keyposes
from dtrepair.pipeline.selection import ObjectOptions, Selection

if TYPE_CHECKING:
    from dtrepair.repair.options import RepairOptions


@click.command(
    "keyposes",
    epilog="Exit code 0: keys and in-betweens are clean; 1: intersections remain (or were found "
    "by --verify-only); 2: usage; 3: input unusable; 4: some keys failed, the rest is written; "
    "5: output cannot be written; 130 and 143: interrupted, an older output is intact.",
)
@click.argument("source_path", metavar="STAGE")
@click.option("-o", "--output", metavar="OUT", help="The layer to write.")
@key_options
@click.option("--verify-only", is_flag=True, help="Count only, and write nothing.")
@click.option(
    "--rest",
    metavar="STAGE|MESH|TIME",
    help="Rest pose; default: the default-time points, else the key with fewest intersections.",
)
@object_options
@click.option("--report", "report_path", metavar="F.json|-", help="Write a JSON report.")
@click.option(
    "--skip-existing", is_flag=True, help="Do nothing if OUT is there already, and can be read."
)
@click.option("--dry-run", is_flag=True, help="Say what would be done, and write nothing.")
@key_selection_options
@method_options
@run_options
@jobs_option
@console_options
@one_line_errors
def command(
    *,
    source_path: str,
    output: str | None,
    keys: KeyOptions,
    verify_only: bool,
    rest: str | None,
    objects: ObjectOptions,
    report_path: str | None,
    skip_existing: bool,
    dry_run: bool,
    selection: Selection,
    options: RepairOptions,
    device: str,
    jobs: int | None,
    console: Console,
) -> int:
    """Repair the keys of a stage, and make the poses between them clean.

    Keys are the samples of the points, and of the transforms where several meshes meet. Each is
    repaired for itself; clean ones stay bit for bit. Then N in-betweens of each span between keys
    are counted exactly as USD interpolates them. Where some intersect, the two keys are moved
    by up to 2 % of the diagonal at a time, if that is enough; else in-betweens are repaired and
    added as keys, the fewest that were found. Spans between new keys have N samples each, too.

    \b
    Example:
        dtrepair keyposes poses.usd -o poses_repaired.usdc --samples 8 --report report.json
        dtrepair keyposes poses.usd --verify-only
    """
    if verify_only == (output is not None):
        raise UsageError("name an output with -o OUT, or --verify-only, which writes nothing")
    check_report_place(report_path, console, source_path, others=[output])
    if output is not None and skip_existing and already_written(output, console):
        return CLEAN
    if output is not None:
        clean_up_if_forced(output)
    settings = KeyposeSettings(
        selection=selection,
        keys=keys,
        options=options,
        objects=objects,
        tables=kept_tables(),
        rest=rest,
    )
    observer = ConsoleObserver(console, say)
    if dry_run:
        plan = plan_keyposes(source_path, output, settings, device=device, observer=observer)
        print_plan(console, plan)
        return CLEAN
    report = repair_keyposes(
        source_path, output, settings, jobs=jobs, device=device, observer=observer
    )
    put_report(report, report_path)
    if output is not None:
        print_table(console, report.frames, output)
    else:
        print_keys(console, report.frames)
    print_spans(console, report)
    return exit_code(report)
