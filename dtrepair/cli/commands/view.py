"""`dtrepair view`: a window on a stage or mesh, or a picture without one."""

from __future__ import annotations

from collections.abc import Sequence

import click

from dtrepair.cli.exit_codes import exit_codes
from dtrepair.cli.options.file_names import FILE
from dtrepair.cli.options.sections import Command
from dtrepair.cli.options.settings import as_settings
from dtrepair.cli.options.shared import (
    ATTACH,
    DETACH,
    IGNORE,
    REST_CONTACTS,
    check_selection_options,
)
from dtrepair.cli.options.verbosity import console_options
from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.failures import one_line_errors
from dtrepair.cli.terminal.outputs import check_picture_name
from dtrepair.pipeline.check import checked_scene
from dtrepair.pipeline.check_settings import CheckSettings
from dtrepair.pipeline.errors import CLEAN, INPUT, OUTPUT, UsageError
from dtrepair.pipeline.stages.outputs import check_writable, refuse_overwriting, writing
from dtrepair.pipeline.stages.sources import is_stage, open_source, time_label
from dtrepair.pipeline.stages.world_mesh import WorldScene
from dtrepair.wording import counted, listed


@click.command("view", cls=Command, epilog=exit_codes(INPUT, OUTPUT, clean="shown, or written"))
@click.argument("source_path", type=FILE, metavar="STAGE|MESH")
@click.option(
    "--before", type=FILE, metavar="STAGE|MESH", help="The unrepaired input, shown beside it."
)
@click.option(
    "--screenshot", type=FILE, metavar="F.png", help="Write a picture and open no window."
)
@IGNORE
@ATTACH
@DETACH
@REST_CONTACTS
@as_settings(CheckSettings, check_selection_options)
@console_options
@one_line_errors
def command(
    *,
    source_path: str,
    before: str | None,
    screenshot: str | None,
    settings: CheckSettings,
    console: Console,
) -> int:
    """Look at a stage or mesh, its intersecting triangles in red, modelled contacts pale blue.

    It counts as check does: what was modelled as overlapping is told apart.

    The window needs polyscope (pip install 'dtrepair[view]'). It has a slider over the time codes,
    plays, goes to the next worst frame, lists what intersects, lays before and after over one
    another, and colours how far points moved. A screenshot shows the frame with most intersections
    among --frames; without polyscope or a display it is drawn without them.

    \b
    Example:
        dtrepair view shot_repaired.usdc --before shot.usd
        dtrepair view shot.usd --frames 17 --screenshot frame17.png
    """
    from dtrepair.display.viewer import has_display, has_polyscope

    if screenshot is not None:
        refuse_overwriting(screenshot, source_path, before)
        check_picture_name(screenshot)
        check_writable(screenshot)
    elif not has_polyscope():
        raise UsageError(
            "the window needs polyscope: pip install 'dtrepair[view]', or name a --screenshot"
        )
    elif not has_display():
        raise UsageError("no display to open a window on; name a --screenshot")
    scenes = []
    for path in (before, source_path):
        if path is not None:
            source = open_source(path, settings.selection)
            console.warn(source.warnings)
            scenes.append(checked_scene(source, settings))
    if before is not None:
        _refuse_strangers(before, source_path, *scenes)
    names = ["before", "after"] if before is not None else [source_path]
    window = screenshot is None or (has_polyscope() and has_display())
    if window and not _show(scenes, names, screenshot):
        if screenshot is None:
            raise UsageError("the display cannot open a window; name a --screenshot")
        window = False
    if screenshot is not None:
        if not window:
            _draw(scenes, names, screenshot)
        console.result(f"written: {screenshot}")
    return CLEAN


def _refuse_strangers(before: str, path: str, first: WorldScene, second: WorldScene) -> None:
    """Raise UsageError for two stages that have no mesh in common; mesh files have one each."""
    own, other = ([mesh.path for mesh in scene.source.meshes] for scene in (second, first))
    if is_stage(before) and is_stage(path) and set(own).isdisjoint(other):
        raise UsageError(
            f"--before {before}: has no mesh of {path}: expected {listed(own)}, got "
            f"{listed(other)}; name the input of that repair"
        )


def _show(scenes: Sequence[WorldScene], names: Sequence[str], screenshot: str | None) -> bool:
    """Open the window, or write what it would show; False where the display cannot."""
    from dtrepair.display.viewer import Frame, Viewed, Viewer

    times = scenes[0].source.times.tolist()

    def viewed(name: str, scene: WorldScene) -> Viewed:
        def frame(index: int) -> Frame:
            found = scene(times[index])
            return found.points, found.intersecting, found.modelled

        return Viewed(name, scene.faces, frame)

    meshes = [viewed(name, scene) for name, scene in zip(names, scenes, strict=True)]
    labels = [time_label(time) for time in times]

    def contacts(index: int) -> list[str]:
        met = scenes[0].meetings(times[index])
        return [
            f"{first} with {'itself' if first == second else second}: {counted(count, 'pair')}"
            for first, second, count in met
        ]

    first = scenes[0].worst() if screenshot is not None else 0
    try:
        viewer = Viewer(meshes, labels, up=scenes[0].source.up, first=first, contacts=contacts)
    except RuntimeError:
        return False
    if screenshot is None:
        viewer.show()
    else:
        with writing(screenshot):
            viewer.screenshot(screenshot)
    return True


def _draw(scenes: Sequence[WorldScene], names: Sequence[str], screenshot: str) -> None:
    """Draw the frame with most intersections side by side, from one view."""
    from dtrepair.display.render import best_view, render, save_pictures

    time = float(scenes[0].source.times[scenes[0].worst()])
    frames = [scene(time) for scene in scenes]
    first = frames[0]
    others = [frame.points for frame in frames[1:]]
    faces, up = scenes[0].faces, scenes[0].source.up
    view = best_view(first.points, faces, first.intersecting, up=up, others=others)
    images, captions = [], []
    for name, scene, frame in zip(names, scenes, frames, strict=True):
        image = render(
            frame.points,
            scene.faces,
            view=view,
            intersecting=frame.intersecting,
            modelled=frame.modelled,
            objects=scene.objects,
        )
        images.append(image)
        title = f"{name}, " if len(names) > 1 else ""
        captions.append(f"{title}frame {time_label(time)}: {_told(*frame.counts)}")
    try:
        with writing(screenshot):
            save_pictures(screenshot, images, captions=captions)
    except ImportError as error:
        raise UsageError(f"{screenshot}: {error}") from None


def _told(intersecting: int, modelled: int) -> str:
    """Return how many triangles intersect, and how many only as they were modelled, in words."""
    apart = f", {modelled} modelled" if modelled else ""
    return f"{intersecting or 'none'} intersecting{apart}"
