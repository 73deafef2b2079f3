"""Which of two connected parts lies outside the other: a sleeve over its arm, a belt round a waist.

The side on which one part lies of the other is read off poses in which the two do not meet. Of
each vertex the nearest vertex of the other part with a parallel normal is looked at; where most of
what is near lies on one side, that part is a layer over the other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    extent,
    lengths,
    triangle_areas,
    unique_edges,
    vector_areas,
)
from dtrepair.numerics.worn_measure import Solid, worn_measure

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class LayerOptions:
    """What counts as lying over something.

    Args:
        near: A part lies over what is nearer than this fraction of the smaller part's extent.
        neighbours: Vertices of the other part that are looked at.
        parallel: Least cosine between the normals of a vertex and of what it lies over.
        share: Least fraction of the area of either part that has something parallel nearby.
        clear: Least mean side: +1 where all of it lies outside, 0 where the parts take turns.
        worn: An open part is a layer over what it goes round by this share, see `worn_measure`.
        poses: How many poses tell at most.
    """

    near: float = 0.1
    neighbours: int = 12
    parallel: float = 0.3
    share: float = 0.3
    clear: float = 0.1
    worn: float = 0.7
    poses: int = 5


class WornLayer(NamedTuple):
    """A part that lies outside another one.

    Args:
        top: The outer part.
        under: The inner one.
        vertices: Vertices (N,) of the outer part that are held outside the inner one.
        sides: Of each (N,) 1 if its normal points away from the inner part, -1 if towards it.
        heights: How far each (N,) is from the inner part, length units.
    """

    top: int
    under: int
    vertices: IntArray
    sides: FloatArray
    heights: FloatArray


class Parts:
    """Connected parts of a mesh, and the poses in which they are looked at.

    Args:
        faces: Triangles (F, 3); duplicates along seams are one vertex.
        part: The part (V,) of each vertex, -1 for those without a triangle.
        closed: Which parts are closed surfaces.
        poses: Poses (V, 3), the rest first.
    """

    def __init__(
        self, faces: IntArray, part: IntArray, closed: BoolArray, poses: Sequence[FloatArray]
    ) -> None:
        self.faces, self.part, self.closed, self.poses = faces, part, closed, tuple(poses)
        order = np.argsort(part, kind="stable")
        starts = np.searchsorted(part[order], np.arange(len(closed) + 1))
        self.vertices = [order[a:b].astype(np.int32) for a, b in pairwise(starts)]
        of_face = part[faces[:, 0]]
        order = np.argsort(of_face, kind="stable")
        starts = np.searchsorted(of_face[order], np.arange(len(closed) + 1))
        self.triangles = [faces[order[a:b]] for a, b in pairwise(starts)]
        rest = self.poses[0]
        edges = unique_edges(faces)
        length = lengths(rest[edges[:, 0]] - rest[edges[:, 1]])
        # The longest edge at each vertex: between those of a coarse mesh the surface is nearer.
        self.spacing = np.zeros(len(rest))
        np.maximum.at(self.spacing, edges.ravel(), np.repeat(length, 2))
        self._normals: dict[tuple[int, int], FloatArray] = {}

    def normals(self, part: int, pose: int) -> FloatArray:
        """Return unit normals (n, 3) of the vertices of a part in a pose."""
        if (part, pose) not in self._normals:
            areas = vertex_normals(self.poses[pose], self.triangles[part], self.vertices[part])
            self._normals[part, pose] = areas
        return self._normals[part, pose]

    def area_shares(self, part: int) -> FloatArray:
        """Return the share (n,) of a part's area at rest that is around each of its vertices."""
        triangles, own = self.triangles[part], self.vertices[part]
        areas = np.repeat(triangle_areas(self.poses[0], triangles), 3)
        place = np.searchsorted(own, triangles.ravel())
        shares: FloatArray = np.bincount(place, areas, len(own)) / (areas.sum() or 1.0)
        return shares


def vertex_normals(points: FloatArray, triangles: IntArray, vertices: IntArray) -> FloatArray:
    """Return unit normals (n, 3) at vertices (n,), ascending, of triangles (F, 3) among them."""
    areas = np.repeat(vector_areas(points, triangles), 3, axis=0)
    place = np.searchsorted(vertices, triangles.ravel())
    summed = [np.bincount(place, areas[:, k], len(vertices)) for k in range(3)]
    normals: FloatArray = np.stack(summed, axis=1).astype(np.float64)
    length = lengths(normals)[:, None]
    return np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)


def find_layer(
    parts: Parts,
    first: int,
    second: int,
    poses: Sequence[int],
    *,
    options: LayerOptions = LayerOptions(),
) -> WornLayer | None:
    """Return which of two parts lies over the other by some of the poses; None where neither does.

    The first of the poses tells which vertices lie over what.
    """
    signed, covered, share = 0.0, 0.0, 0.0
    for pose in poses:
        for part, other, sign in ((first, second, 1.0), (second, first, -1.0)):
            found = _beside(parts, part, other, pose, options)
            parallel = found.known & (found.sides > 0)
            # By the share of each part's area: a small part is not outvoted by a large one.
            weights = parts.area_shares(part)
            own = float(weights[parallel].sum())
            signed += sign * float((weights * np.sign(found.heights))[parallel].sum())
            covered, share = covered + own, max(share, own)
    if share < options.share or abs(signed) <= options.clear * covered:
        return None
    top, under = (first, second) if signed > 0 else (second, first)
    found_layer = layer_over(parts, top, under, poses[0], options=options)
    return found_layer if len(found_layer.vertices) else None


def layer_over(
    parts: Parts, top: int, under: int, pose: int, *, options: LayerOptions = LayerOptions()
) -> WornLayer:
    """Return a layer of which is known that it lies over another part, whatever a pose shows.

    All vertices of an open layer are held outside: what hangs free may meet it later. Of a closed
    one those that are near in the pose, and outside if any is.
    """
    found = _beside(parts, top, under, pose, options)
    outside = found.known & (found.heights > 0)
    own = outside if outside.any() else found.known
    sides, heights = found.sides.copy(), np.where(outside, found.heights, np.inf)
    if not parts.closed[top] and own.any():
        weights = parts.area_shares(top)[own]
        sides[~own] = 1.0 if (weights * sides[own]).sum() >= 0.0 else -1.0
        own = np.ones(len(own), dtype=bool)
    return WornLayer(top, under, parts.vertices[top][own], sides[own], heights[own])


def find_worn(
    parts: Parts, first: int, second: int, pose: int, *, options: LayerOptions = LayerOptions()
) -> WornLayer | None:
    """Return the layer that an open part is which goes round the other, however far away it is."""
    points, best = parts.poses[pose], options.worn
    found: WornLayer | None = None
    for top, under in ((first, second), (second, first)):
        if parts.closed[top]:
            continue
        solids = (Solid(points, parts.triangles[k], bool(parts.closed[k])) for k in (top, under))
        worn = worn_measure(*solids)
        if worn.share >= best:
            own = parts.vertices[top]
            radial = points[own] - points[own].mean(axis=0)
            radial -= np.outer(radial @ worn.axis, worn.axis)
            outwards = np.einsum(
                "ij,ij,i->", parts.normals(top, pose), radial, parts.area_shares(top)
            )
            sides = np.full(len(own), 1.0 if outwards >= 0.0 else -1.0)
            best = worn.share
            found = WornLayer(top, under, own, sides, np.full(len(own), np.inf))
    return found


class _Beside(NamedTuple):
    """For vertices (n,) of a part: whether anything is beside them, on which side, how far away."""

    known: BoolArray
    sides: FloatArray
    heights: FloatArray


def _beside(parts: Parts, part: int, other: int, pose: int, options: LayerOptions) -> _Beside:
    points = parts.poses[pose]
    own, others = points[parts.vertices[part]], points[parts.vertices[other]]
    near = options.near * min(extent(own), extent(others))
    count = min(options.neighbours, len(others))
    distance, place = cKDTree(others).query(own, np.arange(1, count + 1))
    normals, other_normals = parts.normals(part, pose), parts.normals(other, pose)
    cosine = np.einsum("ij,ikj->ik", normals, other_normals[place])
    offset = own[:, None] - others[place]
    # Seen from the other part, whichever way the vertex itself faces.
    height = np.einsum("ikj,ikj->ik", other_normals[place], offset)
    spacing = parts.spacing[parts.vertices[other]]
    good = np.abs(cosine) > options.parallel
    good &= (distance <= near + spacing[place]) & (np.abs(height) < near)
    rows, column = np.arange(len(own)), np.argmax(good, axis=1)
    return _Beside(good[rows, column], np.sign(cosine[rows, column]), height[rows, column])


class Layers:
    """Which parts lie over which; looked at when asked for, and then known.

    Args:
        parts: The parts and the poses that tell.
        pairs: Of each pose the intersecting pairs (K, 2) of triangles.
        numbers: How far out each part lies, as the user says: of two the higher one is outside,
            whatever the poses tell; None, or two that are equal: the poses tell.
        attached: Which two parts are attached to each other: only numbers tell of these. An arm
            lies beside its body from the shoulder on, and is no layer of it.
        options: What counts as a layer.
    """

    def __init__(
        self,
        parts: Parts,
        pairs: Sequence[IntArray],
        *,
        numbers: IntArray | None = None,
        attached: Callable[[int, int], bool] = lambda first, second: False,
        options: LayerOptions = LayerOptions(),
    ) -> None:
        self.parts, self.options, self._attached = parts, options, attached
        self._numbers = np.zeros(len(parts.closed), dtype=np.int32) if numbers is None else numbers
        part_of_face = parts.part[parts.faces[:, 0]]
        self._met = [_counts(part_of_face[found]) for found in pairs]
        self._known: dict[tuple[int, int], WornLayer | None] = {}

    def between(self, first: int, second: int) -> WornLayer | None:
        """Return the layer that one of two parts is over the other; None where neither is.

        Poses in which the two do not meet tell it, else those in which they have fewest pairs.
        """
        key = min(first, second), max(first, second)
        if key not in self._known:
            counts = np.array([met.get(key, 0) for met in self._met])
            poses = np.argsort(counts, kind="stable")[: self.options.poses]
            if counts[poses[0]] == 0:
                poses = poses[counts[poses] == 0]
            self._known[key] = self._found(*key, poses.tolist())
        return self._known[key]

    def _found(self, first: int, second: int, poses: list[int]) -> WornLayer | None:
        """Return the layer of two parts, as the user or else the poses tell; None where neither."""
        over = int(self._numbers[first]) - int(self._numbers[second])
        if over == 0:
            found = None
            if not self._attached(first, second):
                found = find_layer(self.parts, first, second, poses, options=self.options)
            return found or find_worn(self.parts, first, second, poses[0], options=self.options)
        top, under = (first, second) if over > 0 else (second, first)
        layer = layer_over(self.parts, top, under, poses[0], options=self.options)
        return layer if len(layer.vertices) else None


def median_of_parts(numbers: IntArray, part_of_face: IntArray, count: int) -> IntArray:
    """Return the median (count,) of the numbers (F,) of each part's triangles, the higher one."""
    order = np.lexsort((numbers, part_of_face))
    sizes = np.bincount(part_of_face, minlength=count)
    middle = np.cumsum(sizes) - sizes + sizes // 2
    return np.asarray(numbers[order][middle], dtype=np.int32)


def _counts(parts: NDArray[np.integer]) -> dict[tuple[int, int], int]:
    """Return how many pairs (K, 2) of parts there are of each, (smaller, larger)."""
    both, counts = np.unique(np.sort(parts, axis=1), axis=0, return_counts=True)
    return {(int(a), int(b)): int(n) for (a, b), n in zip(both, counts, strict=True)}
