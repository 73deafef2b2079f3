"""`dtrepair repair`: repair every selected frame, write a layer over the input or a mesh file."""

from __future__ import annotations

import time as clock
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import click

from dtrepair import __version__
from dtrepair.cli.bodies import in_units_of_frames, make_bodies, read_controls
from dtrepair.cli.chunks import Chunk, choose_chunk, parse_chunk
from dtrepair.cli.console import Console
from dtrepair.cli.failures import (
    CLEAN,
    FRAMES,
    REMAINING,
    USAGE,
    Failure,
    check_writable,
    one_line_errors,
    refuse_overwriting,
    use_device,
    writing,
)
from dtrepair.cli.frames import make_counter, prim_records, read_frames
from dtrepair.cli.interrupts import current_interrupts
from dtrepair.cli.journal import Journal, hash_of_run
from dtrepair.cli.method import method_options
from dtrepair.cli.options import (
    Selection,
    console_options,
    jobs_option,
    run_options,
    selection_options,
)
from dtrepair.cli.repair_output import print_plan, print_table, rest_warnings, say
from dtrepair.cli.rest import Rest, choose_rests
from dtrepair.cli.sinks import Sink, existing, open_sink
from dtrepair.cli.solve import FrameRepairer, Repaired, repair_frames
from dtrepair.cli.sources import Source, open_source
from dtrepair.jitter_meter import JitterMeter
from dtrepair.record import FrameRecord, Report, summarize, write_report

if TYPE_CHECKING:
    from dtrepair.repair.bodies import Body
    from dtrepair.repair.options import RepairOptions
    from dtrepair.repair.remember import Memory


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
@click.option(
    "--direction", metavar="NAME|SUBSET=x,y,z", help="Preferred direction of the repair, in world."
)
@click.option("--report", "report_path", metavar="F.json", help="Write a JSON report.")
@click.option("--resume", is_flag=True, help="Go on with an interrupted run of the same command.")
@click.option("--skip-existing", is_flag=True, help="Do nothing if OUT is there already.")
@click.option("--dry-run", is_flag=True, help="Say what would be done, and write nothing.")
@click.option(
    "--chunk",
    metavar="K/N",
    help="Part K of N of the frames, for a farm; `join` gives what one run would have given.",
)
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
    direction: str | None,
    report_path: str | None,
    resume: bool,
    skip_existing: bool,
    dry_run: bool,
    chunk: str | None,
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
    part = parse_chunk(chunk)
    # The published method knows single poses only.
    alone = alone or options.method == "paper"
    run = Run(source_path, output, use_device(device), options, jobs, alone)
    source = open_source(source_path, selection, collider=collider)
    console.warn(source.warnings)
    more = {"rest": rest, "collider": collider, "pin": pin, "direction": direction}
    run.settings = settings_of(selection, options, more)
    _refuse_together(source, run, direction)
    controls = read_controls(source, pin, direction)
    sink = open_sink(source, output, run.settings)
    try:
        run.lap("read")
        rests = choose_rests(source, rest, device=run.device)
        if dry_run:
            print_plan(console, source, rests, output)
            return CLEAN
        bodies = make_bodies(source, rests, controls)
        run.chunk = choose_chunk(source, part, alone=alone)
        journal = _open_journal(run, bodies, resume=resume)
        console.warn(journal.warnings if journal is not None else ())
        report = _repair(run, source, rests, bodies, sink, console, journal)
    finally:
        sink.abort()
    if report_path is not None:
        with writing(report_path):
            write_report(report, report_path)
    print_table(console, report.frames, output)
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
    chunk: Chunk | None = None
    settings: dict[str, Any] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    start: float = field(default_factory=clock.perf_counter)
    last: float = field(default_factory=clock.perf_counter)

    def lap(self, name: str) -> None:
        """Give the time since the last lap to a part."""
        now = clock.perf_counter()
        self.seconds[name] = self.seconds.get(name, 0.0) + now - self.last
        self.last = now


def _refuse_together(source: Source, run: Run, direction: str | None) -> None:
    """Refuse options that the repair of frames together does not have."""
    given = {
        "--direction": direction is not None,
        "--clearance": run.options.clearance > 0.0,
        "--maximum-displacement": run.options.maximum_displacement is not None,
    }
    for option, used in given.items():
        if used and run.options.method == "paper":
            raise Failure(f"{option}: has no effect with --method paper; leave it out", USAGE)
        if used and len(source.times) > 1 and not run.alone:
            raise Failure(f"{option}: works frame by frame only; add --alone", USAGE)


def settings_of(
    selection: Selection, options: RepairOptions, more: dict[str, Any]
) -> dict[str, Any]:
    """Return what is recorded of the choices of a run."""
    chosen = {**vars(selection), **asdict(options), **more}
    return {name: value for name, value in chosen.items() if value is not None}


def _open_journal(run: Run, bodies: list[Body], *, resume: bool) -> Journal | None:
    """The journal of a run; None where a run is a single step, solved wholly or not at all."""
    from dtrepair.repair.animation import WINDOW

    assert run.chunk is not None
    times = run.chunk.times
    run_hash = hash_of_run(run.settings, run.device, bodies, times)
    journal = Journal(run.output, run_hash, resume=resume)
    if len(times) <= (1 if run.alone else WINDOW):
        return None
    interrupts = current_interrupts()
    if interrupts is not None:
        interrupts.advice = lambda: "; --resume goes on from here" if journal.kept else ""
    return journal


def _repair(
    run: Run,
    source: Source,
    rests: list[Rest],
    bodies: list[Body],
    sink: Sink,
    console: Console,
    journal: Journal | None,
) -> Report:
    """Repair all frames into the sink, commit it, and return the report."""
    repairer, rest_counts = make_repairer(run, source, rests, bodies, journal)
    run.lap("factor")
    console.warn(rest_warnings(source, rests, rest_counts))
    records: list[FrameRecord] = []
    meter = [JitterMeter() for _ in source.meshes]
    assert run.chunk is not None
    times = run.chunk.times
    frames = zip(
        repair_frames(read_frames(source, times), repairer), run.chunk.written, strict=True
    )
    for repaired, written in console.progress(frames, total=len(times), what="repairing"):
        if not written:
            continue
        _store(repaired, sink, meter)
        records.append(repaired.record)
        for name, value in repaired.seconds.items():
            run.seconds[name] = run.seconds.get(name, 0.0) + value
        say(console, repaired)
    run.last = clock.perf_counter()
    summary = summarize(records)
    warnings = (*repairer.warnings, *sink.commit({"counts": summary}))
    if journal is not None:
        warnings = (*warnings, *journal.failures)
        journal.remove()
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


def make_repairer(
    run: Run,
    source: Source,
    rests: list[Rest],
    bodies: list[Body],
    memory: Memory | None = None,
) -> tuple[FrameRepairer, list[int | None]]:
    """Build the solver and the counter, once for all frames; count the rests' own intersections."""
    from dtrepair.counts import SceneCounter
    from dtrepair.repair.repairer import SceneRepairer

    rest_counts: list[int | None] = []
    for mesh, rest in zip(source.meshes, rests, strict=True):
        counter = SceneCounter([rest.points], [mesh.faces], device=run.device)
        rest_counts.append(counter([rest.points]).total.triangles)
    options = in_units_of_frames(source, run.options)
    scene = SceneRepairer(bodies, options=options, device=run.device)
    counter = make_counter(source, mode=run.options.mode, device=run.device)
    return (
        FrameRepairer(source, scene, counter, jobs=run.jobs, alone=run.alone, memory=memory),
        rest_counts,
    )


def _store(repaired: Repaired, sink: Sink, meters: list[JitterMeter]) -> None:
    for index, points in enumerate(repaired.points):
        sink.put(index, repaired.frame.time, points)
    pairs = zip(meters, repaired.frame.spaces, repaired.spaces, strict=False)
    for meter, before, after in pairs:
        meter.add(before, after)


def _exit_code(records: tuple[FrameRecord, ...]) -> int:
    if any(record.status == "failed" for record in records):
        return FRAMES
    left = any(record.after is not None and record.after.pairs for record in records)
    return REMAINING if left else CLEAN
