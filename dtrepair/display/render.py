"""Before/after pictures without a display or a GPU: a small software renderer.

Triangles are lit, intersecting ones red, back faces (an open or inside-out surface) blue. The
renderer needs numpy only; Pillow, which writes the file and the captions, is loaded when used.
"""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dtrepair.display.colours import Colours
from dtrepair.files.atomic import atomic_output
from dtrepair.files.polygon_mesh import vertex_normals

Image = NDArray[np.uint8]


@dataclass(frozen=True, kw_only=True)
class RenderOptions:
    """How pictures are drawn.

    Args:
        colours: Of the meshes.
        samples: For each pixel and direction, against stairs.
        chunk: Candidate pixels looked at together, which bounds the memory.
    """

    colours: Colours = field(default_factory=Colours)
    samples: int = 2
    chunk: int = 2_000_000


@dataclass(frozen=True)
class View:
    """A parallel projection: rotation (3, 3) to right, up and viewer; centre (3,); half size."""

    rotation: NDArray[np.float64]
    centre: NDArray[np.float64]
    half_size: float


def make_view(
    poses: Sequence[ArrayLike],
    *,
    up: ArrayLike = (0, 1, 0),
    azimuth: float = 25.0,
    elevation: float = 12.0,
    rotation: NDArray[np.float64] | None = None,
) -> View:
    """Return a view that shows all `poses` (each (V, 3)); angles in degrees, from the front.

    The front is +Z where Y is up and -Y where Z is up. A `rotation` (3, 3) replaces the angles.
    """
    points = np.concatenate([np.asarray(pose, dtype=np.float64) for pose in poses])
    if rotation is None:
        rotation = _turned(up, azimuth, elevation)
    seen = points @ rotation.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    size = float(max(high[0] - low[0], high[1] - low[1]))
    return View(rotation, (low + high) / 2, 0.53 * size if size > 0 else 1.0)


def _turned(up: ArrayLike, azimuth: float, elevation: float) -> NDArray[np.float64]:
    upward = np.asarray(up, dtype=np.float64)
    front = np.array([0.0, 0, 1]) if abs(upward[2]) < 0.5 else np.array([0.0, -1, 0])
    right = np.cross(upward, front)
    a, e = np.radians(azimuth), np.radians(elevation)
    sideways = np.cos(a) * right - np.sin(a) * front
    level = np.sin(a) * right + np.cos(a) * front
    towards = np.cos(e) * level + np.sin(e) * upward
    return np.stack([sideways, np.cross(towards, sideways), towards])


def best_view(
    points: ArrayLike,
    faces: NDArray[np.int32],
    intersecting: NDArray[np.bool_],
    *,
    up: ArrayLike = (0, 1, 0),
    others: Sequence[ArrayLike] = (),
) -> View:
    """Return the one of twelve views around the object that shows most of the intersections.

    others: more poses that the view has to show whole.
    """
    best, most = make_view([points, *others], up=up), 0
    for azimuth in (25, -25, 60, -60, 0, 90, -90, 130, -130, 155, -155, 180):
        view = make_view([points, *others], up=up, azimuth=azimuth)
        triangle = visible(view, np.asarray(points, dtype=np.float64), faces, 96)[0]
        shown = int(intersecting[triangle[triangle >= 0]].sum())
        if shown > 1.15 * most:  # later views must be clearly better than the usual one
            best, most = view, shown
    return best


def render(
    points: ArrayLike,
    faces: NDArray[np.int32],
    *,
    view: View,
    intersecting: NDArray[np.bool_] | None = None,
    modelled: NDArray[np.bool_] | None = None,
    objects: NDArray[np.integer] | None = None,
    size: int = 640,
    options: RenderOptions = RenderOptions(),
) -> Image:
    """Draw a mesh (V, 3), (F, 3); return (size, size, 3) uint8.

    intersecting: which triangles (F,) are red. modelled: which are pale blue, as their contacts
    were modelled. objects: the number (F,) of the object of each, which gives it a colour.
    """
    positions = np.asarray(points, dtype=np.float64)
    colours, samples = options.colours, options.samples
    fine = size * samples
    triangle, weights = visible(view, positions, faces, fine, chunk=options.chunk)
    hit = triangle >= 0
    chosen = triangle[hit]
    corners = vertex_normals(positions, faces) @ view.rotation.T
    normal = np.einsum("pk,pkd->pd", weights[hit], corners[faces[chosen]])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    flat = _facing(view, positions, faces)[chosen]
    surface = np.asarray(colours.surface if objects is None else colours.of(objects[chosen]))
    colour = np.where((flat > 0)[:, None], surface, colours.back)
    for mask, own in ((modelled, colours.modelled), (intersecting, colours.intersecting)):
        if mask is not None:
            colour = np.where(np.asarray(mask, bool)[chosen, None], own, colour)
    picture = np.tile(np.asarray(colours.background, dtype=np.float64), (fine * fine, 1))
    picture[hit] = colour * _light(normal * np.where(flat > 0, 1, -1)[:, None])[:, None]
    blocks = picture.reshape(size, samples, size, samples, 3).mean(axis=(1, 3))
    return np.asarray(np.clip(blocks * 255 + 0.5, 0, 255), dtype=np.uint8)


def _light(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the brightness (P,) from a key light, a weak one from the other side, and the sky."""
    key = np.clip(normal @ np.array([-0.42, 0.57, 0.70]), 0, None)
    fill = np.clip(normal @ np.array([0.80, 0.05, 0.60]), 0, None)
    sky = 0.5 + 0.5 * normal[:, 1]
    return np.asarray(0.24 + 0.62 * key + 0.18 * fill + 0.14 * sky)


def _facing(
    view: View, points: NDArray[np.float64], faces: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Return twice the signed area (F,) in the picture: positive where the outside is seen."""
    a, b, c = ((points @ view.rotation.T)[faces[:, k]] for k in range(3))
    return np.asarray(
        (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0], dtype=np.float64
    )


def visible(
    view: View,
    points: NDArray[np.float64],
    faces: NDArray[np.int32],
    size: int,
    *,
    chunk: int = RenderOptions.chunk,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the nearest triangle (size^2,) of each pixel, -1 for none, and its weights (., 3)."""
    seen = points @ view.rotation.T - view.centre
    pixels = seen / view.half_size * (size / 2) * (1, -1, 1) + (size / 2, size / 2, 0)
    corners = pixels[faces]
    low, high = (
        np.clip(np.floor(ends[..., :2]), 0, size).astype(np.int64)
        for ends in (corners.min(axis=1), corners.max(axis=1) + 1)
    )
    width, height = (high - low).T
    nearest = np.full(size * size, -np.inf)
    triangle = np.full(size * size, -1, dtype=np.int64)
    weights = np.zeros((size * size, 3))
    drawn = np.flatnonzero((width > 0) & (height > 0))
    parts = np.cumsum((width * height)[drawn]) // chunk
    for part in np.split(drawn, np.flatnonzero(np.diff(parts)) + 1):
        row, pixel, bary = _fragments(corners[part], low[part, 1], height[part], size)
        depth = np.einsum("pk,pk->p", bary, corners[part][row][:, :, 2])
        front = depth > nearest[pixel]
        row, pixel, bary, depth = row[front], pixel[front], bary[front], depth[front]
        order = np.argsort(depth, kind="stable")  # the nearest is written last
        row, pixel, bary, depth = row[order], pixel[order], bary[order], depth[order]
        nearest[pixel], triangle[pixel], weights[pixel] = depth, part[row], bary
    return triangle, weights


def _fragments(
    corners: NDArray[np.float64], low: NDArray[np.int64], height: NDArray[np.int64], size: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Return row, pixel and barycentric weights of each pixel centre inside a triangle.

    low, height: the first line of pixels (N,) of each triangle, and how many it touches.
    """
    row, y = _spread(height)
    y += low[row]
    middle = (y + 0.5)[:, None]
    start, end = corners[row], corners[row][:, [1, 2, 0]]
    # Where each edge crosses the line: all candidates lie between the crossings.
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (middle - start[..., 1]) / (end[..., 1] - start[..., 1])
        cross = start[..., 0] + along * (end[..., 0] - start[..., 0])
    cross[~((along >= 0) & (along <= 1))] = np.nan
    met = ~np.isnan(cross).all(axis=1)
    row, y, cross = row[met], y[met], cross[met]
    first = np.clip(np.floor(np.nanmin(cross, axis=1) - 0.5), 0, size).astype(np.int64)
    last = np.clip(np.ceil(np.nanmax(cross, axis=1) + 0.5), 0, size).astype(np.int64)
    line, x = _spread(np.maximum(last - first, 0))
    row, y, x = row[line], y[line], x + first[line]
    (ax, ay), (bx, by), (cx, cy) = (corners[row, k, :2].T for k in range(3))
    px, py = x + 0.5, y + 0.5
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    safe = np.where(area == 0, 1, area)
    u = ((bx - px) * (cy - py) - (by - py) * (cx - px)) / safe
    v = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) / safe
    inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (area != 0)
    u, v = u[inside], v[inside]
    return row[inside], (y * size + x)[inside], np.stack([u, v, 1 - u - v], axis=1)


def _spread(counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return for counts (N,) the numbers 0, 0, 0, 1, 1, ... and how often each was there before."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)


def png_bytes(image: Image) -> bytes:
    """Return an image (H, W, 3) as a PNG file. Raises ImportError where Pillow is missing."""
    images, _, _ = _pillow()
    buffer = io.BytesIO()
    images.fromarray(image).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def _pillow() -> tuple[Any, Any, Any]:
    try:
        from PIL import Image as Images
        from PIL import ImageDraw, ImageFont
    except ImportError:
        raise ImportError("pictures need Pillow: pip install pillow") from None
    return Images, ImageDraw, ImageFont


def _fitting(caption: str, size: float, width: float, fonts: Any) -> Any:
    """Return a font of a size, or of a smaller one in which a caption is no wider."""
    while size > 5 and fonts.load_default(size=size).getlength(caption) > width:
        size *= 0.9
    return fonts.load_default(size=size)


def save_pictures(
    path: str | os.PathLike[str],
    images: Sequence[Image],
    *,
    captions: Sequence[str] = (),
    columns: int | None = None,
    colours: Colours = Colours(),
) -> None:
    """Write pictures of one size side by side as one file (png, jpg), each with a caption below.

    Raises ImportError with the cure where Pillow is not installed, OSError.
    """
    images_of, draw_on, fonts = _pillow()
    height, width = images[0].shape[:2]
    columns = columns or len(images)
    rows = -(-len(images) // columns)
    band = max(min(width, height) // 13, 26) if captions else 0
    background = tuple(round(255 * value) for value in colours.background)
    sheet = images_of.new("RGB", (columns * width, rows * (height + band)), background)
    pen = draw_on.Draw(sheet)
    for index, image in enumerate(images):
        x, y = index % columns * width, index // columns * (height + band)
        sheet.paste(images_of.fromarray(image), (x, y))
        if index < len(captions):
            place = (x + width // 2, y + height + band // 2)
            font = _fitting(captions[index], 0.55 * band, 0.96 * width, fonts)
            pen.text(place, captions[index], fill=(60, 60, 64), font=font, anchor="mm")
    with atomic_output(path) as temporary:
        sheet.save(temporary)
