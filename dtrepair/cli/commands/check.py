"""`dtrepair check`: count intersecting triangles, per prim and frame."""

from __future__ import annotations

import time as clock
from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

from dtrepair import __version__
from dtrepair.cli.options.shared import (
    IGNORE,
    console_options,
    jobs_option,
    run_options,
    selection_options,
)
from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.failures import one_line_errors
from dtrepair.pipeline.errors import CLEAN, FRAMES, REMAINING
from dtrepair.pipeline.repair.records import contact_records
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.devices import use_device
from dtrepair.pipeline.stages.enclosed_parts import EnclosedParts, enclosed_lines
from dtrepair.pipeline.stages.frames import (
    Frame,
    frame_time,
    make_counter,
    mode_warnings,
    prim_records,
    read_frames,
    refuse_if_none_usable,
    side_by_side,
    unusable,
)
from dtrepair.pipeline.stages.matching import ignored_pairs
from dtrepair.pipeline.stages.outputs import check_writable, refuse_overwriting, writing
from dtrepair.pipeline.stages.sources import Source, open_source, time_label
from dtrepair.report.record import (
    FramePrimRecord,
    FrameRecord,
    Report,
    render_report,
    write_report,
)
from dtrepair.wording import counted

if TYPE_CHECKING:
    from dtrepair.intersect.scene_counts import SceneCounter


@click.command(
    "check",
    epilog="Exit code 0: nothing intersects; 1: something does; 3: input unusable; "
    "4: some frames are unusable.",
)
@click.argument("source_path", metavar="STAGE|MESH")
@click.option("--json", "json_path", metavar="F|-", help="Write a JSON report; - is stdout.")
@IGNORE
@click.option(
    "--mode",
    type=click.Choice(["self", "inter", "both"]),
    default="both",
    show_default=True,
    help="Pairs within a mesh, between meshes, or both.",
)
@selection_options
@run_options
@jobs_option
@console_options
@one_line_errors
def command(
    *,
    source_path: str,
    json_path: str | None,
    mode: str,
    ignore: tuple[str, ...],
    selection: Selection,
    device: str,
    jobs: int,
    console: Console,
) -> int:
    """Count the intersecting triangles of a USD stage or a mesh file.

    Exact, in float32 coordinates: pairs of triangles that share no vertex (vertices at one position
    count as one) and have a common point; touching counts. One mesh is counted in its own space,
    several together in world space. What lies wholly inside something closed intersects nothing; it
    is told, and does not change the exit code.

    \b
    Example:
        dtrepair check shot.usd --prim "/Hero//" --frames 1:100x10
        dtrepair check body.obj --json -
    """
    start = clock.perf_counter()
    if json_path is not None and json_path != "-":
        refuse_overwriting(json_path, source_path)
        check_writable(json_path)
    device = use_device(device)
    source = open_source(source_path, selection)
    console.warn([*source.warnings, *mode_warnings(source, mode)])
    opened = clock.perf_counter()
    ignored = ignored_pairs(source, ignore)
    counter = make_counter(source, mode=mode, ignored=ignored, device=device)
    enclosed = EnclosedParts(source, mode=mode, ignored=ignored)
    found = _records(source, counter, enclosed, jobs)
    records = tuple(console.progress(found, total=len(source.times), what="checking"))
    refuse_if_none_usable(source, records)
    end = clock.perf_counter()
    report = Report(
        command="check",
        version=__version__,
        input=source_path,
        device=device,
        settings={"mode": mode, "ignore": list(ignore), **vars(selection)},
        seconds={"total": end - start, "read": opened - start, "detect": end - opened},
        prims=prim_records(source),
        frames=records,
        warnings=source.warnings,
    )
    if json_path == "-":
        click.echo(render_report(report), nl=False)
    else:
        _print(console, source, records)
    if json_path is not None and json_path != "-":
        with writing(json_path):
            write_report(report, json_path)
    if any(record.status == "failed" for record in records):
        return FRAMES
    return REMAINING if any(record.before and record.before.pairs for record in records) else CLEAN


def _records(
    source: Source, counter: SceneCounter, enclosed: EnclosedParts, jobs: int
) -> Iterator[FrameRecord]:
    def count(frame: Frame) -> FrameRecord:
        if not frame.usable:
            return unusable(frame)
        start = clock.perf_counter()
        found = counter(frame.spaces)
        each = zip(source.meshes, found.each, strict=True)
        return FrameRecord(
            time=frame_time(frame),
            status="unchanged" if found.total.pairs else "clean",
            before=found.total,
            after=found.total,
            seconds=clock.perf_counter() - start,
            prims=tuple(FramePrimRecord(path=m.path, before=c, after=c) for m, c in each),
            contacts=contact_records(source, found, found),
            enclosed=enclosed(frame, found),
        )

    for _, record in side_by_side(count, read_frames(source, source.times), jobs=jobs):
        yield record


def _print(console: Console, source: Source, records: tuple[FrameRecord, ...]) -> None:
    """Print one row for each frame, and one for each mesh of it that intersects."""
    several = len(source.meshes) > 1
    header = ["frame", "triangles", "pairs", *(["between", "mesh"] if several else [])]
    rows = []
    for record in records:
        label = time_label(record.time)
        if record.before is None:
            rows.append([label, record.status, "", *(["", ""] if several else [])])
            console.warn([record.message])
            continue
        parts = [("all", record.before), *((p.path, p.before) for p in record.prims if p.before)]
        for path, count in parts if several else parts[:1]:
            if path == "all" or count.pairs:
                numbers = [str(count.triangles), str(count.pairs), str(count.inter_pairs)]
                rows.append([label, *numbers, path] if several else [label, *numbers[:2]])
    console.table(header, rows)
    for line in enclosed_lines(records):
        console.result(line)
    console.result(_conclusion(records))


def _conclusion(records: tuple[FrameRecord, ...]) -> str:
    counts = [record.before for record in records if record.before is not None]
    hit = sum(count.pairs > 0 for count in counts)
    triangles = sum(count.triangles for count in counts)
    pairs = sum(count.pairs for count in counts)
    failed = sum(record.status == "failed" for record in records)
    ending = f"; {counted(failed, 'frame')} could not be read" if failed else ""
    if not hit:
        return f"no intersections in {counted(len(counts), 'frame')}{ending}"
    verb = "intersects" if hit == 1 else "intersect"
    return (
        f"{hit} of {counted(len(counts), 'frame')} {verb}: {counted(triangles, 'triangle')}, "
        f"{counted(pairs, 'pair')}{ending}"
    )
