"""Modelled contacts: which parts were built to overlap, where, and how well they stay attached.

Two parts are attached where they intersect in a reference pose (the bind pose). Around the overlap
each has a zone towards the other; a pair of triangles is modelled where both lie in the zones of
the same two parts, or, for parts that are not attached, in their zones towards one common third
that has its own zones towards the two near each other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from tests.measures.surfaces import (
    Floats,
    Ints,
    Mask,
    Surface,
    areas,
    grown,
    nearest_on_triangles,
    winding_numbers,
)

RINGS = 3  # edges that a zone reaches beyond its seeds
REACH = 1.0  # and the geodesic distance, in rms sizes of the cluster of seeds
WHOLE = 0.5  # share of a part, seeds and what is behind, from which the whole part is a seed


@dataclass(frozen=True)
class Side:
    """One part of an attachment: welded vertices of the seeds (S,), mask of the zone (F,).

    beside: the zone, and what is near (F,), as far beyond the seeds as these are long.
    """

    part: int
    seeds: Ints
    zone: Mask
    beside: Mask


@dataclass(frozen=True)
class Ties:
    """Vertices (N,) bound to points of triangles: corners (N, 3) with weights (N, 3)."""

    vertices: Ints
    corners: Ints
    weights: Floats

    def offsets(self, points: Floats) -> Floats:
        """From the point of the triangle to the vertex (N, 3)."""
        held: Floats = np.einsum("nk,nkd->nd", self.weights, points[self.corners])
        return points[self.vertices] - held


@dataclass(frozen=True)
class Attachment:
    """Two parts that meet in a reference pose."""

    sides: tuple[Side, Side]
    ties: Ties


def attach(surface: Surface, points: Floats, pairs: Ints) -> list[Attachment]:
    """All attachments of a reference pose: welded points (W, 3), its intersecting pairs (K, 2)."""
    of = np.sort(surface.part_of_face[pairs], axis=1)
    different = of[:, 0] != of[:, 1]
    pairs, of = pairs[different], of[different]
    met = np.unique(of, axis=0)
    return [
        _attach_two(surface, points, pairs[(of == two).all(axis=1)], int(two[0]), int(two[1]))
        for two in met
    ]


def _attach_two(surface: Surface, points: Floats, pairs: Ints, a: int, b: int) -> Attachment:
    """The attachment of parts a and b, which meet in `pairs` (K, 2)."""
    faces = np.unique(pairs)
    seeds, buried = {}, {}
    for own, other in ((a, b), (b, a)):
        corners = np.unique(surface.faces[faces[surface.part_of_face[faces] == own]])
        inner = behind(surface, points, own, other)
        seeds[own] = _hanging_together(surface, corners, inner)
        buried[own] = len(np.union1d(seeds[own], inner)) / len(surface.vertices(own))
    size = {
        own: float(areas(points, surface.faces[surface.triangles(own)]).sum()) for own in (a, b)
    }
    small = a if size[a] <= size[b] else b
    whole = buried[small] > WHOLE
    if whole:
        seeds[small] = surface.vertices(small)
    sides = []
    for own in (a, b):
        of_part = surface.part_of_face == own
        zone = of_part.copy()
        if not (whole and own == small):
            zone &= _zone(surface, points, seeds[own])
            if whole:
                zone |= of_part & _near(surface, points, seeds[own], _length(points, seeds[small]))
        beside = of_part & _near(surface, points, seeds[own], _length(points, seeds[own]))
        sides.append(Side(own, seeds[own], zone, zone | beside))
    ties = [_tie(surface, points, seeds[own], other) for own, other in ((a, b), (b, a))]
    return Attachment((sides[0], sides[1]), join_ties(ties))


def behind(surface: Surface, points: Floats, own: int, other: int) -> Ints:
    """Vertices of one part that lie inside another, which may have openings (winding over 1/2)."""
    triangles = points[surface.faces[surface.triangles(other)]]
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    vertices = surface.vertices(own)
    within = ((points[vertices] >= low) & (points[vertices] <= high)).all(axis=1)
    vertices = vertices[within]
    inside: Ints = vertices[np.abs(winding_numbers(points[vertices], triangles)) > 0.5]
    return inside


def _hanging_together(surface: Surface, corners: Ints, behind: Ints) -> Ints:
    """The corners, and of what is behind all that is connected to them through such."""
    label = _clusters(surface, np.union1d(corners, behind))
    seeds = np.isin(label, np.unique(label[corners])) & (label >= 0)
    return np.flatnonzero(seeds)


def _clusters(surface: Surface, vertices: Ints) -> Ints:
    """Label (W,) of the connected cluster of each of the vertices, -1 for all others."""
    chosen = np.zeros(len(surface.point_of), dtype=bool)
    chosen[vertices] = True
    inside = surface.edges[chosen[surface.edges].all(axis=1)]
    count = len(chosen)
    matrix = sparse.coo_array((np.ones(len(inside)), (inside[:, 0], inside[:, 1])), (count, count))
    label: Ints = csgraph.connected_components(matrix, directed=False)[1].astype(np.int64)
    label[~chosen] = -1
    return label


def _zone(surface: Surface, points: Floats, seeds: Ints) -> Mask:
    """Triangles (F,) with all corners within the rings or the reach of the seeds."""
    reached = grown(surface, seeds, RINGS)
    label = _clusters(surface, seeds)
    graph = surface.graph(points)
    for cluster in np.unique(label[seeds]):
        own = np.flatnonzero(label == cluster)
        spread = points[own] - points[own].mean(axis=0)
        reach = REACH * float(np.sqrt((spread**2).sum(axis=1).mean()))
        away = csgraph.dijkstra(graph, directed=False, indices=own, min_only=True, limit=reach)
        reached |= away <= reach
    return np.asarray(reached[surface.faces].all(axis=1))


def _length(points: Floats, vertices: Ints) -> float:
    """The longest side of the box of some vertices (N,)."""
    return float(np.ptp(points[vertices], axis=0).max())


def _near(surface: Surface, points: Floats, seeds: Ints, limit: float) -> Mask:
    """Triangles (F,) with a corner no farther from the seeds than a limit, along edges."""
    graph = surface.graph(points)
    away = csgraph.dijkstra(graph, directed=False, indices=seeds, min_only=True, limit=limit)
    return np.asarray((away <= limit)[surface.faces].any(axis=1))


def _tie(surface: Surface, points: Floats, seeds: Ints, other: int) -> Ties:
    """Bind each seed to the nearest point of the other part."""
    triangles = surface.triangles(other)
    index, weights, _ = nearest_on_triangles(points[seeds], points[surface.faces[triangles]])
    return Ties(seeds, surface.faces[triangles[index]], weights)


def join_ties(ties: list[Ties]) -> Ties:
    """All ties as one."""
    none = Ties(np.zeros(0, np.int64), np.zeros((0, 3), np.int64), np.zeros((0, 3)))
    each = [none, *ties]
    return Ties(
        np.concatenate([own.vertices for own in each]),
        np.concatenate([own.corners for own in each]),
        np.concatenate([own.weights for own in each]),
    )


def drift(ties: Ties, before: Floats, after: Floats) -> Floats:
    """How much the offset of each tie changed (N,), from welded points (W, 3) to others."""
    change = ties.offsets(after) - ties.offsets(before)
    result: Floats = np.linalg.norm(change, axis=1)
    return result


class Zones:
    """The zones of all attachments, ready to be asked about pairs and vertices."""

    def __init__(self, surface: Surface, attachments: list[Attachment]) -> None:
        self._surface = surface
        self._zone: dict[tuple[int, int], Mask] = {}
        self._beside: dict[tuple[int, int], Mask] = {}
        self._hosts: dict[int, set[int]] = {}
        for attachment in attachments:
            first, second = attachment.sides
            for own, other in ((first, second), (second, first)):
                self._zone[own.part, other.part] = own.zone
                self._beside[own.part, other.part] = own.beside
                self._hosts.setdefault(own.part, set()).add(other.part)

    def modelled(self, pairs: Ints) -> Mask:
        """Which of the pairs (K, 2) of triangles are contacts that were built in."""
        result = np.zeros(len(pairs), dtype=bool)
        of = self._surface.part_of_face[pairs]
        for a, c in np.unique(of, axis=0).tolist():
            rows = np.flatnonzero((of == (a, c)).all(axis=1))
            i, j = pairs[rows].T
            for one, other in self._common(a, c):
                result[rows] |= self._zone[one][i] & self._zone[other][j]
        return result

    def held(self, part: int, other: int) -> Mask:
        """Vertices (W,) of a part that may lie in another: of its zones that count for the two."""
        result = np.zeros(len(self._surface.point_of), dtype=bool)
        for own, _ in self._common(part, other):
            result[self._surface.faces[self._zone[own]]] = True
        return result

    def _common(self, a: int, c: int) -> list[tuple[tuple[int, int], tuple[int, int]]]:
        """Keys of two zones, one of each part, in which contacts of the two are modelled."""
        if a == c:
            return []
        if (a, c) in self._zone:
            return [((a, c), (c, a))]
        common = self._hosts.get(a, set()) & self._hosts.get(c, set())
        return [((a, b), (c, b)) for b in sorted(common) if self._meet_on(b, a, c)]

    def _meet_on(self, host: int, a: int, c: int) -> bool:
        """Whether one of the zones of a part towards two others is beside the other one."""
        first, second = (host, a), (host, c)
        return bool(
            (self._zone[first] & self._beside[second]).any()
            or (self._zone[second] & self._beside[first]).any()
        )
