"""Volumes of the pieces of a surface: of closed parts, and of the limbs that these are made of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.diagnosis import StrainKind
from dtrepair.intersect.topology.components import link_labels
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    cross,
    dots,
    lengths,
    shared_edges,
    vector_areas,
)
from dtrepair.numerics.recent import Recent
from dtrepair.numerics.scale import WHOLE, Scale
from dtrepair.repair.strain.parts import ConnectedParts

Places = NDArray[np.integer]


@dataclass(frozen=True, kw_only=True)
class LimbOptions:
    """What is taken as a piece of a limb; lengths are fractions of the diagonal of the rest.

    Args:
        length: Distance along the surface over which a piece reaches: fingers have pieces of their
            own, trunks have slices.
        edges: Or so many times the mean edge of the part, if that is more: a ring of a coarse mesh
            has no shape of its own.
        phases: So many times everything is cut, each time a little farther along: what lies between
            two slices of one is within a slice of another.
        small: Pieces with less area than its square are slivers between slices.
        triangles: So are those with fewer triangles.
        span: So are those that span less of the length, as the ends of limbs.
        flat: A piece of less volume, over its capped area to the power 3/2, has no thickness of
            its own: a saddle, or half a chest. A tube as long as its radius has 0.07.
        holes: A part whose rims span at most this share of its area is a skin: sockets of eyes,
            and a neck that ends in a collar. Garments span more, and may be pressed flat.
    """

    length: float = 0.05
    edges: float = 0.0
    phases: int = 1
    small: float = 0.02
    triangles: int = 24
    span: float = 0.0
    flat: float = 0.03
    holes: float = 0.05


# A wire is shorter than a usual piece, and hides where two of these meet.
SHORT = LimbOptions(length=0.03, edges=3.0, phases=3, span=0.5)


class Pieces:
    """Pieces of a surface, each closed by fans across its rims.

    Args:
        faces: Triangles (F, 3).
        piece: The piece (F,) of each triangle, negative for none.
        flat: A piece of less volume, over its area to the power 3/2, has none to keep.
    """

    def __init__(self, faces: IntArray, piece: Places, flat: float) -> None:
        self.chosen = np.flatnonzero(piece >= 0)
        self.faces, self.piece, self.flat = faces[self.chosen], piece[self.chosen], flat
        self.count = int(self.piece.max(initial=-1)) + 1
        ends = self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
        owner = np.repeat(self.piece.astype(np.int64), 3)
        # Sides that no triangle of the same piece runs through the other way.
        vertices = int(ends.max(initial=-1)) + 1
        there, back = ((owner * vertices + ends[:, a]) * vertices + ends[:, 1 - a] for a in (0, 1))
        open_side = ~np.isin(there, back)
        self._sides, self._owner = ends[open_side], owner[open_side]
        nodes = (self._owner[:, None] * vertices + self._sides).ravel()
        number = np.unique(nodes, return_inverse=True)[1].reshape(-1, 2).astype(np.int32)
        self._rim = link_labels(number, int(number.max(initial=-1)) + 1)[number[:, 0]]

    def vertices(self, piece: int) -> IntArray:
        """Return the vertices (N,) of a piece, sorted."""
        return np.unique(self.faces[self.piece == piece]).astype(np.int32)

    def changes(
        self,
        before: tuple[FloatArray, FloatArray],
        after: tuple[FloatArray, FloatArray],
        thicker: FloatArray,
    ) -> FloatArray:
        """Return by how much of itself the volume (P,) of each piece changed, 0 where it has none.

        before, after: `measures` of both poses. What did not get thicker, volume over area, by more
        than this share (P,) has not grown; -1: all has.
        """
        (had, area), (has, wide) = before, after
        solid = np.abs(had) > self.flat * area**1.5
        ratio = np.where(solid, has / np.where(solid, had, 1.0), 1.0)
        swollen = ratio * area > (1.0 + thicker) * wide
        return np.where((ratio < 1.0) | swollen, np.abs(ratio - 1.0), 0.0)

    def measures(self, points: FloatArray, areas: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return volume and area (P,) of each piece with its fans; areas (F, 3) of triangles."""
        own = areas.take(self.chosen, axis=0)
        heights = dots(points.take(self.faces[:, 0], axis=0), own)
        volume, area = (self._sums(self.piece, values) for values in (heights, lengths(own)))
        if len(self._sides):
            start, end = (points.take(side, axis=0) for side in self._sides.T)
            sums = [np.bincount(self._rim, column) for column in start.T]
            middle = (np.stack(sums, axis=1) / np.bincount(self._rim)[:, None])[self._rim]
            fans = 0.5 * cross(end - middle, start - middle)
            volume += self._sums(self._owner, dots(middle, fans))
            area += self._sums(self._owner, lengths(fans))
        return volume / 3.0, area

    def _sums(self, piece: Places, values: FloatArray) -> FloatArray:
        """Return the sum (P,) of the values (N,) of each piece."""
        return np.asarray(np.bincount(piece, values, self.count), dtype=np.float64)


def limbs(
    parts: ConnectedParts, rest: FloatArray, *each: LimbOptions, scale: Scale = WHOLE
) -> list[tuple[Pieces, ...]]:
    """Return for each of the options the pieces of limbs of all skins, cut in each phase.

    A piece lies between two distances to an end: they run along the edges of the rest (V, 3), from
    that vertex of each part that is farthest from its middle. A slice of them has a piece for each
    limb that it cuts.
    """
    first, second = parts.edges.T
    length = lengths(rest[first] - rest[second]) + np.finfo(np.float32).tiny
    graph = sparse.csr_matrix((length, (first, second)), shape=(len(rest), len(rest)))
    away = csgraph.dijkstra(graph, directed=False, indices=_ends(parts, rest), min_only=True)
    mean = np.bincount(parts.of_edge, length, parts.count) / np.bincount(parts.of_edge)
    size = scale.diagonal(rest) or 1.0
    cut = _Cut(
        parts,
        sides=shared_edges(parts.faces),
        area=lengths(vector_areas(rest, parts.faces)),
        away=away[parts.faces].mean(axis=1),
        mean=mean,
        size=size,
        holes=holes_of(rest, parts.faces, parts.of_face),
    )
    return [tuple(cut.phases(own)) for own in each]


class _Cut(NamedTuple):
    """Skins along which limbs are cut: how far `away` each triangle (F,) is from their ends.

    sides: triangles (S, 2) that share an edge; area: of triangles (F,); mean: the mean edge of each
    part (P,); size: diagonal of the scene; holes: see `holes_of`, (P,).
    """

    parts: ConnectedParts
    sides: Places
    area: FloatArray
    away: FloatArray
    mean: FloatArray
    size: float
    holes: FloatArray

    def phases(self, options: LimbOptions) -> Iterator[Pieces]:
        """Yield the pieces of limbs, cut a little farther along each time."""
        parts, sides = self.parts, self.sides
        reach = np.maximum(options.length * self.size, options.edges * self.mean)
        along, skin = self.away / reach[parts.of_face], self.holes <= options.holes
        for phase in range(options.phases):
            slices = np.floor(along + phase / options.phases)
            same = slices[sides[:, 0]] == slices[sides[:, 1]]
            piece = link_labels(sides[same].astype(np.int32), len(parts.faces))
            whole = np.bincount(piece, self.area) >= (options.small * self.size) ** 2
            whole &= np.bincount(piece) >= options.triangles
            whole &= _spans(along, piece) >= options.span
            judged = whole[piece] & skin[parts.of_face]
            yield Pieces(parts.faces, np.where(judged, piece, -1), options.flat)


class Beyond(NamedTuple):
    """A piece (N,) of a part whose volume changed by more than its bound."""

    kind: StrainKind
    part: int
    vertices: IntArray
    change: float
    bound: float


class Solids:
    """What has a volume to keep: closed parts, and where the rest is known the limbs of skins.

    Args:
        parts: The parts.
        rest: The pose (V, 3) by which parts are cut into limbs; None: limbs are not judged.
        scale: What lengths are measured in.
        sheet: A closed part of less volume, over its area to the power 3/2, has none.
        thicker: Of what has grown, growth of the volume over the area; lumps swell however thin.
    """

    def __init__(
        self,
        parts: ConnectedParts,
        rest: FloatArray | None,
        *,
        scale: Scale,
        sheet: float,
        thicker: float,
    ) -> None:
        self.parts = parts
        closed = np.where(parts.closed[parts.of_face], parts.of_face, -1)
        self.closed = Pieces(parts.faces, closed, sheet)
        ways: list[tuple[Pieces, ...]] = [(), ()]
        if rest is not None:
            ways = limbs(parts, rest, LimbOptions(), SHORT, scale=scale)
        self.limbs, self.short = ways
        self._pieces = (self.closed, *self.limbs, *self.short)
        self._before = Recent[list[tuple[FloatArray, FloatArray]]]()
        lumps = np.where(parts.lumps[: self.closed.count], -1.0, thicker)
        same = np.full(1, thicker)
        self._thicker = [lumps, *(same for _ in (*self.limbs, *self.short))]

    def changes(
        self, before: FloatArray, after: FloatArray, old: FloatArray, new: FloatArray
    ) -> list[FloatArray]:
        """Return the changes (P,) of all pieces in a pose (V, 3); old, new: vector areas (F, 3)."""
        centre = before.mean(axis=0)
        # Corrections of one input are measured in turn.
        had = self._before(lambda points: self._measures(points - centre, old), before)
        has = self._measures(after - centre, new)
        return [
            pieces.changes(first, second, thicker)
            for pieces, first, second, thicker in zip(
                self._pieces, had, has, self._thicker, strict=True
            )
        ]

    def _measures(
        self, points: FloatArray, areas: FloatArray
    ) -> list[tuple[FloatArray, FloatArray]]:
        """Return the measures of all pieces in a pose (V, 3)."""
        return [pieces.measures(points, areas) for pieces in self._pieces]

    def beyond(
        self, changes: Sequence[FloatArray], *, volume: float, limb: float, wire: float
    ) -> list[Beyond]:
        """Return what changed by more than closed parts, limbs and short pieces of limbs may.

        Of short pieces the worst of a part of which no other volume is told.
        """
        result = self._beyond(StrainKind.VOLUME, self.closed, changes[0], volume)
        rest = iter(changes[1:])
        for pieces in self.limbs:
            result += self._beyond(StrainKind.LIMB, pieces, next(rest), limb)
        told, worst = {own.part for own in result}, dict[int, Beyond]()
        for pieces in self.short:
            for own in self._beyond(StrainKind.LIMB, pieces, next(rest), wire):
                if own.part not in told:
                    known = worst.setdefault(own.part, own)
                    worst[own.part] = max(known, own, key=lambda other: other.change)
        return [*result, *worst.values()]

    def _beyond(
        self, kind: StrainKind, pieces: Pieces, change: FloatArray, bound: float
    ) -> list[Beyond]:
        """Return the pieces that changed by more than their bound."""
        result = []
        for index in np.flatnonzero(change > bound):
            own = pieces.vertices(int(index))
            part = int(self.parts.of_vertex[own[0]])
            result.append(Beyond(kind, part, own, float(change[index]), bound))
        return result


def holes_of(points: FloatArray, faces: IntArray, piece: Places) -> FloatArray:
    """Return what share of its area (P,) the rims of each piece span, in a pose (V, 3).

    piece: the number (F,) of the piece of each triangle (F, 3).
    """
    areas = vector_areas(points, faces)
    own = np.bincount(piece, lengths(areas))
    capped = Pieces(faces, piece, 0.0).measures(points, areas)[1]
    return np.asarray(capped / np.maximum(own, np.finfo(np.float64).tiny) - 1.0)


def _spans(values: FloatArray, piece: Places) -> FloatArray:
    """Return the difference (P,) of the largest and the least value (F,) of each piece."""
    order = np.argsort(piece, kind="stable")
    starts = np.flatnonzero(np.diff(piece[order], prepend=-1))
    most = np.maximum.reduceat(values[order], starts)
    return np.asarray(most - np.minimum.reduceat(values[order], starts))


def _ends(parts: ConnectedParts, rest: FloatArray) -> IntArray:
    """Return the vertex (P,) of each part that is farthest from the mean of its vertices."""
    used = np.flatnonzero(parts.of_vertex >= 0)
    own = parts.of_vertex[used]
    sums = [np.bincount(own, column) for column in rest[used].T]
    middle = np.stack(sums, axis=1) / np.bincount(own)[:, None]
    order = np.lexsort((lengths(rest[used] - middle[own]), own))
    last = np.flatnonzero(np.diff(own[order], append=parts.count))
    return used[order[last]].astype(np.int32)
