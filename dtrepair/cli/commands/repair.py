"""`dtrepair repair`: repair every selected frame, write a layer over the input or a mesh file."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import click

from dtrepair.cli.options.config import kept_tables
from dtrepair.cli.options.method import method_options
from dtrepair.cli.options.shared import (
    console_options,
    jobs_option,
    object_options,
    run_options,
    selection_options,
)
from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.console_observer import ConsoleObserver
from dtrepair.cli.terminal.failures import one_line_errors
from dtrepair.cli.terminal.interrupts import clean_up_if_forced
from dtrepair.cli.terminal.repair_text import print_plan, print_table, say
from dtrepair.cli.terminal.report_place import check_report_place, put_report
from dtrepair.pipeline.errors import CLEAN, FRAMES, REMAINING, UsageError
from dtrepair.pipeline.observer import Observer
from dtrepair.pipeline.repair.chunks import choose_chunk, empty_chunk_warnings, parse_chunk
from dtrepair.pipeline.repair.distributed import (
    ChunkedCommand,
    distributed_option,
    measured_jitter,
    repair_distributed,
)
from dtrepair.pipeline.repair.run import Run, open_journal, repair_here
from dtrepair.pipeline.selection import ObjectOptions, Selection
from dtrepair.pipeline.stages.bodies import Controls, make_bodies, read_controls
from dtrepair.pipeline.stages.devices import device_of_method
from dtrepair.pipeline.stages.frames import mode_warnings
from dtrepair.pipeline.stages.object_settings import recorded
from dtrepair.pipeline.stages.rest import choose_rests
from dtrepair.pipeline.stages.sinks import existing, open_sink
from dtrepair.pipeline.stages.sources import Source, open_source
from dtrepair.report.record import FrameRecord, Report

if TYPE_CHECKING:
    from dtrepair.repair.options import RepairOptions


@click.command(
    "repair",
    cls=ChunkedCommand,
    epilog="Exit code 0: every frame is clean; 1: intersections remain; 2: usage; 3: input "
    "unusable; 4: some frames failed, the rest is written; 5: output cannot be written.",
)
@click.argument("source_path", metavar="STAGE|MESH")
@click.option("-o", "--output", metavar="OUT", required=True, help="The layer or mesh to write.")
@click.option(
    "--rest",
    metavar="STAGE|MESH|TIME",
    help="Rest pose; default: the default-time points, else the frame with fewest intersections.",
)
@object_options
@click.option("--report", "report_path", metavar="F.json|-", help="Write a JSON report.")
@click.option("--resume", is_flag=True, help="Go on with an interrupted run of the same command.")
@click.option("--skip-existing", is_flag=True, help="Do nothing if OUT is there already.")
@click.option("--dry-run", is_flag=True, help="Say what would be done, and write nothing.")
@click.option(
    "--chunk",
    metavar="K/N",
    help="Part K of N of the frames, for a farm; `join` gives what one run would have given.",
)
@distributed_option
@click.option("--alone", is_flag=True, help="Repair each frame for itself, not steady in time.")
@selection_options
@method_options
@run_options
@jobs_option
@console_options
@one_line_errors
def command(
    *,
    source_path: str,
    output: str,
    rest: str | None,
    objects: ObjectOptions,
    report_path: str | None,
    resume: bool,
    skip_existing: bool,
    dry_run: bool,
    chunk: str | None,
    distributed: str | None,
    alone: bool,
    selection: Selection,
    options: RepairOptions,
    device: str,
    jobs: int,
    console: Console,
) -> int:
    """Repair the self-intersections of a USD stage or a mesh file.

    A stage gives a layer over it that holds new points only. Frames are repaired together, so that
    the correction is steady in time and eases in before a contact; frames away from contacts stay
    bit for bit as they are. Several meshes are repaired together in world space. A mesh file gives
    a mesh file with the same vertices and faces. The largest move of a frame is told as a part of
    the bounding-box diagonal of its mesh.

    Single objects may have settings of their own: tables [[prim]] in the file of --config with a
    path and any of diffusion, mobility (0 to 1), rigid, pin and direction, or constant primvars
    such as primvars:dtrepair:diffusion on the prim or above it. A table wins over a primvar, and
    both over the options.

    \b
    Example:
        dtrepair repair shot.usd --prim "/Hero//" -o shot_repaired.usdc --report report.json
        dtrepair repair body.obj -o body_repaired.obj
    """
    check_report_place(report_path, console, source_path, others=[output])
    if skip_existing and existing(output):
        console.result(f"{output}: exists; skipped")
        return CLEAN
    wanted = _Wanted(
        selection, objects, rest, parse_chunk(chunk), chunk, distributed, resume, dry_run
    )
    there, warnings = device_of_method(device, options.method)
    console.warn(warnings)
    # The published method knows single poses only.
    alone = alone or options.method == "paper"
    run = Run(source_path, output, there, options, jobs, alone)
    source = open_source(source_path, selection, collider=objects.collider)
    console.warn([*source.warnings, *mode_warnings(source, options.mode)])
    controls = _controls(run, source, objects, console)
    more = {"rest": rest, "objects": recorded(source, controls.settings), "chunk": chunk}
    run.settings = settings_of(selection, objects, options, more)
    report = _repair(run, source, controls, wanted, console)
    if report is None:
        return CLEAN
    put_report(report, report_path)
    print_table(console, report.frames, output)
    return _exit_code(report.frames)


@dataclass(frozen=True)
class _Wanted:
    """What a run is to do, beside the options of the method."""

    selection: Selection
    objects: ObjectOptions
    rest: str | None
    part: tuple[int, int] | None
    chunk: str | None
    distributed: str | None
    resume: bool
    dry_run: bool

    def __post_init__(self) -> None:
        """Refuse what does not go together."""
        if self.distributed is not None and (self.part is not None or self.resume):
            raise UsageError("--distributed: not with --chunk or --resume; leave one out")


def _controls(run: Run, source: Source, objects: ObjectOptions, console: Console) -> Controls:
    """What each object is told to do; refused where it has no effect."""
    _refuse_without_effect(run, directed=objects.direction is not None)
    controls = read_controls(source, objects, kept_tables())
    console.warn(controls.warnings)
    run.ignored = controls.ignored
    _refuse_without_effect(run, directed=any(way is not None for way in controls.directions))
    if run.options.method == "paper" and any(own.rigid for own in controls.settings):
        raise UsageError("--rigid: has no effect with --method paper; leave it out")
    return controls


def _repair(
    run: Run, source: Source, controls: Controls, wanted: _Wanted, console: Console
) -> Report | None:
    """Repair, here or on several machines, and write; None where nothing was to be done."""
    observer = ConsoleObserver(console, say)
    clean_up_if_forced(run.output)
    sink = open_sink(source, run.output, run.settings)
    try:
        run.lap("read")
        rests = choose_rests(source, wanted.rest, device=run.device)
        run.chunk = choose_chunk(source, wanted.part, alone=run.alone)
        console.warn(empty_chunk_warnings(run.chunk, wanted.chunk))
        if wanted.dry_run:
            written = run.chunk.times[run.chunk.written]
            print_plan(console, source, rests, run.output, controls.settings, written)
            return None
        bodies = make_bodies(source, rests, controls, observer, mode=run.options.mode)
        if wanted.distributed is not None and len(source.times) > 1:
            sink.abort()
            return _distributed(run, source, wanted, wanted.distributed, observer)
        journal = open_journal(run, bodies, observer, resume=wanted.resume)
        console.warn(journal.warnings if journal is not None else ())
        return repair_here(run, source, rests, bodies, sink, observer, journal)
    finally:
        sink.abort()


def _distributed(
    run: Run, source: Source, wanted: _Wanted, where: str, observer: Observer
) -> Report:
    """Repair on several workers; the report is of the whole run."""
    report = repair_distributed(where, source, run.output, jobs=run.jobs, observer=observer)
    result = open_source(run.output, wanted.selection, collider=wanted.objects.collider)
    run.lap("total")
    seconds = {**report.seconds, "total": run.seconds["total"]}
    jitter = measured_jitter(source, result)
    return replace(report, output=run.output, seconds=seconds, jitter=jitter)


def _refuse_without_effect(run: Run, *, directed: bool) -> None:
    """Refuse options that the published method does not have."""
    given = {
        "--direction": directed,
        "--clearance": run.options.clearance > 0.0,
        "--maximum-displacement": run.options.maximum_displacement is not None,
    }
    for option, used in given.items():
        if used and run.options.method == "paper":
            raise UsageError(f"{option}: has no effect with --method paper; leave it out")


def settings_of(
    selection: Selection, objects: ObjectOptions, options: RepairOptions, more: dict[str, Any]
) -> dict[str, Any]:
    """Return what is recorded of the choices of a run."""
    asked = {**vars(objects), "ignore": list(objects.ignore)}
    chosen = {**vars(selection), **asdict(options), **asked, **more}
    return {name: value for name, value in chosen.items() if value is not None}


def _exit_code(records: tuple[FrameRecord, ...]) -> int:
    if any(record.status == "failed" for record in records):
        return FRAMES
    left = any(record.status in ("improved", "unchanged") for record in records)
    return REMAINING if left else CLEAN
