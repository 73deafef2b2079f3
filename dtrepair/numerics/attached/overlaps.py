"""Finds attachments: the overlaps of connected parts in poses that show them as modelled.

The corners of triangles that intersect, and what of a part lies behind the other one and is
connected to them, are the seeds of an overlap; its zone is grown from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.attached.apart import keys_apart, keys_of_parts, without_ties_of
from dtrepair.numerics.attached.attachment_options import AttachmentOptions
from dtrepair.numerics.attached.growth import grown, ringed
from dtrepair.numerics.attached.hems import clear_of_hems
from dtrepair.numerics.attached.hidden_ends import hidden_ends
from dtrepair.numerics.attachments import (
    NO_KEYS,
    NO_TIES,
    Attachments,
    Reference,
    Ties,
    distinct_keys,
    joined_ties,
    shown_by_slides,
    ties_to,
)
from dtrepair.numerics.closest_point import NearestTriangles, barycentric
from dtrepair.numerics.enclosure import Dipoles
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    border_edges,
    components,
    dots,
    extent,
    lengths,
    triangle_areas,
    unique_edges,
    vector_areas,
)

BoolArray = NDArray[np.bool_]
KeyArray = NDArray[np.int64]
Both = tuple[int, int]


def find_attachments(
    faces: IntArray,
    count: int,
    references: Sequence[Reference],
    *,
    poses: Sequence[FloatArray] = (),
    options: AttachmentOptions = AttachmentOptions(),
) -> Attachments:
    """Find what the references show as attached.

    Args:
        faces: Triangles (F, 3) of all objects, whose vertices at one position of the rest are one.
        count: Number of vertices.
        references: Poses with their intersecting pairs; contacts of a part with itself are no
            attachments.
        poses: Poses (V, 3) of a clip, which tell what follows what hides it.
    """
    part_of_vertex = np.full(count, -1, dtype=np.int32)
    place = np.unique(components(faces, count)[faces], return_inverse=True)[1]
    part_of_vertex[faces] = place.reshape(faces.shape)
    part_of = part_of_vertex[faces[:, 0]]
    keys, ties, carried = [NO_KEYS], [NO_TIES], [NO_TIES]
    nested, sliding = set[Both](), set[Both]()
    for reference in references:
        if not reference.shows_all:
            continue
        overlaps = _Overlaps(faces, part_of_vertex, part_of, reference, options)
        towards: dict[Both, IntArray] = {}
        for first, second in overlaps.attached():
            both = (first, second), (second, first)
            for own, (zone_keys, tie) in zip(both, overlaps.zones(first, second), strict=True):
                keys.append(zone_keys)
                ties.append(tie)
                towards[own] = np.unique(faces[zone_keys // overlaps.parts])
        nested |= overlaps.nested(towards)
        if reference.bound is not None:
            held = reference.points, faces, part_of, reference.bound
            carried.append(hidden_ends(*held, poses=poses))
    if slid := [reference for reference in references if reference.slid]:
        still = distinct_keys(keys)
        shown = shown_by_slides(slid, part_of, still, share=options.turned)
        for reference, parts in zip(slid, shown, strict=True):
            sliding.update(parts)
            if parts:
                overlaps = _Overlaps(faces, part_of_vertex, part_of, reference, options)
                keys += [zone for both in parts for zone, _ in overlaps.zones(*both)]
    apart = keys_apart(references, part_of)
    inside = np.array(sorted(nested), dtype=np.int64).reshape(-1, 2)
    alone = distinct_keys([keys_of_parts(inside, part_of), apart])
    hidden = without_ties_of(joined_ties(carried), part_of_vertex, part_of, apart)
    found = distinct_keys(keys), joined_ties(ties), hidden
    return Attachments(part_of, *found, alone, frozenset(sliding))


class _Seeds(NamedTuple):
    """Vertices (V,) of a part from which its zone towards another one grows.

    own: the seeds; every: with those that hang off the other part; loose: those without a tie;
    whole: whether the part is attached as a whole.
    """

    own: BoolArray
    every: BoolArray
    loose: BoolArray
    whole: bool


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
        borders = border_edges(self.faces, len(self.points))
        result = np.zeros(self.parts, dtype=bool)
        result[self.part_of_vertex[self.faces.ravel()[borders[:, 0]]]] = True
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
        both = (first, second), (second, first)
        seeds = {part: self._seeds(part, other, own) for part, other in both}
        whole = any(found.whole for found in seeds.values())
        found = []
        for part, other in both:
            triangles, of_part = self.triangles(part), seeds[part]
            if not whole:
                zone = self._grown(of_part.own)
                near = self._grown(of_part.every, coarse=False)
                near |= ringed(self.graph, of_part.every, self.options.rings)
                corners = self.faces[triangles]
                triangles = triangles[zone[corners].any(axis=1) & near[corners].all(axis=1)]
            keys = triangles.astype(np.int64) * self.parts + other
            found.append((keys, self._ties(np.flatnonzero(of_part.own & ~of_part.loose), other)))
        return found

    def nested(self, towards: dict[Both, IntArray]) -> set[Both]:
        """Return the parts, A < B, that meet a third one and of which one lies in the other.

        towards: the vertices of the zone of a part towards another one, by these two.
        """
        open_parts = np.flatnonzero(self.open)
        largest = open_parts[np.argsort(-self.areas[open_parts], kind="stable")]
        found = set()
        for (inner, host), zone in towards.items():
            for outer in largest[: self.options.garments].tolist():
                if (outer, host) not in towards or (inner, outer) in towards or inner == outer:
                    continue
                here = np.count_nonzero(np.isin(zone, self._behind(inner, outer)))
                if here > self.options.nested * len(zone):
                    found.add((min(inner, outer), max(inner, outer)))
        return found

    def _seeds(self, part: int, other: int, pairs: IntArray) -> _Seeds:
        """Return the seeds of a part towards another one."""
        corners = self.faces[pairs.ravel()].ravel()
        mask, loose = np.zeros((2, len(self.points)), dtype=bool)
        mask[corners[self.part_of_vertex[corners] == part]] = True
        touched = np.flatnonzero(mask)
        behind = self._behind(part, other)
        mask[behind] = True
        own = self.vertices(part)
        share = mask[own].mean()
        larger = self.areas[other] > self.options.larger * self.areas[part]
        if share > self.options.whole and larger and self._small(part, other, touched):
            mask[own] = True
            return _Seeds(mask, mask, loose, True)
        every = self._reached(mask, touched)
        if not self.open[other]:
            return _Seeds(every, every, loose, False)
        hanging, clear = self._hanging(other, touched, behind)
        mask[hanging], loose[clear] = False, True
        return _Seeds(self._reached(mask, touched), every, loose, False)

    def _small(self, part: int, other: int, touched: NDArray[np.integer]) -> bool:
        """Return whether a part is small, or has little beyond where it meets another one.

        A leg in a robe, which it meets at the hip, has its knee; what is in a closed part is sunk
        in it wherever it meets it.
        """
        if not self.open[other] or self.areas[part] < self.options.small * self.areas[other]:
            return True
        met = np.zeros(len(self.points), dtype=bool)
        met[touched] = True
        return bool(self._grown(met)[self.vertices(part)].mean() > self.options.covered)

    def _reached(self, mask: BoolArray, touched: NDArray[np.integer]) -> BoolArray:
        """Return what of a mask (V,) is connected through it to vertices: a far shell is not."""
        inner, result = np.flatnonzero(mask), mask.copy()
        label = csgraph.connected_components(self.graph[inner][:, inner], directed=False)[1]
        near = np.isin(label, np.unique(label[np.isin(inner, touched)]))
        result[inner[~near]] = False
        return result

    def _hanging(
        self, other: int, touched: NDArray[np.integer], behind: IntArray
    ) -> tuple[IntArray, IntArray]:
        """Return which vertices `behind` an open part hang off it far from the contact.

        Second, which are clear of a garment. touched: vertices whose triangles meet the open part.
        """
        met = np.zeros(len(self.points), dtype=bool)
        met[touched] = True
        near, points = self._grown(met)[behind], self.points[behind]
        away = lengths(self._tree(other).nearest(points)[1] - points)
        usual = np.quantile(away[near], self.options.hangs) if near.any() else 0.0
        far = ~near & (away > usual)
        size, areas = extent(self.points[self.vertices(other)]), lengths(self.normals[behind])
        clear = clear_of_hems(near, far, away, areas, size, options=self.options.hems)
        return np.asarray(behind[far]), np.asarray(behind[clear])

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
        """Return the seeds (V,) grown over their part; coarse: by an edge at least."""
        least = self.edge_length if coarse else None
        return grown(self.graph, self.points, seeds, self.options.reach, least)

    def _ties(self, seeds: NDArray[np.integer], other: int) -> Ties:
        """Return ties of each seed to the nearest triangle of another part."""
        triangles = self.triangles(other)
        if len(seeds) == 0:
            return NO_TIES
        return ties_to(self._tree(other), triangles, self.points, seeds)
