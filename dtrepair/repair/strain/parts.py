"""The connected parts of a mesh: edges, which are closed, what is tied to what."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.intersect.topology.components import link_labels
from dtrepair.numerics.attachments import Attachments
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    closed_parts,
    components,
    cross,
    lengths,
    shared_edges,
    unique_edges,
)

BoolArray = NDArray[np.bool_]
Places = NDArray[np.integer]


class ConnectedParts:
    """The connected parts of all bodies of a scene together; nothing of it changes.

    Args:
        faces: Triangles (F, 3), vertices at one position of the rest being one.
        body_of_vertex: The body (V,) of each vertex.
        attachments: What holds parts together, by these triangles; None where nothing does.
    """

    def __init__(
        self, faces: IntArray, body_of_vertex: IntArray, attachments: Attachments | None = None
    ) -> None:
        self._solid = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
        self.corners, self.faces = faces, faces[self._solid]
        self.vertices = len(body_of_vertex)
        self.edges = unique_edges(self.faces)
        label = components(self.faces, self.vertices)
        used, own = np.unique(label[self.faces[:, 0]], return_inverse=True)
        self.of_face = own.reshape(-1)
        self.count = len(used)
        self.of_vertex = np.full(self.vertices, -1, dtype=np.int64)
        self.of_vertex[self.faces] = self.of_face[:, None]
        self.of_edge = self.of_vertex[self.edges[:, 0]]
        self.body = np.zeros(self.count, dtype=np.int64)
        self.body[self.of_face] = body_of_vertex[self.faces[:, 0]]
        self.ties = None
        if attachments is not None and attachments.tied:
            self.ties = attachments.ties
            host = self.of_vertex[faces[self.ties.triangles, 0]]
            sides = np.sort(np.stack([self.of_vertex[self.ties.vertices], host]), axis=0)
            # Ties between the same two parts are a joint, one number (N,) each.
            self.joint = sides[0] * self.count + sides[1]

    @cached_property
    def tie_patches(self) -> IntArray:
        """The patch (N,) of each tie: of one joint and part, at vertices that edges connect."""
        assert self.ties is not None
        vertex = self.ties.vertices
        side = self.joint * self.count + self.of_vertex[vertex]
        number = np.unique(side, return_inverse=True)[1].reshape(-1)
        keys = number * self.vertices + vertex
        order = np.argsort(keys, kind="stable")
        again = np.flatnonzero(np.diff(keys[order]) == 0)
        twice = np.stack([order[again], order[again + 1]], axis=1)
        # Of each edge the ties at its first end, and where there is one, that at its second end.
        first, second = self.edges.T
        by_vertex = np.argsort(vertex, kind="stable")
        start = np.searchsorted(vertex[by_vertex], first)
        stop = np.searchsorted(vertex[by_vertex], first, side="right")
        edge = np.repeat(np.arange(len(first)), stop - start)
        place = np.arange(len(edge)) - np.repeat(np.cumsum(stop - start) - stop, stop - start)
        tie = by_vertex[place]
        sought = number[tie] * self.vertices + second[edge]
        found = np.minimum(np.searchsorted(keys[order], sought), len(keys) - 1)
        there = keys[order][found] == sought
        links = np.stack([tie[there], order[found[there]]], axis=1)
        return link_labels(np.concatenate([twice, links]).astype(np.int32), len(keys))

    @cached_property
    def lumps(self) -> BoolArray:
        """Which parts (P,) are attached, closed and without a hole: Euler characteristic 2."""
        attached = np.zeros(self.count, dtype=bool)
        if self.ties is not None:
            ends = self.of_vertex[np.append(self.ties.vertices, self.corners[self.ties.triangles])]
            attached[ends[ends >= 0]] = True
        used = self.of_vertex[self.of_vertex >= 0]
        numbers = [np.bincount(own, minlength=self.count) for own in (used, self.of_edge)]
        euler = numbers[0] - numbers[1] + np.bincount(self.of_face, minlength=self.count)
        return np.asarray(attached & self.closed & (euler == 2))

    @cached_property
    def closed(self) -> BoolArray:
        """Which parts (P,) have every edge run through as often one way as the other."""
        return closed_parts(self.faces, self.of_face, self.count)

    @cached_property
    def _sides(self) -> IntArray:
        """The pairs (H, 2) of triangles that share an edge."""
        return shared_edges(self.faces).astype(np.int32)

    @cached_property
    def links(self) -> IntArray:
        """The edges, and three more for each tie: to the corners that it rests on (L, 2)."""
        if self.ties is None:
            return self.edges
        hosts = self.corners[self.ties.triangles].ravel()
        tied = np.stack([np.repeat(self.ties.vertices, 3), hosts], axis=1)
        return np.concatenate([self.edges, tied.astype(np.int32)])

    def crossed(self, pairs: IntArray) -> IntArray:
        """Return the triangles (N,) of these that meet others of their own part.

        pairs: intersecting pairs (K, 2) of the faces that were given, triangles without area too.
        """
        number = np.cumsum(self._solid) - 1
        own = number[pairs[self._solid[pairs].all(axis=1)]]
        part = self.of_face[own]
        return np.unique(own[part[:, 0] == part[:, 1]])

    def grown(self, mask: BoolArray, rings: int) -> BoolArray:
        """Return a mask (V,) grown by rings of edges and ties."""
        result, (first, second) = mask.copy(), self.links.T
        for _ in range(rings):
            result[self.links[result[first] | result[second]]] = True
        return result

    def number_of(self, part: int) -> tuple[int, int]:
        """Return which part of its body a part is, and how many the body has.

        1 is the part with most triangles, of equal ones that with the first vertex.
        """
        own = np.flatnonzero(self.body == self.body[part])
        sizes = np.bincount(self.of_face, minlength=self.count)[own]
        ordered = own[np.argsort(-sizes, kind="stable")]
        return int(np.flatnonzero(ordered == part)[0]) + 1, len(own)

    def patches(self, triangles: Places) -> IntArray:
        """Return the patch (N,) of each of some triangles: connected by edges they are one."""
        mask = np.zeros(len(self.faces), dtype=bool)
        mask[triangles] = True
        first, second = self._sides.T
        joined = self._sides[mask[first] & mask[second]]
        return np.asarray(link_labels(joined, len(self.faces))[triangles])

    def rim(self, triangles: Places) -> IntArray:
        """Return the pairs (H, 2) of triangles with an edge between one of some and another."""
        mask = np.zeros(len(self.faces), dtype=bool)
        mask[triangles] = True
        inside = mask[self._sides]
        return np.asarray(self._sides[inside[:, 0] != inside[:, 1]])

    def tie_offsets(self, points: FloatArray) -> FloatArray:
        """Return the offset (N, 2, 3) of each tied vertex from its point on the other part.

        In the axes of the world, and in those of the triangle that it rests on.
        """
        assert self.ties is not None
        corners = points.take(self._hosts, axis=0)
        host = np.einsum("ik,ikj->ij", self.ties.weights, corners)
        offsets = points.take(self.ties.vertices, axis=0) - host
        local = np.einsum("nij,nj->ni", _axes(corners), offsets)
        return np.stack([offsets, local], axis=1)

    @cached_property
    def _hosts(self) -> IntArray:
        """The corners (N, 3) of the triangle that each tied vertex rests on."""
        assert self.ties is not None
        return self.corners[self.ties.triangles]

    def distances(self, points: FloatArray) -> sparse.csr_matrix:
        """Return the lengths (V, V) of edges and ties in a pose (V, 3)."""
        first, second = self.links.T
        length = lengths(points[first] - points[second]) + np.finfo(np.float32).tiny
        ends = np.concatenate([first, second]), np.concatenate([second, first])
        # The same two vertices may be tied more than once; sums would be too long.
        keys = ends[0].astype(np.int64) * self.vertices + ends[1]
        once = np.unique(keys, return_index=True)[1]
        entries = np.tile(length, 2)[once], (ends[0][once], ends[1][once])
        return sparse.csr_matrix(entries, shape=(self.vertices, self.vertices))


def _axes(corners: FloatArray) -> FloatArray:
    """Return the axes (N, 3, 3), as rows, of triangles of corners (N, 3, 3)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = cross(first, second)
    axes = np.stack([first, cross(normal, first), normal], axis=1)
    length = np.linalg.norm(axes, axis=2, keepdims=True)
    # A triangle without area has no axes: nothing is seen from it.
    return np.asarray(np.divide(axes, length, out=np.full_like(axes, np.nan), where=length > 0))


def changes(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return how far (N,) tied vertices went, by their offsets (N, 2, 3).

    Seen from the world or from the triangle that each rests on, whichever is less: what swings
    together has not come apart.
    """
    world, local = np.moveaxis(after - before, 1, 0)
    return np.asarray(np.fmin(lengths(world), lengths(local)))
