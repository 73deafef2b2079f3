"""Attachments: contacts that were modelled, and where two connected parts hold on to each other.

An arm ends inside a sleeve, a ball sits in its socket, an eye in its head: such parts overlap in
the bind pose on purpose. Around every such overlap each of the two parts has a zone. A pair of
triangles is a modelled contact where both lie in the zones of the same two parts, or, for parts
that are attached to one third part and not to each other, both in their zones towards that part,
if its own zones towards the two are near each other: two shoes do not meet on one body. But not
for what lies in the other: a ring does not make a hand come through its glove.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.numerics.closest_point import NearestTriangles, barycentric
from dtrepair.numerics.geometry import FloatArray, IntArray, lengths, triangle_frames

BoolArray = NDArray[np.bool_]
KeyArray = NDArray[np.int64]
Parts = frozenset[tuple[int, int]]

# The parts towards which a triangle has zones are bits of so many words of 64 at most.
MOST_WORDS = 8


class Reference(NamedTuple):
    """A pose that shows modelled contacts: points (V, 3), and its intersecting pairs (K, 2).

    name: What messages call the pose. asked: whether the user calls these parts attached. bound:
    what binds each triangle (F,), -1 for nothing: of parts that one thing binds the pose shows how
    they lie to each other; None: of none. slid: whether parts that slide in each other have slid
    on: what they show counts where one of the two still meets the other within its zone. turned:
    whether they have turned on instead, which counts where their contact left its zone for it.
    apart: whether the parts are not attached, and no third one tells anything of them, either.
    """

    points: FloatArray
    pairs: IntArray
    name: str = ""
    asked: bool = False
    bound: IntArray | None = None
    slid: bool = False
    turned: bool = False
    apart: bool = False

    @property
    def shows_all(self) -> bool:
        """Whether the pose shows how parts were modelled that did not move on."""
        return not (self.slid or self.apart)


def telling(
    references: Sequence[Reference], *, auto: bool = True, turns: bool = False
) -> list[Reference]:
    """Return the references that tell what was modelled.

    auto: else only of what the user calls attached; turns: of joints that have turned, too, even
    where the user does not.
    """
    chosen = [own for own in references if auto or own.asked]
    return [own for own in chosen if turns or own.asked or not own.turned]


def distinct_keys(keys: Sequence[KeyArray]) -> KeyArray:
    """Return all keys once, ascending; of millions faster than by their hashes."""
    every = np.sort(np.concatenate(keys))
    return np.asarray(every[np.diff(every, prepend=-1) != 0])


class Ties(NamedTuple):
    """Vertices (N,), the triangle (N,) of another part that each rests on, weights (N, 3) there.

    offsets: from there to each vertex (N, 3), in the frame of the triangle (`triangle_frames`) and
    the units of the points, as the pose has it that shows the tie.
    """

    vertices: IntArray
    triangles: IntArray
    weights: FloatArray
    offsets: FloatArray

    def among(self, kept: NDArray[Any]) -> Ties:
        """Return those of a mask (N,) or of given numbers."""
        return Ties(*(own[kept] for own in self))

    def of_triangles(self, number: NDArray[np.integer], place: NDArray[np.integer]) -> Ties:
        """Return those to triangles with a new number (F,), not -1; `place` (V,) of vertices."""
        there = number[self.triangles].astype(np.int32)
        known = there >= 0
        vertices = place[self.vertices].astype(np.int32)
        return self._replace(vertices=vertices, triangles=there).among(known)


def joined_ties(ties: Sequence[Ties]) -> Ties:
    """Return all ties as one."""
    return Ties(*(np.concatenate(own) for own in zip(*ties, strict=True)))


NO_KEYS = np.zeros(0, dtype=np.int64)
NO_TIES = Ties(np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros((0, 3)), np.zeros((0, 3)))


def ties_to(
    nearest: NearestTriangles,
    triangles: NDArray[np.integer],
    points: FloatArray,
    vertices: NDArray[np.integer],
) -> Ties:
    """Return ties of vertices (N,) of a pose (V, 3) to `nearest`, the triangles (M,) in it."""
    own = points[vertices]
    place, closest = nearest.nearest(own)
    corners = nearest.corners[place]
    offsets = np.einsum("nji,nj->ni", triangle_frames(corners), own - closest)
    # A triangle without area has no frame: the length is kept all the same.
    flat = lengths(offsets) < 0.999 * lengths(own - closest)
    offsets[flat, 0] = lengths(own - closest)[flat]
    weights = barycentric(closest, corners)
    return Ties(vertices.astype(np.int32), triangles[place].astype(np.int32), weights, offsets)


def distances(ties: Ties, points: FloatArray, faces: IntArray) -> FloatArray:
    """Return how far each vertex (N,) is from where it is tied, in a pose (V, 3)."""
    places = np.einsum("nk,nkj->nj", ties.weights, points[faces[ties.triangles]])
    return lengths(points[ties.vertices] - places)


def zone_rows(keys: KeyArray, triangles: int, parts: int) -> sparse.csr_matrix:
    """Return the matrix (F, P) that is true where a triangle has a zone towards a part.

    keys: sorted, triangle x number of parts + part.
    """
    shape = triangles, max(parts, 1)
    start = np.searchsorted(keys, np.arange(shape[0] + 1, dtype=np.int64) * shape[1])
    entries = np.ones(len(keys), dtype=bool), keys % shape[1], start
    return sparse.csr_matrix(entries, shape=shape)


class Attachments:
    """Which contacts were modelled, by triangles; nothing in it ever changes.

    Args:
        part_of: The connected part (F,) of each triangle.
        zones: Sorted keys, triangle x number of parts + other part, of the zones.
        ties: What holds the parts together.
        carried: Ties of what need not touch to be carried along, see `hidden_ends`.
        by_third: Sorted keys, A x number of parts + B, A < B, of parts of which a third one tells.
        sliding: Pairs of parts, A < B, that slide in each other, as a piston does.
        holders: Parts that hold others as wholes, as a coat its buttons.
    """

    def __init__(
        self,
        part_of: IntArray,
        zones: KeyArray,
        ties: Ties,
        carried: Ties = NO_TIES,
        by_third: KeyArray = NO_KEYS,
        sliding: Parts = frozenset(),
        holders: frozenset[int] = frozenset(),
    ) -> None:
        self.part_of = part_of
        self.count = int(part_of.max(initial=-1)) + 1
        self.zones = zones
        self.ties = ties
        self.carried, self.by_third = carried, by_third
        self.sliding, self.holders = sliding, holders

    def same_zones(self, other: Attachments | None) -> bool:
        """Return whether others model the same contacts."""
        return other is not None and all(
            np.array_equal(own, known)
            for own, known in ((self.zones, other.zones), (self.by_third, other.by_third))
        )

    def holding(self, kept: BoolArray) -> Attachments:
        """Return the same with only those of the ties (N,) that are kept."""
        ties = self.ties.among(kept)
        return self._with(ties, self.carried)

    def carrying(self, more: Ties) -> Attachments:
        """Return the same with more that is carried along."""
        carried = joined_ties([self.carried, more])
        return self._with(self.ties, carried)

    def _with(self, ties: Ties, carried: Ties) -> Attachments:
        return self._of(self.part_of, self.zones, ties, carried)

    @property
    def tied(self) -> bool:
        """Whether parts hold on to each other; else something is carried along at most."""
        return len(self.ties.vertices) > 0

    @property
    def every_tie(self) -> Ties:
        """The ties, and those of what is carried along."""
        return joined_ties([self.ties, self.carried])

    @cached_property
    def triangles(self) -> BoolArray:
        """Which triangles (F,) lie in any zone."""
        mask = np.zeros(len(self.part_of), dtype=bool)
        mask[self.zones // max(self.count, 1)] = True
        return mask

    def wholly_in_zones(self, faces: IntArray, count: int) -> BoolArray:
        """Return the vertices (V,) all of whose triangles lie in zones: buried by design, perhaps.

        faces: the triangles (F, 3); count: the number V of vertices. All of what holds others as
        wholes is such: where the sheets of a buttoned coat said how deep they are, less came clean.
        """
        result = np.zeros(count, dtype=bool)
        within = self.triangles | np.isin(self.part_of, list(self.holders))
        result[faces[within]] = True
        result[faces[~within]] = False
        return result

    @cached_property
    def pairs_of_parts(self) -> list[tuple[int, int]]:
        """The pairs of parts (A, B), A < B, that are attached."""
        first = self.part_of[self.zones // max(self.count, 1)].astype(np.int64)
        other = self.zones % max(self.count, 1)
        keys = np.unique(np.minimum(first, other) * self.count + np.maximum(first, other))
        return [(int(key // self.count), int(key % self.count)) for key in keys]

    def modelled(self, pairs: NDArray[np.integer]) -> BoolArray:
        """Return which pairs (K, 2) of triangles are modelled contacts, (K,)."""
        result = np.zeros(len(pairs), dtype=bool)
        if len(self.zones) == 0:
            return result
        # Of others a triangle lies in no zone.
        own = np.flatnonzero(self.triangles[pairs].all(axis=1))
        first, second = pairs[own].T
        parts = self.part_of[pairs[own]].astype(np.int64)
        found = self._in_zones(first, parts[:, 1]) & self._in_zones(second, parts[:, 0])
        low, high = parts.min(axis=1), parts.max(axis=1)
        loose = np.flatnonzero(np.isin(low * self.count + high, self.by_third))
        found[loose] |= self._share_a_zone(first[loose], second[loose])
        result[own] = found
        return result

    def _share_a_zone(self, first: KeyArray, second: KeyArray) -> BoolArray:
        """Return which of two triangles each (K,) have zones towards the same part."""
        if self.zone_bits is not None:
            return np.asarray((self.zone_bits[first] & self.zone_bits[second]).any(axis=1))
        both = self._zone_rows[first].multiply(self._zone_rows[second])
        return np.asarray(both.getnnz(axis=1) > 0)

    @cached_property
    def zone_bits(self) -> NDArray[np.uint64] | None:
        """The parts towards which each triangle has a zone, bit by bit (F, words).

        None where the parts are many, as strands of hair are: a matrix of their zones is small.
        """
        words = -(-self.count // 64)
        if words > MOST_WORDS:
            return None
        triangles, parts = np.divmod(self.zones, max(self.count, 1))
        bits = np.zeros((len(self.part_of), words), dtype=np.uint64)
        ones = np.uint64(1) << (parts % 64).astype(np.uint64)
        np.bitwise_or.at(bits, (triangles, parts // 64), ones)
        return bits

    @cached_property
    def _zone_rows(self) -> sparse.csr_matrix:
        """See `zone_rows`."""
        return zone_rows(self.zones, len(self.part_of), self.count)

    def of_triangles(self, kept: NDArray[np.integer], place: NDArray[np.integer]) -> Attachments:
        """Return the same for a mesh of some of the triangles (N,), ascending, numbered anew.

        place: The new number (V,) of each vertex.
        """
        number = np.full(len(self.part_of), -1, dtype=np.int64)
        number[kept] = np.arange(len(kept))
        triangle = number[self.zones // max(self.count, 1)]
        zones = (triangle * self.count + self.zones % max(self.count, 1))[triangle >= 0]
        ties, carried = (own.of_triangles(number, place) for own in (self.ties, self.carried))
        return self._of(self.part_of[kept], zones, ties, carried)

    def _of(self, part_of: IntArray, zones: KeyArray, ties: Ties, carried: Ties) -> Attachments:
        """Return others of the same parts."""
        known = self.by_third, self.sliding, self.holders
        result = Attachments(part_of, zones, ties, carried, *known)
        result.count = self.count
        return result

    def _in_zones(self, triangles: NDArray[np.integer], towards: NDArray[np.integer]) -> BoolArray:
        keys = triangles.astype(np.int64) * self.count + towards
        place = np.minimum(np.searchsorted(self.zones, keys), len(self.zones) - 1)
        return np.asarray(self.zones[place] == keys)


def no_attachments(part_of: IntArray) -> Attachments:
    """Return attachments of parts, given by the one (F,) of each triangle, that hold nothing."""
    return Attachments(part_of, np.zeros(0, dtype=np.int64), NO_TIES)
