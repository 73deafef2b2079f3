"""`dtrepair report`: a JSON report as a self-contained HTML page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from dtrepair.cli.console import Console
from dtrepair.cli.failures import (
    CLEAN,
    INPUT,
    Failure,
    check_writable,
    one_line_errors,
    refuse_overwriting,
    writing,
)
from dtrepair.cli.options import Selection, console_options

if TYPE_CHECKING:
    from dtrepair.report_page import Picture


@click.command("report")
@click.argument("report_path", metavar="REPORT.json")
@click.option("-o", "--output", metavar="OUT.html", required=True, help="The page to write.")
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

    The page needs no network and no other file. Pictures need the input and the output of the run
    where the report names them.

    \b
    Example:
        dtrepair repair shot.usd -o shot_repaired.usdc --report report.json
        dtrepair report report.json -o report.html
    """
    from dtrepair.atomic_files import write_atomically
    from dtrepair.record import ReportError, read_report
    from dtrepair.report_page import make_page

    refuse_overwriting(output, report_path)
    check_writable(output)
    try:
        report = read_report(report_path)
    except ReportError as error:
        raise Failure(str(error), INPUT) from None
    except OSError as error:
        raise Failure(f"{report_path}: cannot be read: {error.strerror}", INPUT) from None
    pictures: list[Picture] = []
    try:
        pictures.extend(_draw(report, count))
    except Exception as error:  # a page without pictures is better than none
        console.warn([f"{output}: without pictures: {error}"])
    with writing(output):
        write_atomically(output, make_page(report, pictures))
    console.result(f"written: {output}")
    return CLEAN


def _draw(report: Mapping[str, Any], count: int) -> Iterator[Picture]:
    """Draw the frames with most intersections, in world space, before and after."""
    from dtrepair.cli.frames import make_counter, read_frame
    from dtrepair.cli.sources import open_source
    from dtrepair.pictures import best_view, png_bytes, render
    from dtrepair.report_page import Picture

    frames = [f for f in report["frames"] if f["before"] and f["before"]["triangles"]]
    frames = sorted(frames, key=lambda f: -f["before"]["triangles"])[:count]
    if not frames:
        return
    settings = report["settings"]
    names = {field.name for field in fields(Selection)} - {"frames"}
    selection = Selection(**{k: v for k, v in settings.items() if k in names})
    paths = {"before": report["input"], "after": report["output"]}
    sources = {
        when: open_source(path, selection, collider=settings.get("collider"))
        for when, path in paths.items()
        if path
    }
    mode = settings.get("mode", "both")
    counters = {w: make_counter(s, mode=mode, device="cpu") for w, s in sources.items()}
    for record in sorted(frames, key=lambda f: f["time"] or 0.0):
        time = math.nan if record["time"] is None else record["time"]
        view = None
        for when, source in sources.items():
            frame = read_frame(source, time)
            found = counters[when](frame.spaces)
            placed = zip(source.meshes, frame.points, strict=True)
            points = [source.to_world(mesh, time, part) for mesh, part in placed]
            starts = np.cumsum([0, *(len(part) for part in points)])
            meshes = zip(source.meshes, starts, strict=False)
            faces = np.concatenate([mesh.faces + start for mesh, start in meshes]).astype(np.int32)
            scene, mask = np.concatenate(points), np.concatenate(found.intersecting)
            view = view or best_view(scene, faces, mask, up=source.up)
            image = render(scene, faces, view=view, intersecting=mask)
            label = "" if record["time"] is None else f"frame {record['time']:.10g}, "
            caption = f"{label}{when}: {found.total.triangles} intersecting triangles"
            yield Picture(caption, png_bytes(image))
