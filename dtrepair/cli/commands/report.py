"""`dtrepair report`: a JSON report as a self-contained HTML page."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import click

from dtrepair.cli.exit_codes import exit_codes
from dtrepair.cli.options.file_names import FILE
from dtrepair.cli.options.sections import Command
from dtrepair.cli.options.verbosity import console_options
from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.failures import one_line_errors
from dtrepair.pipeline.errors import CLEAN, INPUT, OUTPUT, InputError
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.matching import ignored_pairs
from dtrepair.pipeline.stages.outputs import check_writable, refuse_overwriting, writing
from dtrepair.pipeline.stages.sources import Source, open_source

if TYPE_CHECKING:
    from dtrepair.report.page import Picture


@click.command("report", cls=Command, epilog=exit_codes(INPUT, OUTPUT, clean="written"))
@click.argument("report_path", type=FILE, metavar="REPORT.json")
@click.option(
    "-o", "--output", type=FILE, metavar="OUT.html", required=True, help="The page to write."
)
@click.option(
    "--pictures",
    "count",
    type=click.IntRange(min=0),
    default=3,
    show_default=True,
    metavar="N",
    help="Frames to draw before and after, those with most intersections.",
)
@console_options
@one_line_errors
def command(*, report_path: str, output: str, count: int, console: Console) -> int:
    """Make an HTML page of a report: charts per frame, pictures before and after, a table.

    The page needs no network and no other file. Pictures need the input and the output of the run:
    where the report names them, or beside the report.

    \b
    Example:
        dtrepair repair shot.usd -o shot_repaired.usdc --report report.json
        dtrepair report report.json -o report.html
    """
    from dtrepair.files.atomic import write_atomically
    from dtrepair.report.page import make_page
    from dtrepair.report.record import read_report
    from dtrepair.report.schema import ReportError

    refuse_overwriting(output, report_path)
    check_writable(output)
    try:
        report = read_report(report_path)
    except ReportError as error:
        raise InputError(str(error)) from None
    except OSError as error:
        raise InputError(f"{report_path}: cannot be read: {error.strerror}") from None
    pictures: list[Picture] = []
    try:
        pictures.extend(_draw(_with_found_files(report, report_path), count))
    except Exception as error:  # a page without pictures is better than none
        console.warn([f"{output}: without pictures: {error}"])
    with writing(output):
        write_atomically(output, make_page(report, pictures))
    console.result(f"written: {output}")
    return CLEAN


def _with_found_files(report: Mapping[str, Any], report_path: str) -> dict[str, Any]:
    """The report with its input and output as they are found from here."""
    beside = os.path.dirname(report_path)

    def found(path: str) -> str:
        places = [report.get("folder", ""), "", beside]
        paths = [os.path.join(place, path) for place in places]
        paths.append(os.path.join(beside, os.path.basename(path)))
        return next((there for there in paths if os.path.exists(there)), path)

    files = {name: report[name] and found(report[name]) for name in ("input", "output")}
    return {**report, **files}


def _draw(report: Mapping[str, Any], count: int) -> Iterator[Picture]:
    """Draw the frames with most intersections, in world space, before and after."""
    from dtrepair.display.render import best_view, png_bytes, render
    from dtrepair.pipeline.stages.world_mesh import WorldScene
    from dtrepair.report.page import Picture

    chosen = _chosen(report, count)
    scenes: dict[str, WorldScene] = {}
    if chosen:
        mode = report["settings"].get("mode", "both")
        opened = _sources(report)
        for when, source in opened.items():
            ignored = ignored_pairs(source, report["settings"].get("ignore", ()))
            scenes[when] = WorldScene(source, mode=mode, ignored=ignored)
    for record in chosen:
        time = math.nan if record["time"] is None else record["time"]
        view = None
        for when, scene in scenes.items():
            frame = scene(time)
            up = scene.source.up
            view = view or best_view(frame.points, scene.faces, frame.intersecting, up=up)
            image = render(frame.points, scene.faces, view=view, intersecting=frame.intersecting)
            label = "" if record["time"] is None else f"frame {record['time']:.10g}, "
            caption = f"{label}{when}: {frame.triangles} intersecting triangles"
            yield Picture(caption, png_bytes(image))


def _chosen(report: Mapping[str, Any], count: int) -> list[Mapping[str, Any]]:
    """The frames to draw, in order: those with most intersections; of transfers any."""
    frames = [frame for frame in report["frames"] if frame["before"]]
    if "transfer" not in report:
        frames = [frame for frame in frames if frame["before"]["triangles"]]
    worst = sorted(frames, key=lambda frame: -frame["before"]["triangles"])[:count]
    return sorted(worst, key=lambda frame: frame["time"] or 0.0)


def _sources(report: Mapping[str, Any]) -> dict[str, Source]:
    """Input and output of a run; of a transfer only the output shows the mesh that was moved."""
    settings = report["settings"]
    if "transfer" in report:
        target = report["transfer"]["target"]
        selection = Selection(prim=target if target.startswith("/") else None)
        return {"transferred": open_source(report["output"], selection)}
    names = {field.name for field in fields(Selection)} - {"frames"}
    selection = Selection(**{k: v for k, v in settings.items() if k in names})
    # Offsets alone pose nothing: the output shows what the input does.
    after = None if settings.get("delta") else report["output"]
    paths = {"before": report["input"], "after": after}
    return {
        when: open_source(path, selection, collider=settings.get("collider"))
        for when, path in paths.items()
        if path
    }
