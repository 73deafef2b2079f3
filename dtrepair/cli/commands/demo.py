"""`dtrepair demo`: a self-intersecting character made in code, repaired and shown."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np

from dtrepair.cli.exit_codes import exit_codes
from dtrepair.cli.options.file_names import FILE
from dtrepair.cli.options.sections import Command
from dtrepair.cli.options.shared import run_options
from dtrepair.cli.options.verbosity import console_options
from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.console_observer import ConsoleObserver
from dtrepair.cli.terminal.failures import one_line_errors
from dtrepair.cli.terminal.interrupts import clean_up_if_forced
from dtrepair.cli.terminal.outputs import Reports, put_reports
from dtrepair.cli.terminal.repair_text import print_table, say
from dtrepair.pipeline.errors import ALONE, FRAMES, INPUT, OUTPUT, WORKERS, OutputError, exit_code
from dtrepair.pipeline.stages.devices import device_of_method
from dtrepair.pipeline.stages.outputs import writing

PRIM = "/Character/Body"


@click.command(
    "demo",
    cls=Command,
    epilog=exit_codes(
        INPUT,
        FRAMES,
        OUTPUT,
        ALONE,
        WORKERS,
        clean="every frame is clean",
        remaining="intersections remain",
    ),
)
@click.argument("directory", type=FILE, metavar="[DIR]", default="demo_out")
@click.option(
    "--frames",
    "frame_count",
    type=click.IntRange(3, 240),
    default=24,
    show_default=True,
    metavar="N",
    help="Length of the clip.",
)
@run_options
@console_options
@one_line_errors
def command(*, directory: str, frame_count: int, device: str, console: Console) -> int:
    """Make an animated character whose limbs pass through its body, and repair it.

    Writes DIR/demo.usda, DIR/demo_repaired.usdc, DIR/report.json and DIR/before_after.png.

    \b
    Example:
        dtrepair demo
        dtrepair demo /tmp/look
    """
    device_of_method(device, "full")  # refused before anything is written
    folder = Path(directory)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error.strerror}") from None
    source, output = folder / "demo.usda", folder / "demo_repaired.usdc"
    quads = _write_character(source, frame_count)
    console.result(f"{source}: {quads} quads, {frame_count} frames")
    code = _repair(source, output, folder / "report.json", device, console)
    picture = folder / "before_after.png"
    try:
        with writing(picture):
            _draw(source, output, picture)
    except ImportError as error:
        console.warn([f"{picture}: not drawn: {error}"])
    else:
        console.result(f"written: {picture}")
    return code


def _write_character(path: Path, frame_count: int) -> int:
    """Write the character as a stage; return its number of quads."""
    from dtrepair.demo.character import make_character
    from usd_io import AuthoredMesh, write_animation

    character = make_character(frame_count)
    mesh = AuthoredMesh(
        path=PRIM,
        faces=character.quads,
        points=list(character.points),
        rest=character.rest,
        transforms=_turntable(frame_count),
    )
    write_animation(path, mesh, times=character.times, up="Y", meters_per_unit=1.0, fps=24.0)
    return len(character.quads)


def _turntable(frame_count: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Transforms (T, 4, 4) of the character's Xform, row vectors: it turns and steps forward."""
    matrices = np.tile(np.eye(4), (frame_count, 1, 1))
    progress = np.linspace(0.0, 1.0, frame_count)
    angle = np.radians(40.0) * progress
    matrices[:, 0, 0] = matrices[:, 2, 2] = np.cos(angle)
    matrices[:, 0, 2], matrices[:, 2, 0] = -np.sin(angle), np.sin(angle)
    matrices[:, 3, 2] = 0.5 * progress
    return matrices


def _repair(source: Path, output: Path, report_path: Path, device: str, console: Console) -> int:
    """Repair as `dtrepair repair` does, with its table."""
    from dtrepair.pipeline.repair.stage import repair_stage

    clean_up_if_forced(str(output))
    observer = ConsoleObserver(console, say)
    report = repair_stage(str(source), str(output), device=device, observer=observer)
    put_reports(report, Reports((str(report_path),)))
    print_table(console, report.frames, str(output))
    return exit_code(report)


def _draw(source: Path, output: Path, picture: Path) -> None:
    """Draw the frame with most intersections, and a close view, before and after."""
    import usd_io
    from dtrepair.display.render import best_view, render, save_pictures
    from dtrepair.intersect.scene_counts import SceneCounter

    before = usd_io.read_meshes(usd_io.open_stage(source), prim=PRIM).meshes[0]
    after = usd_io.read_meshes(usd_io.open_stage(output), prim=PRIM).meshes[0]
    counter = SceneCounter([before.rest], [before.faces])
    points = usd_io.read_points(before, before.times)
    worst = max(range(len(points)), key=lambda k: counter([points[k]]).total.triangles)
    repaired = usd_io.read_points(after, before.times[worst : worst + 1])[0]
    marked = counter([points[worst]]).intersecting[0]
    view = best_view(points[worst], before.faces, marked, others=[repaired])
    images, captions = [], []
    for name, pose in (("before", points[worst]), ("after", repaired)):
        count = counter([pose])
        images.append(render(pose, before.faces, view=view, intersecting=count.intersecting[0]))
        captions.append(f"{name}: {count.total.triangles} intersecting triangles")
    save_pictures(picture, images, captions=captions)
