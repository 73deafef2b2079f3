"""Whether one body is worn: goes round another, as a bracelet an arm or a skirt two legs.

A linking number of closed bodies is always zero. So slices of both through the wearer's middle are
looked at: what share of the directions from the wearer's section meets the other body outside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray


@dataclass(frozen=True, kw_only=True)
class WornOptions:
    """How a body is sliced, and from when on it is worn.

    Args:
        directions: In-plane rays from the middle of a section.
        levels: Where the span of the worn body is sliced, as shares of it.
        outside: A ray counts where it meets the worn body beyond this share of the wearer.
        worn: Mean share of the rays from which on a body is worn.
        kept: It is still worn while that share is not below this part of what it was.
        near, larger: A body is fitted to another of so many times its area, where half of its
            vertices are no farther from the other's than this share of its own diagonal, and ...
        close: ... this share of the other's: a staff beside a body is not.
        beside: Only what lies by this share of its length beside a body can be surrounded by it.
    """

    directions: int = 48
    levels: tuple[float, ...] = (0.1, 0.3, 0.5, 0.7, 0.9)
    outside: float = 0.5
    worn: float = 0.7
    kept: float = 0.6
    beside: float = 0.5
    near: float = 0.25
    larger: float = 10.0
    close: float = 0.05


DEFAULTS = WornOptions()
# Thirteen directions, one of each pair of opposite ones of a cube's faces, edges and corners.
_CUBE = tuple(way for way in product((-1.0, 0.0, 1.0), repeat=3) if way > (0.0, 0.0, 0.0))


class Solid(NamedTuple):
    """Points (V, 3) of a pose, triangles (F, 3) of one body, and whether that is closed."""

    points: FloatArray
    faces: IntArray
    closed: bool

    def alone(self, chosen: NDArray[np.bool_] | None = None) -> Solid:
        """Return the same, or some of its triangles (F,), without points of other bodies."""
        faces = self.faces if chosen is None else self.faces[chosen]
        used, place = np.unique(faces, return_inverse=True)
        return Solid(self.points[used], place.reshape(faces.shape).astype(np.int32), self.closed)


class Worn(NamedTuple):
    """How much one body goes round another, 0 to 1, and along which axis (3,)."""

    share: float
    axis: FloatArray


def worn_measure(
    outer: Solid, inner: Solid, *, least: float = 0.0, options: WornOptions = DEFAULTS
) -> Worn:
    """The largest share over three principal axes of `outer` and thirteen fixed directions.

    least: smaller ones are not of interest, and may be told as zero.
    """
    own = outer.points[np.unique(outer.faces)]
    low, high = own.min(axis=0), own.max(axis=0)
    around = 0.5 * float(np.linalg.norm(high - low))
    corners = inner.points[inner.faces]
    near = (corners.max(axis=1) > low - around) & (corners.min(axis=1) < high + around)
    outer, close = outer.alone(), inner.alone(near.all(axis=1))
    if len(close.faces) == 0:
        return Worn(0.0, np.array([0.0, 0.0, 1.0]))
    fixed = np.array(_CUBE) / np.linalg.norm(_CUBE, axis=1, keepdims=True)
    axes = np.concatenate([_principal(own), fixed])
    shares = [_share_around(outer, close, axis, least, options) for axis in axes]
    best = int(np.argmax(shares))
    return Worn(shares[best], axes[best])


def share_around(
    outer: Solid, inner: Solid, axis: FloatArray, *, options: WornOptions = DEFAULTS
) -> float:
    """The share of directions, mean over slices across `axis`, in which `outer` is round `inner`.

    From the centre of the section of `inner`, or of either half of it (two legs), whichever is
    best. The start has to lie inside of `inner`, and outside of a closed `outer`.
    """
    return _share_around(outer.alone(), inner, axis, 0.0, options)


def surrounds(
    outer: Solid, inner: Solid, *, least: float = 0.0, options: WornOptions = DEFAULTS
) -> Worn:
    """How much one body goes round all of another that is beside it: a robe, each of two legs.

    Like `worn_measure`, but sliced where both are, and along principal axes of both: a shoe that
    looks out of a hem is beside little of the robe. Zero where less than half of the length of
    `inner` is beside it. The first share that is not less than `least` is told; smaller ones may
    be told as less than they are.
    """
    outer, inner, count = outer.alone(), inner.alone(), len(options.levels)
    best = Worn(0.0, np.array([0.0, 0.0, 1.0]))
    for axis in np.concatenate([_principal(own.points) for own in (inner, outer)]):
        ring, limb = _upright(outer, axis), _upright(inner, axis)
        low = max(float(ring.heights.min()), float(limb.heights.min()))
        span = min(float(ring.heights.max()), float(limb.heights.max())) - low
        if span < options.beside * float(np.ptp(limb.heights)):
            continue
        share = 0.0
        for place, level in enumerate(options.levels):
            # The levels that follow add one at most, each.
            if (share + count - place) / count < max(least, best.share):
                break
            share += _share_at(ring, limb, low + level * span, options)
        if share / count > best.share:
            best = Worn(share / count, axis)
        if best.share >= least > 0.0:
            break
    return best


def _principal(points: FloatArray) -> FloatArray:
    """Return the principal axes (3, 3) of points (V, 3)."""
    return np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]


class _Upright(NamedTuple):
    """A body along an axis: heights (F, 3) of its corners, and where they lie across (F, 3, 2)."""

    heights: FloatArray
    flat: FloatArray
    closed: bool


def _upright(body: Solid, axis: FloatArray) -> _Upright:
    """Return a body along an axis (3,)."""
    across = np.cross(axis, [0.31, 0.77, -0.55])
    plane = np.stack([across / np.linalg.norm(across), np.zeros(3)])
    plane[1] = np.cross(axis, plane[0])
    heights, flat = (body.points @ axis)[body.faces], (body.points @ plane.T)[body.faces]
    return _Upright(heights, flat, body.closed)


def _share_around(
    outer: Solid, inner: Solid, axis: FloatArray, least: float, options: WornOptions
) -> float:
    """Do the work of `share_around` for a body alone; zero where it is less than `least`."""
    ring, limb = _upright(outer, axis), _upright(inner, axis)
    span = ring.heights
    levels = span.min() + np.array(options.levels) * np.ptp(span)
    shares: list[float] = []
    for level in levels:
        # The levels that follow add one at most, each.
        if sum(shares) + len(levels) - len(shares) < least * len(levels):
            return 0.0
        shares.append(_share_at(ring, limb, level, options))
    return float(np.mean(shares))


def _share_at(outer: _Upright, inner: _Upright, level: float, options: WornOptions) -> float:
    limb = _section(inner, level)
    if len(limb) < 3:
        return 0.0
    ring = _section(outer, level)
    if len(ring) < 3:
        return 0.0
    best = 0.0
    for start in _starts(ring, limb):
        reach, inside_ring = _polar(ring - start, options.directions)
        limb_reach, inside_limb = _polar(limb - start, options.directions)
        if inside_limb.mean() <= 0.5 or (outer.closed and inside_ring.mean() > 0.5):
            continue
        beyond = options.outside * np.where(np.isfinite(limb_reach), limb_reach, 0.0)
        best = max(best, float((np.isfinite(reach) & (reach > beyond)).mean()))
    return best


def _starts(ring: FloatArray, limb: FloatArray) -> list[FloatArray]:
    """The middle of the ring, and centres of what of the limb lies within it: one and two."""
    flat = ring.reshape(-1, 2)
    middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    starts = [middle]
    reach = np.linalg.norm(flat - middle, axis=1).max()
    centres = limb.mean(axis=1)
    centres = centres[np.linalg.norm(centres - middle, axis=1) < reach]
    if len(centres):
        mean = centres.mean(axis=0)
        starts.append(mean)
        along = np.linalg.svd(centres - mean, full_matrices=False)[2][0]
        side = (centres - mean) @ along > 0.0
        if side.any() and not side.all():
            starts += [centres[side].mean(axis=0), centres[~side].mean(axis=0)]
    return starts


def _section(body: _Upright, level: float) -> FloatArray:
    """Segments (K, 2, 2) in which the plane at a height cuts triangles."""
    up = body.heights > level
    corners_up = up.sum(axis=1)
    cut = (corners_up > 0) & (corners_up < 3)
    above, flat, up = body.heights[cut] - level, body.flat[cut], up[cut]
    if len(above) == 0:
        return np.zeros((0, 2, 2))
    # The corner that lies alone on its side: both edges of it are cut.
    alone = np.where(corners_up[cut] == 1, up.argmax(axis=1), (~up).argmax(axis=1))
    rows = np.arange(len(above))
    ends = []
    for step in (1, 2):
        other = (alone + step) % 3
        share = above[rows, alone] / (above[rows, alone] - above[rows, other])
        first, second = flat[rows, alone], flat[rows, other]
        ends.append(first + share[:, None] * (second - first))
    return np.stack(ends, axis=1)


def _polar(segments: FloatArray, directions: int) -> tuple[FloatArray, FloatArray]:
    """The nearest hit (N,) of rays from the origin, inf where none; whether they cross oddly."""
    angles = (np.arange(directions) + 0.5) * (2.0 * np.pi / directions)
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    start, edge = segments[:, 0], segments[:, 1] - segments[:, 0]
    turned = ways[:, :1] * edge[None, :, 1] - ways[:, 1:] * edge[None, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (start[:, 0] * edge[:, 1] - start[:, 1] * edge[:, 0])[None] / turned
        across = (start[None, :, 0] * ways[:, 1:] - start[None, :, 1] * ways[:, :1]) / turned
        hit = (along > 0.0) & (across >= 0.0) & (across <= 1.0)
    return np.where(hit, along, np.inf).min(axis=1), (hit.sum(axis=1) % 2 == 1)
