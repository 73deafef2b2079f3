"""How far round one part another one goes: a skirt round both legs, a sleeve round an arm.

Planes cut both parts. From the middle of each closed curve that a plane cuts out of the inner part
rays go out in the plane; a part that most of them meet is round the other one.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.geometry import FloatArray, IntArray, lengths, vector_areas


@dataclass(frozen=True, kw_only=True)
class WrappingOptions:
    """The planes and the rays.

    Args:
        levels: Planes of a direction, as fractions of the outer part's span along it.
        rays: From a middle, evenly spread.
        beyond: Hits nearer than this part of the mean radius of what is inside do not count.
        small: Curves shorter than this part of the longest one of a plane are left out.
    """

    levels: tuple[float, ...] = (0.1, 0.3, 0.5, 0.7, 0.9)
    rays: int = 48
    beyond: float = 0.5
    small: float = 0.1


class Wrapping(NamedTuple):
    """How far a part goes round another.

    Args:
        share: Of the rays that meet it, in the mean over the planes of the best direction, 0 to 1.
        side: The mean cosine's sign: 1 where its normals point away from what is inside, else -1.
    """

    share: float
    side: float


def wrapping(
    points: FloatArray,
    outer: IntArray,
    inner: IntArray,
    *,
    options: WrappingOptions = WrappingOptions(),
) -> Wrapping:
    """Return how far the triangles `outer` (F, 3) of a pose (V, 3) go round those of `inner`."""
    best = Wrapping(0.0, 1.0)
    own = points[np.unique(outer)]
    middle = own.mean(axis=0)
    along = np.linalg.svd(own - middle, full_matrices=False)[2]
    for direction in (*along, *_diagonals()):
        height = (points - middle) @ direction
        low, high = height[outer].min(), height[outer].max()
        planes = [
            _in_plane(points, height - low - level * (high - low), outer, inner, direction, options)
            for level in options.levels
        ]
        share = float(np.mean([plane.share for plane in planes]))
        if share > best.share:
            side = float(sum(plane.side for plane in planes))
            best = Wrapping(share, 1.0 if side >= 0.0 else -1.0)
    return best


def _diagonals() -> FloatArray:
    """Return the thirteen directions (13, 3) to the neighbours of a cube, one of each opposite."""
    ways = np.array([way for way in product((-1, 0, 1), repeat=3) if way > (0, 0, 0)], float)
    return ways / lengths(ways)[:, None]


def _in_plane(
    points: FloatArray,
    height: FloatArray,
    outer: IntArray,
    inner: IntArray,
    direction: FloatArray,
    options: WrappingOptions,
) -> Wrapping:
    """Return the best share of the rays in the plane of height 0, and how much faces outwards."""
    inside, around = _cut(points, height, inner), _cut(points, height, outer)
    best = Wrapping(0.0, 0.0)
    if not len(inside.ends) or not len(around.ends):
        return best
    first = np.linalg.svd(direction[None])[2][1]
    axes = np.stack([first, np.cross(direction, first)], axis=1)
    spans = lengths(inside.ends[:, 1] - inside.ends[:, 0])
    curve = inside.curves()
    sizes = np.bincount(curve, spans)
    normal = vector_areas(points, around.faces) @ axes
    for index in np.flatnonzero(sizes >= options.small * sizes.max()):
        own = curve == index
        halfway = inside.ends[own].mean(axis=1)
        middle = np.average(halfway, axis=0, weights=spans[own] + 1e-300)
        radius = float(lengths(halfway - middle).mean())
        ends = (around.ends - middle) @ axes
        hit, ways = _hits(ends, options.beyond * radius, options.rays)
        share = float(hit.any(axis=1).mean())
        if share > best.share:
            best = Wrapping(share, float(np.sign(np.where(hit, ways @ normal.T, 0.0)).sum()))
    return best


class _Curves(NamedTuple):
    """Segments (S, 2, 3) in a plane, the mesh edges (S, 2) of their ends, and triangles (S, 3)."""

    ends: FloatArray
    edges: NDArray[np.int64]
    faces: IntArray

    def curves(self) -> NDArray[np.int32]:
        """Return the curve (S,) that each segment is part of."""
        place = np.unique(self.edges, return_inverse=True)[1].reshape(-1, 2)
        count = int(place.max()) + 1
        links = sparse.coo_matrix((np.ones(len(place)), place.T), (count, count))
        label: NDArray[np.int32] = csgraph.connected_components(links, directed=False)[1]
        _, curve = np.unique(label[place[:, 0]], return_inverse=True)
        return curve.reshape(-1).astype(np.int32)


def _cut(points: FloatArray, height: FloatArray, faces: IntArray) -> _Curves:
    """Return where triangles (F, 3) cross the plane at which vertices have the height (V,) 0."""
    above = height[faces] > 0.0
    faces = faces[above.any(axis=1) & ~above.all(axis=1)]
    above = height[faces] > 0.0
    # The corner that is alone on its side, and its way to the two others.
    alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), above.argmin(axis=1))
    rows = np.arange(len(faces))
    tip = faces[rows, alone]
    ends, edges = [], []
    for step in (1, 2):
        other = faces[rows, (alone + step) % 3]
        way = height[tip] / (height[tip] - height[other])
        ends.append(points[tip] + way[:, None] * (points[other] - points[tip]))
        low, high = np.minimum(tip, other).astype(np.int64), np.maximum(tip, other)
        edges.append(low * len(points) + high)
    return _Curves(np.stack(ends, axis=1), np.stack(edges, axis=1), faces)


def _hits(ends: FloatArray, beyond: float, rays: int) -> tuple[NDArray[np.bool_], FloatArray]:
    """Return which rays meet which segments (S, 2, 2) farther than `beyond` away, (R, S).

    And the directions (R, 2) of the rays, which start at the origin.
    """
    angle = 2.0 * np.pi * np.arange(rays) / rays
    ways = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    across = np.stack([-ways[:, 1], ways[:, 0]], axis=1)
    left = np.einsum("rd,sed->res", across, ends)
    far = np.einsum("rd,sed->res", ways, ends)
    gap = left[:, 0] - left[:, 1]
    distance = far[:, 0] + left[:, 0] / np.where(gap == 0.0, 1.0, gap) * (far[:, 1] - far[:, 0])
    hit: NDArray[np.bool_] = ((left[:, 0] > 0.0) != (left[:, 1] > 0.0)) & (distance > beyond)
    return hit, ways
