"""`dtrepair transfer`: the motion of one character for another (deformation transfer)."""

from __future__ import annotations

import click

from dtrepair.cli.exit_codes import exit_codes
from dtrepair.cli.options.file_names import FILE
from dtrepair.cli.options.reporting import report_options
from dtrepair.cli.options.sections import Command
from dtrepair.cli.options.shared import jobs_option, run_options
from dtrepair.cli.options.transfer import transfer_settings
from dtrepair.cli.options.verbosity import console_options
from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.console_observer import ConsoleObserver
from dtrepair.cli.terminal.failures import one_line_errors
from dtrepair.cli.terminal.interrupts import clean_up_if_forced
from dtrepair.cli.terminal.outputs import Reports, already_written, check_report_places, put_reports
from dtrepair.cli.terminal.transfer_text import print_plan, print_report, say
from dtrepair.pipeline.errors import CLEAN, FRAMES, INPUT, OUTPUT, exit_code
from dtrepair.pipeline.transfer.run import files_of, plan_transfer, transfer_stage
from dtrepair.pipeline.transfer.settings import TransferSettings


class GreedyPoses(Command):
    """A command whose --poses takes all words up to the next option."""

    def parse_args(self, context: click.Context, arguments: list[str]) -> list[str]:
        """Repeat the option before each of its values, which click can read."""
        expanded: list[str] = []
        inside = False
        for word in arguments:
            if word == "--poses" or word.startswith("-"):
                inside = word == "--poses"
                expanded += [] if inside else [word]
            else:
                expanded += ["--poses", word] if inside else [word]
        return super().parse_args(context, expanded)


@click.command(
    "transfer",
    cls=GreedyPoses,
    epilog=exit_codes(
        INPUT,
        FRAMES,
        OUTPUT,
        clean="done, nothing intersects",
        remaining="the result intersects itself, but is written",
        alone="with --repair: frames could not be repaired together, each is written as repaired "
        "alone",
        workers="with --repair: workers were lost, nothing is written",
    ),
)
@click.argument("source_path", type=FILE, metavar="SOURCE")
@click.argument("target_path", type=FILE, metavar="TARGET")
@click.option(
    "-o", "--output", type=FILE, metavar="OUT", required=True, help="The stage or layer to write."
)
@click.option(
    "--poses",
    type=FILE,
    multiple=True,
    metavar="FILE...",
    help="Poses of SOURCE: mesh files, time codes 1, 2, ...; or one animated stage.",
)
@click.option(
    "--rest", type=FILE, metavar="STAGE|MESH|TIME", help="Rest pose of SOURCE; default as repair."
)
@click.option("--repair", is_flag=True, help="Repair each frame; the target's rest is its rest.")
@click.option(
    "--alone/--together",
    default=None,
    help="Repair frames for themselves (default for pose files) or steady in time (stages).",
)
@report_options()
@click.option(
    "--skip-existing",
    is_flag=True,
    help="Do nothing if OUT is there already, of these choices, and no input file is newer.",
)
@click.option("--dry-run", is_flag=True, help="Say what would be done, and write nothing.")
@transfer_settings
@run_options
@jobs_option
@console_options
@one_line_errors
def command(
    *,
    source_path: str,
    target_path: str,
    output: str,
    settings: TransferSettings,
    reports: Reports,
    skip_existing: bool,
    dry_run: bool,
    device: str,
    jobs: int | None,
    console: Console,
) -> int:
    """Give TARGET the motion of SOURCE (deformation transfer).

    SOURCE is an animated stage, or a rest mesh with its --poses; TARGET a rest mesh in a stage or a
    mesh file. Without --markers and --correspondence both have the same topology. A stage as
    TARGET gives a layer over it, a mesh file a new stage; time codes are those of the source.

    Both may have several meshes: a body, clothes, eyes. --markers ties the largest of either side,
    meshes of one topology go together, --match says more; what is left of TARGET follows the
    nearest part. --repair takes them as one scene, in which contacts of the rest were modelled.

    \b
    Example:
        dtrepair transfer horse.obj camel.obj --poses horse-*.obj --markers horse_camel.cons \\
            --repair -o camel.usdc --report report.json
        dtrepair transfer walk.usd hero.usd --prim /Cat/Body --target-prim /Lion/Body \\
            --correspondence cat_lion.npz -o lion_walk.usdc
    """
    read, written = files_of(source_path, target_path, settings)
    check_report_places(reports, console, *read, others=[output, *written])
    known = settings.recorded(source_path, target_path), TransferSettings.unsaid()
    if skip_existing:
        done = already_written(output, console, reports, None, read, known)
        if done is not None:
            return done
    observer = ConsoleObserver(console, say, output=output)
    inputs = (source_path, target_path, output, settings)
    clean_up_if_forced(output)
    if dry_run:
        print_plan(console, plan_transfer(*inputs, device=device, observer=observer))
        return CLEAN
    report = transfer_stage(*inputs, jobs=jobs, device=device, observer=observer)
    print_report(console, report, repaired=settings.repair is not None)
    put_reports(report, reports, observer)
    return exit_code(report)
