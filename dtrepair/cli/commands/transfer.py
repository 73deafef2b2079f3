"""`dtrepair transfer`: the motion of one character for another (deformation transfer)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from dtrepair.cli.options.method import METHOD_NAMES, method_options
from dtrepair.cli.options.shared import console_options, jobs_option, run_options, selection_options
from dtrepair.cli.options.transfer import Inputs, TransferOptions
from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.failures import one_line_errors
from dtrepair.cli.terminal.interrupts import clean_up_if_forced
from dtrepair.cli.terminal.report_place import check_report_place, put_report
from dtrepair.pipeline.errors import CLEAN, UsageError
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.devices import device_of_method
from dtrepair.pipeline.stages.outputs import check_writable, refuse_overwriting
from dtrepair.pipeline.stages.sinks import existing
from dtrepair.pipeline.transfer.run import run_transfer

if TYPE_CHECKING:
    from dtrepair.repair.options import RepairOptions


class GreedyPoses(click.Command):
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


_UP = click.Choice(["Y", "Z"], case_sensitive=False)


@click.command(
    "transfer",
    cls=GreedyPoses,
    epilog="Exit code 0: done, nothing intersects; 1: the result intersects itself, but is "
    "written; 2: usage; 3: input unusable; 4: some frames failed, the rest is written; 5: output "
    "cannot be written.",
)
@click.argument("source_path", metavar="SOURCE")
@click.argument("target_path", metavar="TARGET")
@click.option("-o", "--output", metavar="OUT", required=True, help="The stage or layer to write.")
@click.option(
    "--poses",
    multiple=True,
    metavar="FILE...",
    help="Poses of SOURCE: mesh files, time codes 1, 2, ...; or one animated stage.",
)
@click.option("--markers", metavar="F", help="Vertex pairs: .cons, two columns of text, or npz.")
@click.option("--correspondence", metavar="F", help="Triangle pairs: .tricorrs, text, or npz.")
@click.option("--save-correspondence", metavar="F", help="Write the triangle pairs: npz or text.")
@click.option("--rest", metavar="STAGE|MESH|TIME", help="Rest pose of SOURCE; default as repair.")
@click.option("--target-prim", metavar="EXPR", help="The mesh of TARGET, as --prim for SOURCE.")
@click.option("--source-up", type=_UP, help="Up axis of SOURCE, where it does not say.")
@click.option("--target-up", type=_UP, help="Up axis of TARGET, where it does not say.")
@click.option(
    "--align",
    type=click.Choice(["axes", "rests"]),
    default="axes",
    show_default=True,
    help="Turn the motion as the up axes, or as the rest poses, lie to each other.",
)
@click.option(
    "--root-scale",
    type=click.FloatRange(min=0.0),
    metavar="X",
    help="Scale of the travel; default: the ratio of the heights.",
)
@click.option("--ground", is_flag=True, help="Keep the lowest vertex on the source's ground.")
@click.option(
    "--pin",
    metavar="NAME|F.npz",
    help="Target vertices held at rest: primvar or GeomSubset; or npz of vertices, positions.",
)
@click.option("--repair", is_flag=True, help="Repair each frame; the target's rest is its rest.")
@click.option(
    "--alone/--together",
    default=None,
    help="Repair frames for themselves (default for pose files) or steady in time (stages).",
)
@click.option(
    "--shapes",
    is_flag=True,
    help="Take --poses, or the blend shapes of SOURCE, as shapes; write UsdSkel blend shapes.",
)
@click.option("--picture", metavar="F.png", help="Draw the registered source over the target.")
@click.option("--report", "report_path", metavar="F.json|-", help="Write a JSON report.")
@click.option("--skip-existing", is_flag=True, help="Do nothing if OUT is there already.")
@click.option("--dry-run", is_flag=True, help="Say what would be done, and write nothing.")
@selection_options
@method_options
@run_options
@jobs_option
@console_options
@one_line_errors
def command(
    *,
    output: str,
    repair: bool,
    selection: Selection,
    options: RepairOptions,
    device: str,
    jobs: int,
    console: Console,
    skip_existing: bool,
    report_path: str | None,
    picture: str | None,
    **given: Any,
) -> int:
    """Give TARGET the motion of SOURCE (deformation transfer).

    SOURCE is an animated stage, or a rest mesh with its --poses; TARGET a rest mesh in a stage or a
    mesh file. Without --markers and --correspondence both have the same topology. A stage as
    TARGET gives a layer over it, a mesh file a new stage; time codes are those of the source.

    \b
    Example:
        dtrepair transfer horse.obj camel.obj --poses horse-*.obj --markers horse_camel.cons \\
            --repair -o camel.usdc --report report.json
        dtrepair transfer walk.usd hero.usd --prim /Cat/Body --target-prim /Lion/Body \\
            --correspondence cat_lion.npz -o lion_walk.usdc
    """
    if skip_existing and existing(output):
        console.result(f"{output}: exists; skipped")
        return CLEAN
    wanted = TransferOptions(repair=options if repair else None, picture=picture, **given)
    _check_options(wanted)
    _check_outputs(wanted, output, report_path, console)
    there, warnings = device_of_method(device, options.method)
    console.warn(warnings)
    clean_up_if_forced(output)
    inputs = Inputs(wanted, selection, there, jobs)
    code, report = run_transfer(inputs, output, console)
    if report is not None:
        put_report(report, report_path)
    return code


def _check_options(wanted: TransferOptions) -> None:
    if wanted.markers and wanted.correspondence:
        raise UsageError("--markers, --correspondence: give one of them")
    if wanted.ground and wanted.pin:
        raise UsageError("--ground: has no effect on pinned frames; leave out it or --pin")
    if wanted.shapes and wanted.pin:
        raise UsageError("--pin: has no effect with --shapes; leave it out")
    if wanted.shapes and wanted.repair is not None:
        raise UsageError("--repair: repairs motion, not --shapes; repair the posed result")
    if wanted.repair is not None:
        return
    context = click.get_current_context()
    for name in (*METHOD_NAMES, "alone"):
        # A file of --config may serve `repair` as well.
        if context.get_parameter_source(name) == ParameterSource.COMMANDLINE:
            option = name.replace("_", "-")
            raise UsageError(f"--{option}: has no effect without --repair")


def _check_outputs(
    wanted: TransferOptions, output: str, report: str | None, console: Console
) -> None:
    """Refuse outputs that are inputs, each other, or not writable, before any computing."""
    inputs = [wanted.source_path, wanted.target_path, *wanted.poses]
    inputs += [path for path in (wanted.markers, wanted.correspondence, wanted.pin) if path]
    files = [output]
    refuse_overwriting(output, *inputs)
    for path in (wanted.save_correspondence, wanted.picture):
        if path is not None:
            refuse_overwriting(path, *inputs, others=files)
            check_writable(path)
            files.append(path)
    check_report_place(report, console, *inputs, others=files)
