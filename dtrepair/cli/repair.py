"""`dtrepair repair`: repair every selected frame, write a layer over the input or a mesh file."""

from __future__ import annotations

import time as clock
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import click

from dtrepair import __version__
from dtrepair.cli.bodies import make_bodies, read_pins
from dtrepair.cli.console import Console
from dtrepair.cli.failures import (
    CLEAN,
    FRAMES,
    REMAINING,
    check_writable,
    one_line_errors,
    refuse_overwriting,
    use_device,
    writing,
)
from dtrepair.cli.frames import make_counter, prim_records, read_frames
from dtrepair.cli.method import method_options
from dtrepair.cli.options import (
    Selection,
    console_options,
    jobs_option,
    run_options,
    selection_options,
)
from dtrepair.cli.rest import Rest, choose_rests
from dtrepair.cli.sinks import Sink, existing, open_sink
from dtrepair.cli.solve import FrameRepairer, Repaired, repair_frames
from dtrepair.cli.sources import Source, open_source, time_label
from dtrepair.jitter_meter import JitterMeter
from dtrepair.record import FrameRecord, Report, summarize, write_report

if TYPE_CHECKING:
    from dtrepair.repair.options import RepairOptions
    from dtrepair.repair.repairer import Body


@click.command(
    "repair",
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
@click.option("--collider", metavar="EXPR", help="Meshes that take part but never move.")
@click.option("--pin", metavar="NAME", help="Primvar (0 free to 1 fixed) or GeomSubset (fixed).")
@click.option("--report", "report_path", metavar="F.json", help="Write a JSON report.")
@click.option("--skip-existing", is_flag=True, help="Do nothing if OUT is there already.")
@click.option("--dry-run", is_flag=True, help="Say what would be done, and write nothing.")
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
    collider: str | None,
    pin: str | None,
    report_path: str | None,
    skip_existing: bool,
    dry_run: bool,
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
    a mesh file with the same vertices and faces.

    \b
    Example:
        dtrepair repair shot.usd --prim "/Hero//" -o shot_repaired.usdc --report report.json
        dtrepair repair body.obj -o body_repaired.obj
    """
    if skip_existing and existing(output):
        console.result(f"{output}: exists; skipped")
        return CLEAN
    if report_path is not None:
        refuse_overwriting(report_path, source_path, output)
        check_writable(report_path)
    run = Run(source_path, output, use_device(device), options, jobs, alone)
    source = open_source(source_path, selection, collider=collider)
    console.warn(source.warnings)
    run.settings = _settings(selection, options, rest=rest, collider=collider, pin=pin)
    pins = read_pins(source, pin)
    sink = open_sink(source, output, run.settings)
    try:
        run.lap("read")
        rests = choose_rests(source, rest, device=run.device)
        if dry_run:
            _print_plan(console, source, rests, output)
            return CLEAN
        bodies = make_bodies(source, rests, pins)
        report = _repair(run, source, rests, bodies, sink, console)
    finally:
        sink.abort()
    if report_path is not None:
        with writing(report_path):
            write_report(report, report_path)
    _print_table(console, report.frames, output)
    return _exit_code(report.frames)


@dataclass
class Run:
    """What a run is about, and its clock: `seconds` of each part."""

    input: str
    output: str
    device: str
    options: RepairOptions
    jobs: int
    alone: bool
    settings: dict[str, Any] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    start: float = field(default_factory=clock.perf_counter)
    last: float = field(default_factory=clock.perf_counter)

    def lap(self, name: str) -> None:
        """Give the time since the last lap to a part."""
        now = clock.perf_counter()
        self.seconds[name] = self.seconds.get(name, 0.0) + now - self.last
        self.last = now


def _settings(selection: Selection, options: RepairOptions, **more: str | None) -> dict[str, Any]:
    chosen = {**vars(selection), **asdict(options), **more}
    return {name: value for name, value in chosen.items() if value is not None}


def _repair(
    run: Run,
    source: Source,
    rests: list[Rest],
    bodies: list[Body],
    sink: Sink,
    console: Console,
) -> Report:
    """Repair all frames into the sink, commit it, and return the report."""
    repairer, rest_counts = _make_repairer(run, source, rests, bodies)
    run.lap("factor")
    console.warn(_rest_warnings(source, rests, rest_counts))
    records: list[FrameRecord] = []
    meter = [JitterMeter() for _ in source.meshes]
    frames = repair_frames(read_frames(source, source.times), repairer)
    for repaired in console.progress(frames, total=len(source.times), what="repairing"):
        _store(repaired, sink, meter)
        records.append(repaired.record)
        for name, value in repaired.seconds.items():
            run.seconds[name] = run.seconds.get(name, 0.0) + value
        _say(console, repaired)
    run.last = clock.perf_counter()
    summary = summarize(records)
    warnings = (*repairer.warnings, *sink.commit({"counts": summary}))
    console.warn(warnings)
    run.lap("write")
    run.seconds["total"] = clock.perf_counter() - run.start
    return Report(
        command="repair",
        version=__version__,
        input=run.input,
        output=run.output,
        device=run.device,
        settings={**run.settings, "rest": [rest.origin for rest in rests]},
        seconds=run.seconds,
        prims=prim_records(source, rest_counts),
        frames=tuple(records),
        warnings=(*source.warnings, *warnings),
        jitter=max(part.value for part in meter) if len(records) > 2 else None,
    )


def _make_repairer(
    run: Run, source: Source, rests: list[Rest], bodies: list[Body]
) -> tuple[FrameRepairer, list[int | None]]:
    """Build the solver and the counter, once for all frames; count the rests' own intersections."""
    from dtrepair.counts import SceneCounter
    from dtrepair.repair.repairer import SceneRepairer

    rest_counts: list[int | None] = []
    for mesh, rest in zip(source.meshes, rests, strict=True):
        counter = SceneCounter([rest.points], [mesh.faces], device=run.device)
        rest_counts.append(counter([rest.points]).total.triangles)
    scene = SceneRepairer(bodies, options=run.options, device=run.device)
    counter = make_counter(source, mode=run.options.mode, device=run.device)
    return (
        FrameRepairer(source, scene, counter, jobs=run.jobs, alone=run.alone),
        rest_counts,
    )


def _rest_warnings(source: Source, rests: list[Rest], counts: list[int | None]) -> Iterator[str]:
    for mesh, rest, count in zip(source.meshes, rests, counts, strict=True):
        # A mesh file, or points at the default time only, is its own rest pose: nothing to say.
        own = len(source.times) == 1 and mesh.has_rest
        if count and not own:
            yield (
                f"{mesh.path}: the rest pose ({rest.origin}) has {count} intersecting triangles; "
                "name a better one with --rest"
            )


def _store(repaired: Repaired, sink: Sink, meters: list[JitterMeter]) -> None:
    for index, points in enumerate(repaired.points):
        sink.put(index, repaired.frame.time, points)
    pairs = zip(meters, repaired.frame.spaces, repaired.spaces, strict=False)
    for meter, before, after in pairs:
        meter.add(before, after)


def _say(console: Console, repaired: Repaired) -> None:
    record = repaired.record
    label = f"frame {time_label(record.time)}"
    if repaired.error is not None and console.verbosity > 1:
        import traceback

        console.remark("".join(traceback.format_exception(repaired.error)))
    if record.before is None or record.after is None:
        console.warn([f"{label}: {record.status}: {record.message}"])
        return
    console.remark(
        f"{label}: {record.before.triangles} -> {record.after.triangles} triangles, "
        f"{record.iterations} iterations, {record.seconds:.2f} s, {record.status}"
    )


def _print_plan(console: Console, source: Source, rests: list[Rest], output: str) -> None:
    """Print what a run would do."""
    rows = []
    for mesh, rest in zip(source.meshes, rests, strict=True):
        role = "collider" if mesh.collider else "repaired"
        rows.append([mesh.path, str(len(mesh.rest)), str(len(mesh.faces)), role, rest.origin])
    console.table(["mesh", "vertices", "triangles", "role", "rest pose"], rows)
    labels = [time_label(float(time)) for time in source.times]
    frames = labels[0] if len(labels) == 1 else f"{labels[0]} to {labels[-1]}"
    console.result(f"{len(labels)} frames ({frames}) would be written to {output}")


def _print_table(console: Console, records: tuple[FrameRecord, ...], output: str) -> None:
    """Print one row for each frame that was not clean from the start, and the totals."""
    rows = []
    for record in records:
        label = time_label(record.time)
        if record.before is None or record.after is None:
            rows.append([label, "", "", "", record.status])
        elif record.before.pairs:
            numbers = [str(record.before.triangles), str(record.after.triangles)]
            rows.append([label, *numbers, f"{record.displacement_max:.4f}", record.status])
    if rows:
        console.table(["frame", "before", "after", "largest move", "status"], rows)
    totals = summarize(records)
    console.result(
        f"{totals['clean']} of {totals['frames']} frames clean: "
        f"{totals['triangles_before']} -> {totals['triangles_after']} intersecting triangles"
    )
    advice = {r.message for r in records if r.status in ("improved", "unchanged") and r.message}
    for text in sorted(advice):
        console.result(f"advice: {text}")
    console.result(f"written: {output}")


def _exit_code(records: tuple[FrameRecord, ...]) -> int:
    if any(record.status == "failed" for record in records):
        return FRAMES
    left = any(record.after is not None and record.after.pairs for record in records)
    return REMAINING if left else CLEAN
