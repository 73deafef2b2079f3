"""What the triangles alone tell of a mesh: edges, neighbours, masks, rings."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.device import Device
from dtrepair.intersect.topology.components import link_labels
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    adjacency,
    closed_parts,
    components,
    extent,
    lengths,
    pair_keys,
    shared_edges,
    unique_edges,
)

BoolArray = NDArray[np.bool_]
# Finer edges count as so many times finer than usual ones: searches of rings grow with the square.
FINEST = 4.0


class Topology:
    """Adjacency of a mesh; nothing of it changes.

    Args:
        faces: Triangles (F, 3).
        count: Number of vertices V.
        links: Positive (V, V) where vertices are neighbours besides those that share an edge;
            `linked` holds both, (N, 2).
        device: Where kernels work on the mesh; default: the CPU.
    """

    def __init__(
        self,
        faces: IntArray,
        count: int,
        *,
        links: sparse.csr_matrix | None = None,
        device: Device | None = None,
    ) -> None:
        self.faces, self.count = faces, count
        self.device = device or Device()
        self.edges = unique_edges(faces)
        self.indptr, self.indices = adjacency(faces, count)
        self.neighbours = sparse.csr_matrix(
            (np.ones(len(self.indices), dtype=np.float32), self.indices, self.indptr),
            shape=(count, count),
        )
        self.linked = self.edges
        self.fineness = 1.0
        if links is not None:
            tied = np.stack(links.nonzero(), axis=1)
            self.linked = np.concatenate([self.edges, tied], dtype=np.int32)
            self.neighbours = (self.neighbours + links > 0).astype(np.float32).tocsr()

    @cached_property
    def part_of_vertex(self) -> IntArray:
        """The part (V,) of each vertex: what edges or links connect."""
        return link_labels(self.linked, self.count)

    @cached_property
    def shell_of_vertex(self) -> IntArray:
        """The shell (V,) of each vertex: what edges connect, without links."""
        return link_labels(self.edges, self.count)

    @cached_property
    def edge_pairs(self) -> NDArray[np.int64]:
        """Pairs (H, 2) of triangles that share an edge."""
        return shared_edges(self.faces)

    @cached_property
    def edge_keys(self) -> NDArray[np.int64]:
        """One number (E,) for each edge, as `pair_keys`, ascending."""
        return pair_keys(self.edges)

    @cached_property
    def _ends(self) -> NDArray[np.intp]:
        """The ends (2, E) of the edges, side by side: masks are looked up ten times as fast."""
        return np.ascontiguousarray(self.edges.T, dtype=np.intp)

    @cached_property
    def _corners(self) -> NDArray[np.intp]:
        """The corners (3, F) of the triangles, side by side."""
        return np.ascontiguousarray(self.faces.T, dtype=np.intp)

    @cached_property
    def incidence(self) -> sparse.csr_matrix:
        """(V, F) with 1 where a triangle has a vertex."""
        return vertex_triangles(self.faces, self.count)

    @cached_property
    def sheets(self) -> BoolArray:
        """Which triangles (F,) are of connected parts that are not closed."""
        part = components(self.faces, self.count)[self.faces[:, 0]]
        return ~closed_parts(self.faces, part, self.count)[part]

    def vertices_of(self, triangles: NDArray[np.integer]) -> BoolArray:
        """Return the mask (V,) of the corners of triangles given by index, any shape."""
        mask = np.zeros(self.count, dtype=bool)
        mask[self.faces[np.asarray(triangles).ravel()]] = True
        return mask

    def triangles_at(self, vertices: BoolArray) -> BoolArray:
        """Return the mask (F,) of the triangles with a corner in a vertex mask (V,)."""
        a, b, c = self._corners
        touched: BoolArray = vertices.take(a) | vertices.take(b) | vertices.take(c)
        return touched

    def edges_within(self, mask: BoolArray) -> IntArray:
        """Return the edges (N, 2) of which both ends are in a vertex mask (V,)."""
        first, second = self._ends
        within: IntArray = self.edges[mask.take(first) & mask.take(second)]
        return within

    def dilate(self, mask: BoolArray, rings: int = 1) -> BoolArray:
        """Return a vertex mask (V,) grown by rings of edges."""
        grown = mask
        for _ in range(rings):
            grown = grown | (self.neighbours @ grown.astype(np.float32) > 0)
        return grown

    def rings_from(self, mask: BoolArray, limit: int) -> IntArray:
        """Return the edge rings from each vertex (V,) to a vertex mask, at most `limit`."""
        distance = np.where(mask, 0, limit).astype(np.int32)
        grown = mask
        for ring in range(1, limit):
            wider = self.dilate(grown)
            distance[wider & ~grown] = ring
            grown = wider
        return distance

    def set_fineness(self, rest: FloatArray, moving: BoolArray, usual: float) -> None:
        """Tell a rest (V, 3), what moves of it (V,), and for which edges rings are meant.

        usual: their mean length, over the largest coordinate range of what moves. What has several
        parts is taken as usual: rings mean something else to each of them.
        """
        part = self.part_of_vertex[self.faces[moving[self.faces[:, 0]], 0]]
        if not len(part) or np.bincount(part).max() <= 0.9 * len(part):
            return
        first, second = self.edges[moving[self.edges[:, 0]]].T
        length = float(lengths(rest[first] - rest[second]).mean())
        if length > 0.0:
            self.fineness = min(max(usual * extent(rest[moving]) / length, 1.0), FINEST)

    def rings(self, usual: int) -> int:
        """Return how many rings reach as far as so many of a mesh with edges of usual length."""
        return round(usual * self.fineness)

    def components(self, mask: BoolArray) -> IntArray:
        """Return the component (V,) that each vertex of a mask is in; others stand alone."""
        return link_labels(self.edges_within(mask), self.count, device=self.device)


def vertex_triangles(faces: IntArray, count: int) -> sparse.csr_matrix:
    """Return the matrix (V, F) with 1 where a triangle (F, 3) has a vertex."""
    columns = np.repeat(np.arange(len(faces)), 3)
    entries = (np.ones(3 * len(faces)), (faces.ravel(), columns))
    return sparse.csr_matrix(entries, shape=(count, len(faces)))
