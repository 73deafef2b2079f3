"""A contact as data for the viewer of a page: an excerpt of the mesh in the frames around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.display.closeups import Posed
from dtrepair.display.contact_events import ContactEvent
from dtrepair.display.excerpt import Excerpt, ExcerptOptions, make_excerpt
from dtrepair.display.packing import differences, packed
from dtrepair.display.render import View
from dtrepair.pipeline.page.clip import PosedClip

Triangles = NDArray[np.integer]


@dataclass(frozen=True, kw_only=True)
class DataOptions:
    """How a contact is kept.

    Args:
        around: So many frames before and after the worst one.
        beyond: So many of them beyond the first and the last frame of the contact.
        excerpt: How the mesh is thinned out.
        smaller: Factor on both where the data is too long.
        steps: Half the extent is so many steps: what two bytes hold.
    """

    around: int = 8
    beyond: int = 2
    excerpt: ExcerptOptions = field(default_factory=ExcerptOptions)
    smaller: float = 0.7
    steps: int = 32000


def contact_data(
    clip: PosedClip,
    event: ContactEvent,
    triangles: Triangles,
    view: View,
    *,
    limit: int,
    options: DataOptions = DataOptions(),
) -> dict[str, Any]:
    """Return JSON values that the viewer shows, with at most about `limit` characters of data.

    triangles: those of the contact (K,) in its worst frame. view: what to look at first.
    """
    while True:
        found = _data(clip, event, triangles, view, options)
        if len(found["data"]) <= limit or options.around == 0:
            return found
        excerpt = options.excerpt
        options = replace(
            options,
            around=int(options.smaller * options.around),
            excerpt=replace(excerpt, triangles=int(options.smaller * excerpt.triangles)),
        )


def _data(
    clip: PosedClip, event: ContactEvent, triangles: Triangles, view: View, options: DataOptions
) -> dict[str, Any]:
    run, worst = clip.run, event.worst
    low = max(0, worst - options.around, event.frames[0] - options.beyond)
    high = min(len(run.times) - 1, worst + options.around, event.frames[-1] + options.beyond)
    frames = range(low, high + 1)
    clips = [clip.poses(index) for index in frames]
    faces = run.first.faces
    place = [own for each in (event.before, event.after) for k, own in each.items() if k in frames]
    at_worst = clips[worst - low][0].points
    near = np.unique(np.concatenate(place))
    excerpt = make_excerpt(at_worst, faces, near, options=options.excerpt)
    corners = np.unique(faces[triangles])
    centres = np.stack([poses[0].points[corners].mean(axis=0) for poses in clips])
    shown = np.stack(
        [
            [pose.points[excerpt.vertices] - centre for pose in poses]
            for poses, centre in zip(clips, centres, strict=True)
        ]
    )
    step = float(np.abs(shown).max()) / options.steps or 1.0
    kind = np.uint16 if len(excerpt.vertices) < 65536 else np.uint32
    arrays: dict[str, NDArray[Any]] = {
        "faces": excerpt.faces.astype(kind),
        "objects": run.first.objects[excerpt.triangles].astype(np.uint16),
        "first": differences(shown[:, 0], step),
    }
    if shown.shape[1] > 1:
        arrays["moved"] = differences(_moved(shown, step), step)
    for number, name in enumerate(("red", "red_after")[: shown.shape[1]]):
        arrays |= _red(name, [poses[number] for poses in clips], excerpt)
    rotation = view.rotation
    return {
        **packed(arrays),
        "names": list(run.scenes),
        "frames": [run.numbers[index] for index in frames],
        "worst": worst - low,
        "vertices": len(excerpt.vertices),
        "step": step,
        "size": float(np.linalg.norm(np.ptp(at_worst, axis=0))),
        "rotation": rotation.tolist(),
        "target": (rotation.T @ view.centre - centres[worst - low]).tolist(),
        "half": view.half_size,
        "whole": len(excerpt.faces) == len(faces),
    }


def _moved(shown: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Displacements between poses as they are rounded: where nothing moved they are nothing."""
    rounded = np.round(shown / step) * step
    moved: NDArray[np.float64] = rounded[:, 1] - rounded[:, 0]
    return moved


def _red(name: str, poses: Sequence[Posed], excerpt: Excerpt) -> dict[str, NDArray[Any]]:
    """Intersecting triangles of the excerpt, frame after frame, and how many each frame has."""
    hits = [np.flatnonzero(pose.red[excerpt.triangles]) for pose in poses]
    return {
        name: np.concatenate(hits).astype(np.uint32),
        f"{name}_counts": np.array([len(hit) for hit in hits], dtype=np.uint32),
    }
