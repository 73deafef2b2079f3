"""One picture of a contact: close-ups before and after, and where on the whole it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtrepair.display.render import (
    Image,
    RenderOptions,
    View,
    make_view,
    render,
    visible,
)

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class CloseupOptions:
    """How a contact is shown.

    Args:
        size: Pixels of a close-up, each way.
        whole: Part of it that the picture of the whole takes, in a corner.
        margin: Half the width of a close-up, in radii of the contact.
        least: Half the width at least, of the diagonal: its surroundings tell what it is.
        azimuths: Directions that are looked from, degrees; the usual one first.
        elevations: How far from above, degrees.
        better: A direction must show so many times more than those before it.
    """

    size: int = 400
    whole: float = 0.3
    margin: float = 1.7
    least: float = 0.06
    azimuths: tuple[float, ...] = (25, -25, 60, -60, 0, 90, -90, 130, -130, 155, -155, 180)
    elevations: tuple[float, ...] = (12, 55, -35)
    better: float = 1.15


@dataclass(frozen=True)
class Posed:
    """A pose (V, 3), and which triangles (F,) of it are drawn red."""

    points: FloatArray
    red: NDArray[np.bool_]


def contact_view(
    poses: Sequence[Posed],
    faces: NDArray[np.int32],
    place: NDArray[np.integer],
    *,
    up: Sequence[float] = (0, 1, 0),
    options: CloseupOptions = CloseupOptions(),
) -> View:
    """Return the view that shows most of a contact, with all of it in all poses.

    place: the triangles (K,) of the contact.
    """
    around = np.concatenate([pose.points[np.unique(faces[place])] for pose in poses])
    middle = 0.5 * (around.min(axis=0) + around.max(axis=0))
    radius = float(np.linalg.norm(around - middle, axis=1).max())
    size = float(np.linalg.norm(np.ptp(poses[0].points, axis=0)))
    half = max(options.margin * radius, options.least * size) or 1.0
    shown = np.zeros(len(faces), dtype=bool)
    shown[place] = True
    best, most = None, -1.0
    for elevation in options.elevations:
        for azimuth in options.azimuths:
            turned = make_view([poses[0].points], up=up, azimuth=azimuth, elevation=elevation)
            view = View(turned.rotation, turned.rotation @ middle, half)
            triangle = visible(view, poses[0].points, faces, 96)[0]
            seen = float(shown[triangle[triangle >= 0]].sum())
            if best is None or seen > options.better * most:
                best, most = view, seen
    assert best is not None
    return best


def draw_closeups(
    poses: Sequence[Posed],
    faces: NDArray[np.int32],
    view: View,
    *,
    objects: NDArray[np.integer] | None = None,
    up: Sequence[float] = (0, 1, 0),
    options: CloseupOptions = CloseupOptions(),
    rendering: RenderOptions = RenderOptions(),
) -> Image:
    """Return close-ups of the poses side by side; the first has the whole in a corner.

    objects: number of the object (F,) of each triangle, which colours it.
    """
    images = [
        render(
            pose.points,
            faces,
            view=view,
            intersecting=pose.red,
            objects=objects,
            size=options.size,
            options=rendering,
        )
        for pose in poses
    ]
    small = round(options.whole * options.size)
    whole = make_view([pose.points for pose in poses], up=up, rotation=view.rotation)
    inset = render(
        poses[0].points,
        faces,
        view=whole,
        intersecting=poses[0].red,
        objects=objects,
        size=small,
        options=rendering,
    )
    _frame(inset, view, whole)
    _border(inset, 200)
    images[0][:small, :small] = inset
    return np.concatenate(images, axis=1)


def _frame(image: Image, view: View, whole: View) -> None:
    """Mark on a picture of the whole what a close-up shows."""
    size = len(image)
    scale = size / 2 / whole.half_size
    x, y = (view.centre - whole.centre)[:2] * (scale, -scale) + size / 2
    half = max(view.half_size * scale, 3.0)
    left, right = (int(np.clip(round(v), 0, size - 1)) for v in (x - half, x + half))
    top, bottom = (int(np.clip(round(v), 0, size - 1)) for v in (y - half, y + half))
    image[top : bottom + 1, [left, right]] = image[[top, bottom], left : right + 1] = 40


def _border(image: Image, grey: int) -> None:
    image[[0, -1]] = image[:, [0, -1]] = grey
