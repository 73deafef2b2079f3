"""Finds attachments: the overlaps of connected parts in poses that show them as modelled.

The corners of triangles that intersect, and what of a part lies behind the other one and is
connected to them, are the seeds of an overlap; its zone is grown from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.attached.hidden_ends import hidden_ends
from dtrepair.numerics.attachments import (
    NO_TIES,
    Attachments,
    Reference,
    Ties,
    joined_ties,
    shown_by_slides,
)
from dtrepair.numerics.closest_point import NearestTriangles, barycentric
from dtrepair.numerics.enclosure import Dipoles
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    components,
    dots,
    lengths,
    triangle_areas,
    unique_edges,
    vector_areas,
)

BoolArray = NDArray[np.bool_]
KeyArray = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class AttachmentOptions:
    """How far a zone reaches, and what is attached as a whole.

    Args:
        reach: Geodesic growth of a zone beyond the overlap, in rms sizes of the overlap: a joint
            that bends slides by about that much. A zone begins within an edge of the mesh at least.
        rings: A triangle belongs to a zone if it begins there, and lies wholly within the rms sizes
            or within so many edges of the overlap.
        enclosed: Behind a part lies only what it encloses by this winding number, as a sleeve its
            arm: not all that is in front of a sheet. Beyond the reach of where the two meet, what
            hangs farther off one with a border than it does there is not held: the knees under a
            skirt.
        cells: Along the extent of a part, for its winding numbers: a sleeve is narrow.
        whole: A part of which more than this share is in or behind one of larger area is attached
            as a whole: eyes, teeth, buttons.
        larger: Ratio of areas above which that is so: copies of a part differ by rounding only.
        turned: Where rigid parts turn about each other, and in some pose more than this share of
            their contact has left the zone, it moves along; else small motions bring it back.
    """

    reach: float = 1.0
    rings: int = 3
    enclosed: float = 0.5
    cells: int = 64
    whole: float = 0.5
    larger: float = 1.001
    turned: float = 0.5


def find_attachments(
    faces: IntArray,
    count: int,
    references: Sequence[Reference],
    *,
    options: AttachmentOptions = AttachmentOptions(),
) -> Attachments:
    """Find what the references show as attached.

    Args:
        faces: Triangles (F, 3) of all objects, whose vertices at one position of the rest are one.
        count: Number of vertices.
        references: Poses with their intersecting pairs; contacts of a part with itself are no
            attachments.
    """
    label = components(faces, count)
    used = np.unique(label[faces]) if len(faces) else np.zeros(0, dtype=np.int32)
    part_of_vertex = np.full(count, -1, dtype=np.int32)
    place = np.searchsorted(used, label)
    known = (place < len(used)) & np.isin(label, used)
    part_of_vertex[known] = place[known]
    part_of = part_of_vertex[faces[:, 0]] if len(faces) else np.zeros(0, dtype=np.int32)
    keys: list[KeyArray] = [np.zeros(0, dtype=np.int64)]
    ties, carried = [NO_TIES], [NO_TIES]
    for reference in references:
        if reference.slid:
            continue
        overlaps = _Overlaps(faces, part_of_vertex, part_of, reference, options)
        for first, second in overlaps.attached():
            for zone_keys, tie in overlaps.zones(first, second):
                keys.append(zone_keys)
                ties.append(tie)
        if reference.bound is not None:
            carried.append(hidden_ends(reference.points, faces, part_of, reference.bound))
    if slid := [reference for reference in references if reference.slid]:
        still = _distinct(keys)
        shown = shown_by_slides(slid, part_of, still, share=options.turned)
        for reference, parts in zip(slid, shown, strict=True):
            if parts:
                overlaps = _Overlaps(faces, part_of_vertex, part_of, reference, options)
                keys += [zone for both in parts for zone, _ in overlaps.zones(*both)]
    zones = _distinct(keys)
    return Attachments(part_of, zones, joined_ties(ties), joined_ties(carried))


def _distinct(keys: Sequence[KeyArray]) -> KeyArray:
    """Return all keys once, ascending; of millions faster than by their hashes."""
    every = np.sort(np.concatenate(keys))
    return np.asarray(every[np.diff(every, prepend=-1) != 0])


class _Overlaps:
    """The overlaps of the parts of one reference pose."""

    def __init__(
        self,
        faces: IntArray,
        part_of_vertex: IntArray,
        part_of: IntArray,
        reference: Reference,
        options: AttachmentOptions,
    ) -> None:
        self.faces, self.part_of_vertex, self.part_of = faces, part_of_vertex, part_of
        self.points, self.options = reference.points, options
        self.parts = int(part_of.max(initial=-1)) + 1
        between = part_of[reference.pairs]
        crossing = between[:, 0] != between[:, 1]
        self.pairs = reference.pairs[crossing]
        sides = np.sort(between[crossing], axis=1).astype(np.int64)
        self.key_of_pair = sides[:, 0] * self.parts + sides[:, 1]
        edges = unique_edges(faces)
        length = lengths(self.points[edges[:, 0]] - self.points[edges[:, 1]])
        both = np.concatenate([edges, edges[:, ::-1]])
        weights = np.concatenate([length, length]) + np.finfo(np.float32).tiny
        shape = (len(part_of_vertex), len(part_of_vertex))
        self.graph = sparse.csr_matrix((weights, (both[:, 0], both[:, 1])), shape=shape)
        self.edge_length = np.full(len(part_of_vertex), 0.0)
        np.maximum.at(self.edge_length, both[:, 0], np.concatenate([length, length]))
        # A head has hundreds of lashes and locks.
        self._trees: dict[int, NearestTriangles] = {}
        self._dipoles: dict[int, Dipoles] = {}
        order = np.argsort(part_of_vertex, kind="stable").astype(np.int32)
        self._order = order
        self._starts = np.searchsorted(part_of_vertex[order], np.arange(self.parts + 1))
        self._face_order = np.argsort(part_of, kind="stable").astype(np.int32)
        self._face_starts = np.searchsorted(part_of[self._face_order], np.arange(self.parts + 1))

    @cached_property
    def open(self) -> BoolArray:
        """Which parts (P,) have a border."""
        edges = np.sort(self.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        keys = edges[:, 0].astype(np.int64) * len(self.points) + edges[:, 1]
        found, counts = np.unique(keys, return_counts=True)
        result = np.zeros(self.parts, dtype=bool)
        result[self.part_of_vertex[found[counts == 1] // len(self.points)]] = True
        return result

    @cached_property
    def normals(self) -> FloatArray:
        """Vector area (V, 3) of the triangles around each vertex."""
        areas = np.repeat(vector_areas(self.points, self.faces), 3, axis=0)
        flat = self.faces.ravel()
        columns = [np.bincount(flat, areas[:, k], len(self.points)) for k in range(3)]
        return np.stack(columns, axis=1)

    @cached_property
    def areas(self) -> FloatArray:
        """Area (P,) of each part."""
        areas = triangle_areas(self.points, self.faces)
        total = np.bincount(self.part_of, areas, minlength=self.parts)
        return total.astype(np.float64)

    def attached(self) -> list[tuple[int, int]]:
        """Return the pairs of parts that intersect."""
        keys = np.unique(self.key_of_pair)
        return [(int(key // self.parts), int(key % self.parts)) for key in keys]

    def vertices(self, part: int) -> IntArray:
        """Return the vertices of a part, ascending."""
        return self._order[self._starts[part] : self._starts[part + 1]]

    def triangles(self, part: int) -> IntArray:
        """Return the triangles of a part, ascending."""
        return self._face_order[self._face_starts[part] : self._face_starts[part + 1]]

    def _corners(self, part: int) -> FloatArray:
        """Return the corners (N, 3, 3) of the triangles of a part."""
        return np.asarray(self.points[self.faces[self.triangles(part)]])

    def _tree(self, part: int) -> NearestTriangles:
        if part not in self._trees:
            self._trees[part] = NearestTriangles(self._corners(part))
        return self._trees[part]

    def zones(self, first: int, second: int) -> list[tuple[KeyArray, Ties]]:
        """Return the zone keys and ties of both parts of an attached pair."""
        own = self.pairs[self.key_of_pair == first * self.parts + second]
        seeds, every, whole = {}, {}, False
        for part, other in ((first, second), (second, first)):
            seeds[part], every[part], encloses = self._seeds(part, other, own)
            whole |= encloses
        found = []
        for part, other in ((first, second), (second, first)):
            triangles = self.triangles(part)
            if not whole:
                zone = self._grown(seeds[part])
                near = self._grown(every[part], coarse=False) | self._ringed(every[part])
                corners = self.faces[triangles]
                triangles = triangles[zone[corners].any(axis=1) & near[corners].all(axis=1)]
            keys = triangles.astype(np.int64) * self.parts + other
            found.append((keys, self._ties(np.flatnonzero(seeds[part]), other)))
        return found

    def _seeds(self, part: int, other: int, pairs: IntArray) -> tuple[BoolArray, BoolArray, bool]:
        """Return seeds (V,) of a part towards another one, and whether it is all attached.

        Second, the seeds with those that hang off the other part.
        """
        corners = self.faces[pairs.ravel()].ravel()
        mask = np.zeros(len(self.points), dtype=bool)
        mask[corners[self.part_of_vertex[corners] == part]] = True
        touched = np.flatnonzero(mask)
        behind = self._behind(part, other)
        mask[behind] = True
        own = self.vertices(part)
        share = mask[own].mean()
        larger = self.areas[other] > self.options.larger * self.areas[part]
        if share > self.options.whole and larger:
            mask[own] = True
            return mask, mask, True
        every = self._reached(mask, touched)
        if not self.open[other]:
            return every, every, False
        mask[self._hanging(part, other, touched, behind)] = False
        return self._reached(mask, touched), every, False

    def _reached(self, mask: BoolArray, touched: NDArray[np.integer]) -> BoolArray:
        """Return what of a mask (V,) is connected through it to vertices: a far shell is not."""
        inner, result = np.flatnonzero(mask), mask.copy()
        label = csgraph.connected_components(self.graph[inner][:, inner], directed=False)[1]
        near = np.isin(label, np.unique(label[np.isin(inner, touched)]))
        result[inner[~near]] = False
        return result

    def _hanging(
        self, part: int, other: int, touched: NDArray[np.integer], behind: IntArray
    ) -> IntArray:
        """Return which vertices of a part `behind` an open one hang off it far from the contact.

        touched: vertices of the part whose triangles meet the other one.
        """
        met = np.zeros(len(self.points), dtype=bool)
        met[touched] = True
        near, points = self._grown(met)[behind], self.points[behind]
        away = lengths(self._tree(other).nearest(points)[1] - points)
        far = ~near & (away > away[near].max(initial=0.0))
        return np.asarray(behind[far & ~met[behind]])

    def _behind(self, part: int, other: int) -> IntArray:
        """Return the vertices of a part behind, or enclosed by, another one, within its box."""
        own, triangles = self.vertices(part), self.triangles(other)
        other_points = self.points[self.vertices(other)]
        low, high = other_points.min(axis=0), other_points.max(axis=0)
        points = self.points[own]
        own = np.asarray(own[((points >= low) & (points <= high)).all(axis=1)])
        if len(own) == 0:
            return own
        if not self.open[other]:
            points = self.points[own]
            nearest, closest = self._tree(other).nearest(points)
            weights = barycentric(closest, self._tree(other).corners[nearest])
            normals = self.normals[self.faces[triangles[nearest]]]
            normal = np.einsum("ik,ikj->ij", weights, normals)
            # Where a surface turns sharply such normals may have what is outside behind it.
            own = np.asarray(own[dots(points - closest, normal) < 0.0])
        if len(own) == 0:
            return own
        if other not in self._dipoles:
            self._dipoles[other] = Dipoles(self._corners(other), self.options.cells)
        around = np.abs(self._dipoles[other].enclose_closely(self.points[own]))
        return np.asarray(own[around > self.options.enclosed])

    def _grown(self, seeds: BoolArray, *, coarse: bool = True) -> BoolArray:
        """Return the seeds (V,) grown over their part by the reach of each of their clusters.

        coarse: by an edge at least.
        """
        zone = seeds.copy()
        inner = np.flatnonzero(seeds)
        label = csgraph.connected_components(self.graph[inner][:, inner], directed=False)[1]
        for cluster in range(label.max(initial=-1) + 1):
            own = inner[label == cluster]
            centred = self.points[own] - self.points[own].mean(axis=0)
            size = float(np.sqrt(dots(centred, centred).mean()))
            limit = self.options.reach * size
            if coarse:
                limit = max(limit, float(self.edge_length[own].mean()))
            distance = csgraph.dijkstra(self.graph, indices=own, min_only=True, limit=limit)
            zone |= np.isfinite(distance)
        return zone

    def _ringed(self, seeds: BoolArray) -> BoolArray:
        """Return the vertices (V,) within a few edges of the seeds."""
        zone = seeds.copy()
        for _ in range(self.options.rings):
            zone[self.graph[np.flatnonzero(zone)].indices] = True
        return zone

    def _ties(self, seeds: NDArray[np.integer], other: int) -> Ties:
        """Return ties of each seed to the nearest triangle of another part."""
        triangles = self.triangles(other)
        if len(seeds) == 0:
            return NO_TIES
        nearest, closest = self._tree(other).nearest(self.points[seeds])
        weights = barycentric(closest, self._tree(other).corners[nearest])
        return Ties(seeds.astype(np.int32), triangles[nearest], weights)
