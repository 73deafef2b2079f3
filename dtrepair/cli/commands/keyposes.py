"""`dtrepair keyposes`: repair the key samples only, and make the poses between them clean."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from dtrepair import __version__
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
from dtrepair.cli.terminal.keyposes_text import exit_code, in_betweens, print_keys, print_spans
from dtrepair.cli.terminal.repair_text import print_plan, print_table, say
from dtrepair.cli.terminal.report_place import check_report_place, put_report
from dtrepair.pipeline.errors import CLEAN, UsageError
from dtrepair.pipeline.keyposes.solve import StageKeys
from dtrepair.pipeline.observer import FrameDone
from dtrepair.pipeline.repair.run import Run, make_repairer
from dtrepair.pipeline.repair.settings import recorded_settings
from dtrepair.pipeline.selection import ObjectOptions, Selection
from dtrepair.pipeline.stages.bodies import Controls, make_bodies, read_controls
from dtrepair.pipeline.stages.devices import device_of_method
from dtrepair.pipeline.stages.frames import mode_warnings, prim_records, refuse_if_none_usable
from dtrepair.pipeline.stages.object_settings import recorded
from dtrepair.pipeline.stages.plan import make_plan
from dtrepair.pipeline.stages.rest import choose_rests, rest_warnings
from dtrepair.pipeline.stages.sinks import Sink, existing, open_sink
from dtrepair.pipeline.stages.sources import StageSource, is_stage, open_source
from dtrepair.report.record import FrameRecord, Report, summarize

if TYPE_CHECKING:
    from dtrepair.keyposes.spans import KeyOptions
    from dtrepair.repair.options import RepairOptions


@click.command(
    "keyposes",
    epilog="Exit code 0: keys and in-betweens are clean; 1: intersections remain (or were found "
    "by --verify-only); 2: usage; 3: input unusable; 4: some keys failed, the rest is written; "
    "5: output cannot be written.",
)
@click.argument("source_path", metavar="STAGE")
@click.option("-o", "--output", metavar="OUT", help="The layer to write.")
@click.option(
    "--samples",
    type=click.IntRange(min=1),
    default=4,
    show_default=True,
    metavar="N",
    help="In-betweens that are looked at between two keys.",
)
@click.option(
    "--interpolation",
    type=click.Choice(["linear", "cubic"]),
    default="linear",
    show_default=True,
    help="linear as USD interpolates, or a Catmull-Rom spline through the keys.",
)
@click.option(
    "--extra-keys",
    type=click.IntRange(min=0),
    default=8,
    show_default=True,
    metavar="N",
    help="Most keys added between two keys.",
)
@click.option("--keep-keys", is_flag=True, help="Never move a key for the sake of an in-between.")
@click.option("--verify-only", is_flag=True, help="Count only, and write nothing.")
@click.option(
    "--rest",
    metavar="STAGE|MESH|TIME",
    help="Rest pose; default: the default-time points, else the key with fewest intersections.",
)
@object_options
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
    source_path: str,
    output: str | None,
    samples: int,
    interpolation: str,
    extra_keys: int,
    keep_keys: bool,
    verify_only: bool,
    rest: str | None,
    objects: ObjectOptions,
    report_path: str | None,
    skip_existing: bool,
    dry_run: bool,
    selection: Selection,
    options: RepairOptions,
    device: str,
    jobs: int,
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
    from dtrepair.keyposes.spans import KeyOptions

    _check(source_path, output, verify_only=verify_only)
    check_report_place(report_path, console, source_path, others=[output])
    if output is not None and skip_existing and existing(output):
        console.result(f"{output}: exists; skipped")
        return CLEAN
    there, warnings = device_of_method(device, options.method)
    console.warn(warnings)
    # Tightened keys touch, and leave no room for the poses between them.
    options = replace(options, tighten=0)
    run = Run(source_path, output or "", there, options, jobs, alone=True)
    search = KeyOptions(samples, extra_keys, keep_keys, interpolation, jobs)
    source = _read(source_path, selection, objects, console, mode=options.mode)
    controls = read_controls(source, objects, kept_tables())
    console.warn(controls.warnings)
    run.ignored = controls.ignored
    more: dict[str, Any] = {"rest": rest, "objects": recorded(source, controls.settings)}
    run.settings = recorded_settings(selection, objects, options, {**more, **vars(search)})
    del run.settings["jobs"]
    report = _keys(run, source, controls, search, console, rest=rest, dry_run=dry_run)
    if report is None:
        return CLEAN
    put_report(report, report_path)
    _print(console, report, output)
    return exit_code(report)


def _check(source_path: str, output: str | None, *, verify_only: bool) -> None:
    """Refuse what `keyposes` cannot work on."""
    if verify_only == (output is not None):
        raise UsageError("name an output with -o OUT, or --verify-only, which writes nothing")
    if not is_stage(source_path):
        raise UsageError(f"{source_path}: is not a USD stage: only stages have keys")


def _read(
    source_path: str, selection: Selection, objects: ObjectOptions, console: Console, *, mode: str
) -> StageSource:
    """The stage, which must have time samples."""
    source = open_source(source_path, selection, collider=objects.collider)
    assert isinstance(source, StageSource)
    if math.isnan(source.times[0]):
        raise UsageError(f"{source_path}: no mesh has time samples; use dtrepair repair")
    console.warn([*source.warnings, *mode_warnings(source, mode)])
    return source


def _print(console: Console, report: Report, output: str | None) -> None:
    """Print the tables of the keys and of the spans between them."""
    if output is not None:
        print_table(console, report.frames, output)
    else:
        print_keys(console, report.frames)
    print_spans(console, report)


def _keys(
    run: Run,
    source: StageSource,
    controls: Controls,
    search: KeyOptions,
    console: Console,
    *,
    rest: str | None,
    dry_run: bool,
) -> Report | None:
    """Repair, or count where there is no output; None where nothing was to be done."""
    output = run.output or None
    if output is not None:
        clean_up_if_forced(output)
    sink = None if output is None else open_sink(source, output, run.settings)
    try:
        run.lap("read")
        rests = choose_rests(source, rest, device=run.device)
        if dry_run:
            print_plan(console, make_plan(source, rests, source.times, output, controls.settings))
            return None
        bodies = make_bodies(
            source, rests, controls, ConsoleObserver(console, say), mode=run.options.mode
        )
        repairer, rest_counts = make_repairer(run, source, rests, bodies)
        console.warn(rest_warnings(source, rests, rest_counts))
        run.lap("factor")
        rigid = [bool(own.rigid) for own in controls.settings]
        report = _solve(run, StageKeys(source, repairer, rigid), search, sink, console)
    finally:
        if sink is not None:
            sink.abort()
    prims = prim_records(source, rest_counts)
    return replace(report, prims=prims, warnings=(*source.warnings, *report.warnings))


def _solve(
    run: Run, keys: StageKeys, search: KeyOptions, sink: Sink | None, console: Console
) -> Report:
    """Repair the keys, then the in-betweens; write; return the report."""
    from dtrepair.keyposes.search import clean_in_betweens, verify_in_betweens

    records: dict[float, FrameRecord] = {}
    for time in console.progress(keys.selected, total=len(keys.selected), what="keys"):
        done = keys.check_key(time) if sink is None else keys.repair_key(time)
        records[time] = done.record
        ConsoleObserver(console, say).remark(FrameDone(done.record, done.error))
    refuse_if_none_usable(keys.source, list(records.values()))
    run.lap("solve")
    if sink is None:
        found = verify_in_betweens(keys.tracks, keys.spans, keys, options=search)
    else:
        found = clean_in_betweens(
            keys.tracks,
            keys.spans,
            keys,
            options=search,
            progress=lambda done: console.remark(f"{done} of {len(keys.spans)} spans done"),
        )
    run.lap("in-betweens")
    added = {time: None for span in found.spans for time in span.added}
    frames = tuple(
        keys.record(record, time, found.tracks)
        for time, record in sorted({**records, **added}.items())
    )
    warnings: tuple[str, ...] = ()
    if sink is not None:
        keys.write(found.tracks, sink)
        warnings = sink.commit({"counts": summarize(frames)})
        console.warn(warnings)
        run.lap("write")
    return Report(
        command="keyposes",
        version=__version__,
        input=run.input,
        output=run.output or None,
        device=run.device,
        settings=run.settings,
        seconds={**run.seconds, "total": run.last - run.start},
        frames=frames,
        warnings=warnings,
        keyposes=in_betweens(found, search.interpolation, keys.skipped),
    )
