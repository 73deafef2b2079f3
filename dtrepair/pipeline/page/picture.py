"""Write one picture of a run: its worst contacts, before and after."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dtrepair.display.closeups import CloseupOptions
from dtrepair.display.contact_events import ContactEvent
from dtrepair.display.render import Image, make_view, render, save_pictures
from dtrepair.pipeline.errors import Cancelled, OutputError
from dtrepair.pipeline.observer import SILENT, Observer, Progress, warn
from dtrepair.pipeline.page.clip import PosedClip
from dtrepair.pipeline.page.gather import draw_event, find_events, listed_event
from dtrepair.pipeline.page.posed_run import PosedRun, open_run, with_found_files
from dtrepair.pipeline.stages.outputs import FilePath, writing
from dtrepair.pipeline.stages.sources import time_label
from dtrepair.report.record import Report


@dataclass(frozen=True, kw_only=True)
class PictureOptions:
    """What a picture of a run shows.

    Args:
        contacts: So many of the worst contacts, one below the other.
        closeup: How each is drawn.
    """

    contacts: int = 3
    closeup: CloseupOptions = field(default_factory=lambda: CloseupOptions(size=480))


def write_picture(
    report: Report,
    path: FilePath,
    *,
    options: PictureOptions = PictureOptions(),
    observer: Observer = SILENT,
) -> None:
    """Write a picture of the worst contacts of a run: png or jpg, whole or not at all.

    Where nothing intersects it shows the frame that was moved most. What cannot be looked at is not
    drawn, and the observer hears why.

    Raises:
        OutputError: The picture cannot be written.
    """
    document = report.document()
    try:
        run = open_run(with_found_files(document))
        rows = _rows(document, run, options, observer)
        with writing(path):
            captions = [caption for _, caption in rows]
            save_pictures(path, [image for image, _ in rows], captions=captions, columns=1)
    except (Cancelled, OutputError):
        raise
    except Exception as error:  # the run itself went well
        warn(observer, [f"{os.fspath(path)}: not drawn: {error}"])


def _rows(
    document: Mapping[str, Any], run: PosedRun, options: PictureOptions, observer: Observer
) -> list[tuple[Image, str]]:
    clip = PosedClip(document, run)
    events = find_events(clip, observer=observer)[: options.contacts]
    if not events:
        return [_calm(document, run, options.closeup.size)]
    with Progress(observer, "drawing contacts", len(events)) as progress:
        return [
            (draw_event(clip, event, options.closeup)[0], _caption(clip, event))
            for event in progress.over(events)
        ]


def _caption(clip: PosedClip, event: ContactEvent) -> str:
    found = listed_event(clip, event)
    before, after = found.triangles
    count = f"{before}" if after is None else f"{before} before, {after} after"
    time = float(clip.run.times[event.worst])
    return f"frame {time_label(time)}, intersecting triangles: {count}: {found.between}"


def _calm(document: Mapping[str, Any], run: PosedRun, size: int) -> tuple[Image, str]:
    """The frame that was moved most, as a whole in every pose, from one view."""
    moves = [document["frames"][number]["displacement_max"] for number in run.numbers]
    time = float(run.times[int(np.argmax(moves))])
    poses = [scene.points(time) for scene in run.scenes.values()]
    view = make_view(poses, up=run.first.source.up)
    faces, objects = run.first.faces, run.first.objects
    images = [render(pose, faces, view=view, objects=objects, size=size) for pose in poses]
    names = f", {', '.join(run.scenes)}" if len(images) > 1 else ""  # of a check there is one
    return np.concatenate(images, axis=1), f"frame {time_label(time)}{names}: no intersections"
