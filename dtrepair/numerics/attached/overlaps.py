"""Finds attachments: the overlaps of connected parts in poses that show them as modelled.

The corners of triangles that intersect, and what of a part lies behind the other one and is
connected to them, are the seeds of an overlap; its zone is grown from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csgraph

from dtrepair.numerics.attached.apart import keys_apart, keys_of_parts, without_ties_of
from dtrepair.numerics.attached.attachment_options import AttachmentOptions
from dtrepair.numerics.attached.growth import grown, ringed, within
from dtrepair.numerics.attached.hems import clear_of_hems
from dtrepair.numerics.attached.hidden_ends import closed_ends, hidden_ends
from dtrepair.numerics.attached.posed_parts import PosedParts
from dtrepair.numerics.attached.slides import shown_by_slides
from dtrepair.numerics.attached.third_parts import keys_by_third
from dtrepair.numerics.attachments import (
    NO_KEYS,
    NO_TIES,
    Attachments,
    Reference,
    Ties,
    distinct_keys,
    joined_ties,
    ties_to,
)
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    components,
    extent,
    lengths,
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
    sides, ties, carried = list[_Side](), [NO_TIES], [NO_TIES]
    nested, sliding = set[Both](), set[Both]()
    for reference in references:
        if not reference.shows_all:
            continue
        overlaps = _Overlaps(faces, part_of_vertex, part_of, reference, options)
        shown = [side for both in overlaps.attached() for side in overlaps.sides(*both)]
        sides += shown
        ties += [side.ties for side in shown]
        parts = overlaps.parts
        nested |= overlaps.nested(
            {(side.part, side.other): np.unique(faces[side.zone // parts]) for side in shown}
        )
        if reference.bound is not None:
            held = reference.points, faces, part_of, reference.bound
            carried.append(hidden_ends(*held, poses=poses))
    if slid := [reference for reference in references if reference.slid]:
        still = distinct_keys([NO_KEYS, *(side.zone for side in sides)])
        moved = shown_by_slides(slid, part_of, still, share=options.turned)
        for reference, slides in zip(slid, moved, strict=True):
            sliding.update(slides)
            if slides:
                overlaps = _Overlaps(faces, part_of_vertex, part_of, reference, options)
                sides += [side for both in slides for side in overlaps.sides(*both)]
    zones = distinct_keys([NO_KEYS, *(side.zone for side in sides)])
    around = distinct_keys([NO_KEYS, *(side.around for side in sides)])
    apart = keys_apart(references, part_of)
    inside = keys_of_parts(np.array(sorted(nested), dtype=np.int64).reshape(-1, 2), part_of)
    third = keys_by_third(zones, around, part_of, [inside, apart])
    hidden = without_ties_of(joined_ties(carried), part_of_vertex, part_of, apart)
    holders = frozenset(side.part for side in sides if side.holds)
    known = third, frozenset(sliding), holders
    return Attachments(part_of, zones, joined_ties(ties), hidden, *known)


class _Side(NamedTuple):
    """One of two parts that are attached: keys of its zone, and of what is around it; its ties.

    other: the other part; holds: whether it holds that one as a whole.
    """

    part: int
    other: int
    zone: KeyArray
    around: KeyArray
    ties: Ties
    holds: bool


class _Seeds(NamedTuple):
    """Vertices (V,) of a part from which its zone towards another one grows.

    own: the seeds; every: with those that hang off the other part; loose: those without a tie;
    whole: whether the part is attached as a whole.
    """

    own: BoolArray
    every: BoolArray
    loose: BoolArray
    whole: bool


class _Overlaps(PosedParts):
    """The overlaps of the parts of one reference pose."""

    def __init__(
        self,
        faces: IntArray,
        part_of_vertex: IntArray,
        part_of: IntArray,
        reference: Reference,
        options: AttachmentOptions,
    ) -> None:
        super().__init__(
            reference.points,
            faces,
            part_of_vertex,
            part_of,
            cells=options.cells,
            enclosed=options.enclosed,
        )
        self.options = options
        between = part_of[reference.pairs]
        crossing = between[:, 0] != between[:, 1]
        self.pairs = reference.pairs[crossing]
        sides = np.sort(between[crossing], axis=1).astype(np.int64)
        self.key_of_pair = sides[:, 0] * self.parts + sides[:, 1]

    def attached(self) -> list[tuple[int, int]]:
        """Return the pairs of parts that intersect."""
        keys = np.unique(self.key_of_pair)
        return [(int(key // self.parts), int(key % self.parts)) for key in keys]

    def sides(self, first: int, second: int) -> list[_Side]:
        """Return the zones and ties of both parts of an attached pair."""
        own = self.pairs[self.key_of_pair == first * self.parts + second]
        both = (first, second), (second, first)
        seeds = {part: self._seeds(part, other, own) for part, other in both}
        found = []
        for part, other in both:
            triangles, of_part = self.triangles(part), seeds[part]
            corners, zone = self.faces[triangles], np.ones(len(triangles), dtype=bool)
            if seeds[other].whole:
                zone = self._beside(of_part, corners, other)
            elif not of_part.whole:
                zone = self._zone(of_part, corners)
            around = zone | self._within(of_part, corners, extent(self.points[of_part.every]))
            keys = triangles.astype(np.int64) * self.parts + other
            ties = self._ties(np.flatnonzero(of_part.own & ~of_part.loose), other)
            found.append(_Side(part, other, keys[zone], keys[around], ties, seeds[other].whole))
        return found

    def _zone(self, seeds: _Seeds, corners: IntArray) -> BoolArray:
        """Return which triangles, by their corners (N, 3), are in the zone grown from seeds."""
        zone = self._grown(seeds.own)
        near = self._grown(seeds.every, coarse=False)
        near |= ringed(self.graph, seeds.every, self.options.rings)
        return np.asarray(zone[corners].any(axis=1) & near[corners].all(axis=1))

    def _beside(self, seeds: _Seeds, corners: IntArray, other: int) -> BoolArray:
        """Return which triangles are in the zone towards what is attached as a whole."""
        reach = self.options.beside * extent(self.points[self.vertices(other)])
        return self._zone(seeds, corners) | self._within(seeds, corners, reach)

    def _within(self, seeds: _Seeds, corners: IntArray, reach: float) -> BoolArray:
        near = within(self.graph, np.flatnonzero(seeds.every), reach)
        return np.asarray(near[corners].any(axis=1))

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
                here = np.count_nonzero(np.isin(zone, self.behind(inner, outer)))
                if here > self.options.nested * len(zone):
                    found.add((min(inner, outer), max(inner, outer)))
        return found

    def _seeds(self, part: int, other: int, pairs: IntArray) -> _Seeds:
        """Return the seeds of a part towards another one."""
        corners = self.faces[pairs.ravel()].ravel()
        mask, loose = np.zeros((2, len(self.points)), dtype=bool)
        mask[corners[self.part_of_vertex[corners] == part]] = True
        touched = np.flatnonzero(mask)
        behind = self.behind(part, other)
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
        hanging, clear = self._hanging(part, other, touched, behind)
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
        self, part: int, other: int, touched: NDArray[np.integer], behind: IntArray
    ) -> tuple[IntArray, IntArray]:
        """Return which vertices of a part `behind` an open one hang off it far from the contact.

        Not those of a hand's end in its cuff, which it touches in few places. Second, which are
        clear of a garment. touched: vertices whose triangles meet the open part.
        """
        met = np.zeros(len(self.points), dtype=bool)
        met[touched] = True
        near, points = self._grown(met)[behind], self.points[behind]
        away = lengths(self.tree(other).nearest(points)[1] - points)
        usual = np.quantile(away[near], self.options.hangs) if near.any() else 0.0
        far = ~near & (away > usual)
        if len(behind) <= self.options.whole * len(self.vertices(part)):
            far &= ~closed_ends(self.points, self.faces[self.triangles(part)], behind, away)
        size, areas = extent(self.points[self.vertices(other)]), lengths(self.normals[behind])
        clear = clear_of_hems(near, far, away, areas, size, options=self.options.hems)
        return np.asarray(behind[far]), np.asarray(behind[clear])

    def _grown(self, seeds: BoolArray, *, coarse: bool = True) -> BoolArray:
        """Return the seeds (V,) grown over their part; coarse: by an edge at least."""
        least = self.edge_length if coarse else None
        return grown(self.graph, self.points, seeds, self.options.reach, least)

    def _ties(self, seeds: NDArray[np.integer], other: int) -> Ties:
        """Return ties of each seed to the nearest triangle of another part."""
        triangles = self.triangles(other)
        if len(seeds) == 0:
            return NO_TIES
        return ties_to(self.tree(other), triangles, self.points, seeds)
