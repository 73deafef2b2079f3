"""Ends that another part hides: a wrist that ends inside its sleeve, trousers under a shirt.

Such parts need not touch to belong together. Where nothing holds them, a sleeve that is pushed off
a body slides off the hand that came out of it. Ends with a border are tied by themselves; closed
ones, which touch their sleeve in a few places, are held there all around.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.attachments import NO_TIES, Ties, distances, joined_ties, ties_to
from dtrepair.numerics.closest_point import NearestTriangles
from dtrepair.numerics.enclosure import enclosure
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    border_edges,
    components,
    dots,
    lengths,
    triangle_areas,
    unique_edges,
)


@dataclass(frozen=True, kw_only=True)
class HiddenEndOptions:
    """What counts as an end that is hidden in another part.

    Args:
        enclosed: Least winding number of the hiding part around every vertex of the end.
        near: The hiding part is within this many rms radii of the end, everywhere; ...
        far: ... or within so many, and follows it in a clip: the hand in a wide sleeve, ...
        follows: ... so that no distance changes by more than this many radii in it, ...
        least: ... in so many other poses at least.
        hiding: So many open parts, the largest, are asked what they hide.
        cells: Along the extent of the hiding part: a sleeve is much narrower than its coat.
    """

    enclosed: float = 0.6
    near: float = 0.5
    far: float = 2.5
    follows: float = 1.0
    least: int = 2
    hiding: int = 24
    cells: int = 64


def hidden_ends(
    points: FloatArray,
    faces: IntArray,
    part_of: IntArray,
    bound: NDArray[np.integer],
    *,
    poses: Sequence[FloatArray] = (),
    options: HiddenEndOptions = HiddenEndOptions(),
) -> Ties:
    """Tie the ends of open parts to what hides them in a pose.

    Args:
        points: The pose (V, 3).
        faces: Triangles (F, 3), whose vertices at one position of the rest are one.
        part_of: The connected part (F,) of each triangle.
        bound: What binds each triangle (F,): of parts of two bindings nothing is known; -1: none.
        poses: Poses (V, 3) of a clip; where there is none nothing is known to follow.
        options: Numbers.
    """
    ends = _ends(faces, len(points))
    part_of_end = np.array([part_of[own.triangle] for own in ends], dtype=np.int64)
    bound_of_end = np.array([bound[own.triangle] for own in ends], dtype=np.int64)
    boxes = np.array(
        [[points[own.vertices].min(axis=0), points[own.vertices].max(axis=0)] for own in ends]
    ).reshape(-1, 2, 3)
    areas = np.bincount(part_of, triangle_areas(points, faces))
    large = np.unique(part_of_end)
    large = large[np.argsort(-areas[large], kind="stable")][: options.hiding]
    found = [NO_TIES]
    for part in large.tolist():
        triangles = np.flatnonzero(part_of == part)
        same = (bound_of_end == bound[triangles[0]]) & (bound_of_end >= 0) & (part_of_end != part)
        corners = points[faces[triangles]]
        same &= (boxes[:, 0] >= corners.min(axis=(0, 1))).all(axis=1)
        same &= (boxes[:, 1] <= corners.max(axis=(0, 1))).all(axis=1)
        if same.any():
            within = [ends[k].vertices for k in np.flatnonzero(same)]
            hidden = _hidden_in(points, corners, triangles, within, options)
            found += [
                ties
                for ties, radius in hidden
                if _belongs(ties, radius, points, faces, poses, options)
            ]
    return joined_ties(found)


def closed_ends(
    points: FloatArray,
    faces: IntArray,
    inner: IntArray,
    away: FloatArray,
    *,
    options: HiddenEndOptions = HiddenEndOptions(),
) -> NDArray[np.bool_]:
    """Return which vertices (N,) of one part, behind an open one, are of an end that this hides.

    A stub that goes into a sleeve has one rim and no hole; a thigh under a skirt goes on below.

    Args:
        points: Positions (V, 3).
        faces: Triangles (F, 3) of the part.
        inner: Its vertices (N,) behind the other one.
        away: Their distances (N,) from that: of an end it is within `near` radii.
        options: Numbers.
    """
    place = np.full(len(points), -1, dtype=np.int64)
    place[inner] = np.arange(len(inner))
    within = place[faces[(place[faces] >= 0).all(axis=1)]].astype(np.int32)
    label = components(within, len(inner))
    result = np.zeros(len(inner), dtype=bool)
    for end in np.unique(label[within]):
        own, triangles = np.flatnonzero(label == end), within[label[within[:, 0]] == end]
        if len(own) - len(unique_edges(triangles)) + len(triangles) == 1:
            result[own] = away[own] <= options.near * _radius(points[inner[own]])
    return result


def _radius(points: FloatArray) -> float:
    """Return the rms distance of points (N, 3) from the axis along which they lie."""
    centred = points - points.mean(axis=0)
    return float(np.sqrt(np.linalg.eigvalsh(centred.T @ centred / len(points))[:2].sum()))


@dataclass(frozen=True)
class _End:
    """The vertices (N,) of one border, and a triangle at it."""

    vertices: IntArray
    triangle: int


def _ends(faces: IntArray, count: int) -> list[_End]:
    """Return the borders of a mesh."""
    lone = border_edges(faces, count)
    border = faces.ravel()[lone]
    shape = (count, count)
    graph = sparse.coo_matrix((np.ones(len(border)), (border[:, 0], border[:, 1])), shape=shape)
    label = csgraph.connected_components(graph, directed=False)[1][border[:, 0]]
    order = np.argsort(label, kind="stable")
    starts = np.flatnonzero(np.diff(label[order], prepend=-1))
    groups = np.split(order, starts[1:]) if len(order) else []
    return [_End(np.unique(border[own]), int(lone[own[0], 0] // 3)) for own in groups]


def _hidden_in(
    points: FloatArray,
    corners: FloatArray,
    triangles: NDArray[np.integer],
    ends: list[IntArray],
    options: HiddenEndOptions,
) -> Iterator[tuple[Ties, float]]:
    """Yield the ties and the rms radius of each end that triangles (T,) go round.

    corners: those (T, 3, 3) of the triangles.
    """
    around = np.abs(enclosure(points[np.concatenate(ends)], corners, options.cells))
    starts = np.cumsum([0, *(len(own) for own in ends)])
    nearest = NearestTriangles(corners)
    for own, start, stop in zip(ends, starts[:-1], starts[1:], strict=True):
        if around[start:stop].min() > options.enclosed:
            centred = points[own] - points[own].mean(axis=0)
            radius = float(np.sqrt(dots(centred, centred).mean()))
            yield ties_to(nearest, triangles, points, own), radius


def _belongs(
    ties: Ties,
    radius: float,
    points: FloatArray,
    faces: IntArray,
    poses: Sequence[FloatArray],
    options: HiddenEndOptions,
) -> bool:
    """Return whether an end of a radius is near to what hides it, or follows it in all poses.

    points: the pose (V, 3) that shows it; those in which the end is at the same place tell nothing.
    """
    away = lengths(ties.offsets)
    if away.max() <= options.near * radius:
        return True
    others = [p for p in poses if not np.array_equal(p[ties.vertices], points[ties.vertices])]
    if away.max() > options.far * radius or len(others) < options.least:
        return False
    off = [np.abs(distances(ties, pose, faces) - away).max() for pose in others]
    return bool(max(off) <= options.follows * radius)
