"""Attachments: contacts that were modelled, and where two connected parts hold on to each other.

An arm ends inside a sleeve, a ball sits in its socket, an eye in its head: such parts overlap in
the bind pose on purpose. Around every such overlap each of the two parts has a zone. A pair of
triangles is a modelled contact where both lie in the zones of the same two parts, or, for parts
that are attached to one third part and not to each other, both in their zones towards that part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.closest_point import barycentric, nearest_triangles
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    components,
    dots,
    lengths,
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
            that bends slides by about that much. It is at least one edge of the mesh.
        whole: A part of which more than this share is in or behind a larger one is attached as a
            whole: eyes, teeth, buttons.
    """

    reach: float = 1.0
    whole: float = 0.5


class Reference(NamedTuple):
    """A pose that shows modelled contacts: points (V, 3), and its intersecting pairs (K, 2).

    name: What messages call the pose. asked: whether the user calls these parts attached.
    """

    points: FloatArray
    pairs: IntArray
    name: str = ""
    asked: bool = False


class Ties(NamedTuple):
    """Vertices (N,), the triangle (N,) of another part that each rests on, weights (N, 3) there."""

    vertices: IntArray
    triangles: IntArray
    weights: FloatArray


class Attachments:
    """Which contacts were modelled, by triangles; nothing in it ever changes.

    Args:
        part_of: The connected part (F,) of each triangle.
        zones: Sorted keys, triangle x number of parts + other part, of the zones.
        ties: What holds the parts together.
    """

    def __init__(self, part_of: IntArray, zones: KeyArray, ties: Ties) -> None:
        self.part_of = part_of
        self.count = int(part_of.max(initial=-1)) + 1
        self.zones = zones
        self.ties = ties

    @cached_property
    def triangles(self) -> BoolArray:
        """Which triangles (F,) lie in any zone."""
        mask = np.zeros(len(self.part_of), dtype=bool)
        mask[self.zones // max(self.count, 1)] = True
        return mask

    @cached_property
    def pairs_of_parts(self) -> list[tuple[int, int]]:
        """The pairs of parts (A, B), A < B, that are attached."""
        first = self.part_of[self.zones // max(self.count, 1)].astype(np.int64)
        other = self.zones % max(self.count, 1)
        keys = np.unique(np.minimum(first, other) * self.count + np.maximum(first, other))
        return [(int(key // self.count), int(key % self.count)) for key in keys]

    @cached_property
    def _mates(self) -> dict[int, set[int]]:
        mates: dict[int, set[int]] = {}
        for first, second in self.pairs_of_parts:
            mates.setdefault(first, set()).add(second)
            mates.setdefault(second, set()).add(first)
        return mates

    def modelled(self, pairs: NDArray[np.integer]) -> BoolArray:
        """Return which pairs (K, 2) of triangles are modelled contacts, (K,)."""
        result = np.zeros(len(pairs), dtype=bool)
        if len(self.zones) == 0 or len(pairs) == 0:
            return result
        parts = self.part_of[pairs]
        result |= self._in_zones(pairs[:, 0], parts[:, 1]) & self._in_zones(
            pairs[:, 1], parts[:, 0]
        )
        attached = np.array(self.pairs_of_parts, dtype=np.int64) @ [self.count, 1]
        low, high = parts.min(axis=1).astype(np.int64), parts.max(axis=1)
        loose = np.flatnonzero((low != high) & ~np.isin(low * self.count + high, attached))
        keys, place = np.unique(parts[loose], axis=0, return_inverse=True)
        place = place.reshape(-1)
        for index, (first, second) in enumerate(keys.tolist()):
            own = loose[place == index]
            for host in self._mates.get(first, set()) & self._mates.get(second, set()):
                towards = np.full(len(own), host)
                result[own] |= self._in_zones(pairs[own, 0], towards) & self._in_zones(
                    pairs[own, 1], towards
                )
        return result

    def of_triangles(self, kept: NDArray[np.integer], place: NDArray[np.integer]) -> Attachments:
        """Return the same for a mesh of some of the triangles (N,), ascending, numbered anew.

        place: The new number (V,) of each vertex.
        """
        number = np.full(len(self.part_of), -1, dtype=np.int64)
        number[kept] = np.arange(len(kept))
        triangle = number[self.zones // max(self.count, 1)]
        zones = (triangle * self.count + self.zones % max(self.count, 1))[triangle >= 0]
        vertices, triangles, weights = self.ties
        there = number[triangles].astype(np.int32)
        known = there >= 0
        ties = Ties(place[vertices[known]].astype(np.int32), there[known], weights[known])
        result = Attachments(self.part_of[kept], zones, ties)
        result.count = self.count
        return result

    def _in_zones(self, triangles: NDArray[np.integer], towards: NDArray[np.integer]) -> BoolArray:
        keys = triangles.astype(np.int64) * self.count + towards
        place = np.minimum(np.searchsorted(self.zones, keys), len(self.zones) - 1)
        return np.asarray(self.zones[place] == keys)


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
    ties = [Ties(np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros((0, 3)))]
    for reference in references:
        overlaps = _Overlaps(faces, part_of_vertex, part_of, reference, options)
        for first, second in overlaps.attached():
            for zone_keys, tie in overlaps.zones(first, second):
                keys.append(zone_keys)
                ties.append(tie)
    merged = Ties(*(np.concatenate(column) for column in zip(*ties, strict=True)))
    return Attachments(part_of, np.unique(np.concatenate(keys)), merged)


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
        self._own: dict[int, tuple[IntArray, IntArray]] = {}
        order = np.argsort(part_of_vertex, kind="stable").astype(np.int32)
        self._order = order
        self._starts = np.searchsorted(part_of_vertex[order], np.arange(self.parts + 1))
        self._face_order = np.argsort(part_of, kind="stable").astype(np.int32)
        self._face_starts = np.searchsorted(part_of[self._face_order], np.arange(self.parts + 1))

    @cached_property
    def normals(self) -> FloatArray:
        """Vector area (V, 3) of the triangles around each vertex."""
        areas = np.repeat(vector_areas(self.points, self.faces), 3, axis=0)
        flat = self.faces.ravel()
        columns = [np.bincount(flat, areas[:, k], len(self.points)) for k in range(3)]
        return np.stack(columns, axis=1)

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

    def zones(self, first: int, second: int) -> list[tuple[KeyArray, Ties]]:
        """Return the zone keys and ties of both parts of an attached pair."""
        own = self.pairs[self.key_of_pair == first * self.parts + second]
        seeds, whole = {}, False
        for part, other in ((first, second), (second, first)):
            seeds[part], encloses = self._seeds(part, other, own)
            whole |= encloses
        found = []
        for part, other in ((first, second), (second, first)):
            triangles = self.triangles(part)
            if not whole:
                zone = self._grown(seeds[part])
                triangles = triangles[zone[self.faces[triangles]].any(axis=1)]
            keys = triangles.astype(np.int64) * self.parts + other
            found.append((keys, self._ties(np.flatnonzero(seeds[part]), other)))
        return found

    def _seeds(self, part: int, other: int, pairs: IntArray) -> tuple[BoolArray, bool]:
        """Return seeds (V,) of a part towards another one, and whether it is all attached."""
        corners = self.faces[pairs.ravel()].ravel()
        mask = np.zeros(len(self.points), dtype=bool)
        mask[corners[self.part_of_vertex[corners] == part]] = True
        touched = np.flatnonzero(mask)
        mask[self._behind(part, other)] = True
        own = self.vertices(part)
        share = mask[own].mean()
        if share > self.options.whole and len(own) < len(self.vertices(other)):
            mask[own] = True
            return mask, True
        # What lies behind counts only if it is connected to the contact through what is behind:
        # a far shell does not.
        inner = np.flatnonzero(mask)
        label = csgraph.connected_components(self.graph[inner][:, inner], directed=False)[1]
        near = np.isin(label, np.unique(label[np.isin(inner, touched)]))
        mask[inner[~near]] = False
        return mask, False

    def _behind(self, part: int, other: int) -> IntArray:
        """Return the vertices of a part behind the surface of another one, within its box."""
        own, triangles = self.vertices(part), self.triangles(other)
        corners = self.points[self.faces[triangles]]
        low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        points = self.points[own]
        own = np.asarray(own[((points >= low) & (points <= high)).all(axis=1)])
        if len(own) == 0:
            return own
        points = self.points[own]
        nearest, closest = nearest_triangles(points, corners)
        weights = barycentric(closest, corners[nearest])
        normals = self.normals[self.faces[triangles[nearest]]]
        normal = np.einsum("ik,ikj->ij", weights, normals)
        return np.asarray(own[dots(points - closest, normal) < 0.0])

    def _grown(self, seeds: BoolArray) -> BoolArray:
        """Return the seeds (V,) grown over their part by the reach of each of their clusters."""
        zone = seeds.copy()
        inner = np.flatnonzero(seeds)
        label = csgraph.connected_components(self.graph[inner][:, inner], directed=False)[1]
        for cluster in range(label.max(initial=-1) + 1):
            own = inner[label == cluster]
            centred = self.points[own] - self.points[own].mean(axis=0)
            size = float(np.sqrt(dots(centred, centred).mean()))
            limit = max(self.options.reach * size, float(self.edge_length[own].mean()))
            distance = csgraph.dijkstra(self.graph, indices=own, min_only=True, limit=limit)
            zone |= np.isfinite(distance)
        return zone

    def _ties(self, seeds: NDArray[np.integer], other: int) -> Ties:
        """Return ties of each seed to the nearest triangle of another part."""
        triangles = self.triangles(other)
        corners = self.points[self.faces[triangles]]
        if len(seeds) == 0:
            return Ties(np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros((0, 3)))
        nearest, closest = nearest_triangles(self.points[seeds], corners)
        weights = barycentric(closest, corners[nearest])
        return Ties(seeds.astype(np.int32), triangles[nearest], weights)
