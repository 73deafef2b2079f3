"""What the page of a report shows beside its numbers: contacts, pictures, measures of frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.display.closeups import CloseupOptions, contact_view, draw_closeups
from dtrepair.display.colours import Colours
from dtrepair.display.contact_events import ContactEvent, contact_events
from dtrepair.display.render import Image, View, png_bytes
from dtrepair.pipeline.observer import SILENT, Observer, Progress
from dtrepair.pipeline.page.clip import PosedClip
from dtrepair.pipeline.page.contact_data import DataOptions, contact_data
from dtrepair.pipeline.page.measures import frame_measures
from dtrepair.pipeline.page.posed_run import PosedRun
from dtrepair.report.page.content import Contact, PageContent


@dataclass(frozen=True, kw_only=True)
class PageOptions:
    """What a page shows.

    Args:
        contacts: So many contacts have a picture and can be looked at in space.
        listed: So many are told in all.
        frames: So many frames are looked at for contacts, at most.
        bytes: So long the data of all contacts may be.
        data: How contacts are kept.
        closeup: How contacts are drawn.
    """

    contacts: int = 6
    listed: int = 60
    frames: int = 150
    bytes: int = 2_800_000
    data: DataOptions = field(default_factory=DataOptions)
    closeup: CloseupOptions = field(default_factory=CloseupOptions)


def gather_content(
    report: Mapping[str, Any],
    run: PosedRun,
    *,
    options: PageOptions = PageOptions(),
    observer: Observer = SILENT,
) -> PageContent:
    """Return what the page of a report shows beside its numbers. Raises PipelineError."""
    clip = PosedClip(report, run)
    events = find_events(clip, options=options, observer=observer)
    shown, others = events[: options.contacts], events[options.contacts : options.listed]
    with Progress(observer, "drawing contacts", len(shown)) as progress:
        contacts = tuple(
            _contact(clip, event, options.bytes // max(len(shown), 1), options)
            for event in progress.over(shown)
        )
    return PageContent(
        contacts=(*contacts, *(listed_event(clip, event) for event in others)),
        measures=frame_measures(run, len(report["frames"])),
        colours=_colours(len(run.first.source.meshes)),
    )


def find_events(
    clip: PosedClip, *, options: PageOptions = PageOptions(), observer: Observer = SILENT
) -> list[ContactEvent]:
    """Return the contact events of a clip, the worst first."""
    looked = clip.looked_at(options.frames)
    with Progress(observer, "looking at contacts", len(looked)) as progress:
        pairs = {index: clip.pairs(index) for index in progress.over(looked)}
    return contact_events(pairs, clip.run.first.faces)


def draw_event(
    clip: PosedClip, event: ContactEvent, options: CloseupOptions = CloseupOptions()
) -> tuple[Image, View]:
    """Return the picture of an event in its worst frame, and the view that it is seen in."""
    scene, poses = clip.run.first, clip.poses(event.worst)
    up = scene.source.up
    view = contact_view(poses, scene.faces, worst_triangles(event), up=up, options=options)
    image = draw_closeups(poses, scene.faces, view, objects=scene.objects, up=up, options=options)
    return image, view


def worst_triangles(event: ContactEvent) -> NDArray[np.int64]:
    """Return the triangles (K,) of an event in its worst frame, before or after."""
    both = [own.get(event.worst, ()) for own in (event.before, event.after)]
    return np.union1d(*both).astype(np.int64)


def _colours(count: int) -> list[tuple[float, float, float]]:
    """The colours of so many objects, as pictures have them."""
    return [(red, green, blue) for red, green, blue in Colours().of(np.arange(count)).tolist()]


def listed_event(clip: PosedClip, event: ContactEvent) -> Contact:
    """Return a contact without a picture."""
    run, worst = clip.run, event.worst
    met = _objects(event, clip, run.first.objects)
    paths = [mesh.path for mesh in run.first.source.meshes]
    after = event.count(worst, "after") if len(run.scenes) > 1 else None
    numbers = [run.numbers[index] for index in (event.frames[0], event.frames[-1], worst)]
    return Contact(
        first=paths[met[0][0]],
        second=paths[met[0][1]],
        others=len(met) - 1,
        frames=(numbers[0], numbers[1], numbers[2]),
        triangles=(event.count(worst, "before"), after),
    )


def _contact(clip: PosedClip, event: ContactEvent, limit: int, options: PageOptions) -> Contact:
    """Return a contact with its picture, and what the viewer shows of it."""
    image, view = draw_event(clip, event, options.closeup)
    triangles = worst_triangles(event)
    data = contact_data(clip, event, triangles, view, limit=limit, options=options.data)
    return replace(listed_event(clip, event), png=png_bytes(image), view=data)


def _objects(
    event: ContactEvent, clip: PosedClip, objects: NDArray[np.integer]
) -> list[tuple[int, int]]:
    """Numbers of the objects that meet in an event in its worst frame, the most pairs first."""
    pairs = clip.pairs(event.worst)
    every = np.concatenate([pairs.before, pairs.after])
    met = np.sort(objects[every[np.isin(every[:, 0], worst_triangles(event))]], axis=1)
    found, count = np.unique(met, axis=0, return_counts=True)
    return [(int(i), int(j)) for i, j in found[np.argsort(-count, kind="stable")]]
