"""Parts that lie wholly inside others: they intersect nothing, and are wrong all the same.

A part is a connected component of the triangles, whatever body it belongs to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    closed_parts,
    components,
    weld_map,
    weld_maps,
)
from dtrepair.repair.surface.rays import exits_along, windings
from dtrepair.repair.surface.surface import BoolArray


@dataclass(frozen=True, kw_only=True)
class ContainmentOptions:
    """How many vertices are looked at.

    Args:
        votes: Vertices of a part that vote on whether it is inside; odd.
        few: Vertices of a part that tell how far it is to the outside, to rank directions ...
        many: ... and to be sure of the best ones.
        block: Candidate boxes looked at in one step, which bounds the memory.
    """

    votes: int = 3
    few: int = 8
    many: int = 40
    block: int = 4_000_000


class Enclosed(NamedTuple):
    """Parts inside parts: (inner, outer) (K, 2), and which of them (K,) are so in the rest too."""

    parts: IntArray
    meant: BoolArray


class Enclosures:
    """Finds the parts of a pose that lie wholly inside closed ones; built once per topology.

    Only closed parts, oriented outwards, have an inside. An eye in its head is inside in the rest
    pose as well, so it is told apart by `meant`.

    Args:
        rest: Rest positions (V, 3).
        faces: Triangles (F, 3); duplicates along seams should be one vertex.
    """

    def __init__(
        self,
        rest: FloatArray,
        faces: IntArray,
        *,
        options: ContainmentOptions = ContainmentOptions(),
    ) -> None:
        self._options = options
        self.rest, self.faces = rest, faces
        used = np.unique(faces)
        names, label = np.unique(components(faces, len(rest))[used], return_inverse=True)
        self.count = len(names)
        # Part of each vertex (V,), -1 for those without a triangle, and of each triangle (F,).
        self.part = np.full(len(rest), -1, dtype=np.int32)
        self.part[used] = label
        self.part_of_face = self.part[faces[:, 0]]
        self._face_order, self._face_starts = _grouped(self.part_of_face, self.count)
        order, self._starts = _grouped(label, self.count)
        self._vertices = used[order]
        self._meant: dict[tuple[int, int], bool] = {}

    @cached_property
    def closed(self) -> BoolArray:
        """Which parts have every edge run through as often one way as the other."""
        return closed_parts(self.faces, self.part_of_face, self.count)

    def __call__(self, points: FloatArray, pairs: IntArray) -> Enclosed:
        """Return what a pose (V, 3) with the intersecting `pairs` (K, 2) of triangles encloses.

        Parts that intersect each other are contacts, not enclosed.
        """
        none = Enclosed(np.zeros((0, 2), dtype=np.int32), np.zeros(0, dtype=bool))
        if self.count < 2 or not self.closed.any():
            return none
        found = self._boxes_inside(points)
        if len(pairs) and len(found):
            touching = self.part_of_face[pairs].astype(np.int64)
            keys = np.concatenate([touching, touching[:, ::-1]]) @ [self.count, 1]
            found = found[~np.isin(found.astype(np.int64) @ [self.count, 1], keys)]
        inside = [self._is_inside(points, inner, outer) for inner, outer in found.tolist()]
        found = found[np.array(inside, dtype=bool)]
        meant = [self._is_meant(inner, outer) for inner, outer in found.tolist()]
        return Enclosed(found, np.array(meant, dtype=bool))

    def vertices(self, part: int) -> NDArray[np.integer]:
        """Return the vertices of a part."""
        own: NDArray[np.integer] = self._vertices[self._starts[part] : self._starts[part + 1]]
        return own

    def way_out(self, points: FloatArray, inner: int, outer: int) -> FloatArray:
        """Return the shortest shift (3,) found that takes `inner` out of `outer`.

        Along 26 directions and that to the nearest vertex of `outer`, the farthest way that a
        vertex of `inner` has to the outside decides.
        """
        mine = self.vertices(inner)
        others = points[self.vertices(outer)]
        middle = points[mine].mean(axis=0)
        nearest = others[((others - middle) ** 2).sum(axis=1).argmin()] - middle
        candidates = [np.array(way, dtype=np.float64) for way in product((-1, 0, 1), repeat=3)]
        ways = [way / np.linalg.norm(way) for way in [nearest, *candidates] if way.any()]
        few = _picked(mine, self._options.few)
        ways.sort(key=lambda way: self._way_along(points, way, few, outer))
        many = _picked(mine, self._options.many)
        lengths = [self._way_along(points, way, many, outer) for way in ways[:3]]
        best = int(np.argmin(lengths))
        shift: FloatArray = ways[best] * lengths[best]
        return shift

    def length_along(
        self, points: FloatArray, direction: FloatArray, inner: int, outer: int
    ) -> float:
        """Return how far `inner` has to go along a unit direction to be out of `outer`."""
        return self._way_along(
            points, direction, _picked(self.vertices(inner), self._options.many), outer
        )

    def _way_along(
        self, points: FloatArray, direction: FloatArray, probes: NDArray[np.integer], outer: int
    ) -> float:
        """Return how far the probes have to go along a direction until all are outside."""
        return float(exits_along(direction, points[probes], self._corners(points, outer)).max())

    def _boxes_inside(self, points: FloatArray) -> IntArray:
        """Return pairs (inner, outer) of bounding boxes inside each other, by a sweep along x."""
        low = np.minimum.reduceat(points[self._vertices], self._starts[:-1])
        high = np.maximum.reduceat(points[self._vertices], self._starts[:-1])
        order = np.argsort(low[:, 0])
        outer = np.flatnonzero(self.closed)
        first = np.searchsorted(low[order, 0], low[outer, 0], side="right")
        last = np.searchsorted(low[order, 0], high[outer, 0], side="left")
        sizes = np.maximum(last - first, 0)
        found = []
        blocks = np.cumsum(sizes) // self._options.block
        for block in np.unique(blocks):
            own = np.flatnonzero(blocks == block)
            wide = np.repeat(outer[own], sizes[own])
            offset = np.repeat(first[own] - np.cumsum(sizes[own]) + sizes[own], sizes[own])
            narrow = order[offset + np.arange(len(offset))]
            within = (low[narrow] > low[wide]).all(axis=1) & (high[narrow] < high[wide]).all(axis=1)
            found.append(np.stack([narrow[within], wide[within]], axis=1))
        return np.concatenate(found).astype(np.int32)

    def _is_inside(self, points: FloatArray, inner: int, outer: int) -> bool:
        """Return whether most picked vertices of a part are inside another."""
        starts = points[_picked(self.vertices(inner), self._options.votes)]
        return (
            2 * int((windings(starts, self._corners(points, outer)) > 0).sum())
            > self._options.votes
        )

    def wholly_inside(self, points: FloatArray, inner: int, outer: int) -> bool:
        """Return whether all vertices of a part are inside another one in a pose (V, 3)."""
        starts = points[self.vertices(inner)]
        return bool((windings(starts, self._corners(points, outer)) > 0).all())

    def _is_meant(self, inner: int, outer: int) -> bool:
        key = inner, outer
        if key not in self._meant:
            self._meant[key] = self._is_inside(self.rest, inner, outer)
        return self._meant[key]

    def _corners(self, points: FloatArray, part: int) -> FloatArray:
        """Return the triangles (F, 3, 3) of a part."""
        own = self._face_order[self._face_starts[part] : self._face_starts[part + 1]]
        corners: FloatArray = points[self.faces[own]]
        return corners


def oriented_outwards(points: FloatArray, faces: IntArray) -> IntArray:
    """Return triangles (F, 3) of points (V, 3) with closed parts that are inside out turned round.

    Such a part has a negative volume; one that lies inside another part is a cavity of it.
    """
    return meshes_oriented_outwards([(points, faces)])[0]


def meshes_oriented_outwards(meshes: Sequence[tuple[FloatArray, IntArray]]) -> list[IntArray]:
    """Return the triangles of each mesh, (V, 3) and (F, 3), with such parts turned round.

    Meshes do not matter to each other; those that are right as they are cost as one.
    """
    if not any(len(faces) for _, faces in meshes):
        return [faces for _, faces in meshes]
    starts = np.cumsum([0, *(len(points) for points, _ in meshes)])
    ends = np.cumsum([len(faces) for _, faces in meshes])
    shifted = [faces + start for (_, faces), start in zip(meshes, starts, strict=False)]
    enclosures = Enclosures(
        np.concatenate([points for points, _ in meshes]),
        weld_maps([points for points, _ in meshes])[np.concatenate(shifted)],
    )
    part = enclosures.part_of_face
    corners = [points[faces] - points.mean(axis=0) for points, faces in meshes if len(faces)]
    negative = np.bincount(part, np.linalg.det(np.concatenate(corners))) < 0.0
    if not negative.any():
        return [faces for _, faces in meshes]
    turned = np.split((enclosures.closed & negative)[part], ends[:-1])
    return [
        _turned(*mesh, own) if own.any() else mesh[1]
        for mesh, own in zip(meshes, turned, strict=True)
    ]


def _turned(points: FloatArray, faces: IntArray, turned: BoolArray) -> IntArray:
    """Return triangles (F, 3) with some (F,) turned round, unless they bound a cavity."""
    result = np.where(turned[:, None], faces[:, [0, 2, 1]], faces)
    # Only what is oriented outwards tells what is inside of it.
    outwards = Enclosures(points, weld_map(points)[result])
    cavities = outwards(points, np.zeros((0, 2), dtype=np.int32)).parts[:, 0]
    turned = turned & ~np.isin(outwards.part_of_face, cavities)
    return np.where(turned[:, None], faces[:, [0, 2, 1]], faces)


def _grouped(
    labels: NDArray[np.integer], count: int
) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Return the items sorted by label, and where each label starts (count + 1,)."""
    order = np.argsort(labels, kind="stable")
    return order, np.searchsorted(labels[order], np.arange(count + 1))


def _picked(vertices: NDArray[np.integer], count: int) -> NDArray[np.integer]:
    """Return at most `count` vertices spread evenly over the given ones."""
    places = np.linspace(0, len(vertices) - 1, count).round().astype(np.int64)
    return vertices[places]
