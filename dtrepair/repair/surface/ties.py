"""Ties of attached parts in the operators of a surface: one part carries the other along.

A vertex tied to a triangle is joined to its three corners by edges of the barycentric weights. Such
edges stand in the Laplacian of diffusion and of the as-rigid-as-possible system; where a patch is
replaced, the offset from the triangle to the vertex is held (T'T with a row e_a - sum w e_b for
each tie), and turns with the triangle: an elbow under a sleeve is replaced with it, and lies under
it again. Bodies that ties connect form a cluster, which is diffused with one factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.numerics.attachments import Attachments, Ties
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    components,
    extent,
    extents,
    lengths,
    triangle_frames,
    vector_areas,
)
from dtrepair.repair.surface.topology import vertex_triangles


@dataclass(frozen=True, kw_only=True)
class TieOptions:
    """How strongly ties hold.

    Args:
        weight: Weight of a tie's edges next to cotangent weights. With a weight of 1 both sides of
            a contact hang on one host so strongly that corrections spread over the whole character.
        hold: Weight of a kept offset in fills and fairing, times `weight`.
        far: What is tied from farther than this fraction of the size, or slid by more, keeps in a
            fill the offset that it has; all else gets that which was modelled.
        grown: Where triangles are larger or smaller than at rest by more than this fraction, in the
            median, what was modelled grew with them.
        turns: So many times a fill turns the offsets with the triangles that it replaces.
        creased: What edges connect shares creases with what it is tied to where both are at least
            this fraction of all that is tied: no fill has room for a whole pouch. With 0 all parts
            share them, with infinity none.
    """

    weight: float = 0.1
    hold: float = 20.0
    far: float = 0.1
    grown: float = 0.25
    turns: int = 2
    creased: float = 0.15


class Partners:
    """Which triangle of another shell a triangle is tied to: an arm's in the sleeve around it.

    A crease of the one is the other's as well: pushed apart, an elbow would leave its sleeve. Where
    a triangle has several ties to a shell, the shortest tells.

    Args:
        ties: The ties.
        faces: The triangles (F, 3) of the mesh.
        rest: Its rest (V, 3).
        least: Of shells, what edges connect, smaller than this fraction of all that is tied
            nothing is told.
    """

    def __init__(self, ties: Ties, faces: IntArray, rest: FloatArray, least: float) -> None:
        shell_of_vertex = components(faces, len(rest))
        self._shell = shell_of_vertex[faces[:, 0]].astype(np.int64)
        self._shells = int(shell_of_vertex.max(initial=-1)) + 1
        # Of a tie both sides know each other: each triangle at its vertex, and its triangle.
        at = vertex_triangles(faces, len(rest))[ties.vertices].tocoo()
        first, second = at.col.astype(np.int64), ties.triangles[at.row].astype(np.int64)
        sides = np.stack([self._shell[first], self._shell[second]], axis=1)
        tied = extent(rest[np.isin(shell_of_vertex, sides)])
        large = extents(rest, shell_of_vertex) >= least * max(tied, np.finfo(float).tiny)
        own = large[sides].all(axis=1) & (sides[:, 0] != sides[:, 1])
        both = np.stack([first[own], second[own]])
        known, other = np.concatenate([both, both[::-1]], axis=1)
        keys = self._key(known, other)
        order = np.lexsort((np.tile(lengths(ties.offsets)[at.row[own]], 2), keys))
        self._keys, place = np.unique(keys[order], return_index=True)
        self._triangles = other[order[place]]

    def of(self, triangles: IntArray, others: IntArray) -> IntArray:
        """Return what triangles (K,) are tied to on the shells of others (K,), -1 for nothing."""
        if len(self._keys) == 0:
            return np.full(len(triangles), -1, dtype=np.int32)
        keys = self._key(triangles, others)
        place = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1)
        found = np.where(self._keys[place] == keys, self._triangles[place], -1)
        return found.astype(np.int32)

    def _key(
        self, triangles: NDArray[np.integer], others: NDArray[np.integer]
    ) -> NDArray[np.int64]:
        """Return one number (K,) for each triangle and the shell of another one."""
        return np.asarray(triangles.astype(np.int64) * self._shells + self._shell[others])


@dataclass(frozen=True, eq=False)
class TieSystem:
    """What ties add to a surface.

    laplacian: (V, V), added to the cotangent Laplacian; links: (V, V), positive where a tie joins
    two vertices; offsets: (V, V), T'T times the weight of kept offsets; rows: T (N, V); ties: what
    they were made of, offsets in units of the size; corners: of their triangles (N, 3), and the
    areas (N,) of these at rest; partners: which triangles they join.
    """

    laplacian: sparse.csr_matrix
    links: sparse.csr_matrix
    offsets: sparse.csr_matrix
    rows: sparse.csr_matrix
    ties: Ties
    corners: IntArray
    areas: FloatArray
    partners: Partners
    options: TieOptions


class KeptOffsets:
    """The offsets of ties at a patch, for a system that replaces it.

    Args:
        system: The ties of the surface.
        inner: The vertices (M,) that are replaced.
        points: The pose (V, 3) before.
    """

    def __init__(self, system: TieSystem, inner: NDArray[np.intp], points: FloatArray) -> None:
        options = system.options
        mask = np.zeros(len(points), dtype=bool)
        mask[inner] = True
        own = mask[system.ties.vertices] | mask[system.corners].any(axis=1)
        corners = system.corners[own]
        rows = system.rows[np.flatnonzero(own)]
        frames, self._before = triangle_frames(points[corners]), rows @ points
        sizes = np.sqrt(lengths(vector_areas(points, corners)) / system.areas[own])
        size = float(np.median(sizes)) if len(sizes) else 1.0
        same = abs(np.log(max(size, 1e-30))) < np.log1p(options.grown)
        modelled = (1.0 if same else size) * system.ties.offsets[own]
        slid = np.einsum("nji,nj->ni", frames, self._before) - modelled
        far = np.maximum(lengths(slid), lengths(modelled)) > options.far
        flat = (frames == 0.0).all(axis=1).any(axis=1)
        self._turned = ~far & ~flat
        self._corners, self._modelled = corners[self._turned], modelled[self._turned]
        # So many times offsets are turned with what is replaced, where any turns.
        self.turns = options.turns if self._turned.any() else 0
        self._fixed = rows @ np.where(mask[:, None], 0.0, points)
        self._pull = options.hold * options.weight * rows[:, inner].T
        # What is added to the system (M, M).
        self.matrix = system.offsets[inner][:, inner]

    def right_hand_side(self, points: FloatArray | None) -> FloatArray:
        """Return what is added (M, 3) for offsets that turn with a pose (V, 3); None: as before."""
        wanted = self._before
        if points is not None:
            frames, wanted = triangle_frames(points[self._corners]), wanted.copy()
            wanted[self._turned] = np.einsum("nij,nj->ni", frames, self._modelled)
        return np.asarray(self._pull @ (wanted - self._fixed))


def tie_system(
    attachments: Attachments,
    faces: IntArray,
    rest: FloatArray,
    size: float,
    *,
    options: TieOptions = TieOptions(),
) -> TieSystem | None:
    """The ties of attachments on a mesh with triangles (F, 3) and a rest (V, 3), if any.

    rest: in units of the size, which is that of the surface in the unit of the ties.
    """
    count = len(rest)
    ties = attachments.every_tie
    vertices, triangles, weights, _ = ties
    number = len(vertices)
    if number == 0 or options.weight == 0.0:
        return None
    rows, columns = np.repeat(vertices, 3), faces[triangles].ravel()
    entries = options.weight * weights.ravel()
    half = sparse.coo_matrix((entries, (rows, columns)), shape=(count, count))
    links = (half + half.T).tocsr()
    links.eliminate_zeros()
    laplacian = (sparse.diags(np.asarray(links.sum(axis=1)).ravel()) - links).tocsr()
    each = np.arange(number)
    offset = sparse.csr_matrix(
        (
            np.concatenate([np.ones(number), -weights.ravel()]),
            (np.concatenate([each, np.repeat(each, 3)]), np.concatenate([vertices, columns])),
        ),
        shape=(number, count),
    )
    offsets = (options.hold * options.weight * (offset.T @ offset)).tocsr()
    scaled = ties._replace(offsets=ties.offsets / size)
    corners = faces[triangles]
    areas = np.maximum(lengths(vector_areas(rest, corners)), 1e-30)
    partners = Partners(ties, faces, rest, options.creased)
    return TieSystem(laplacian, links, offsets, offset, scaled, corners, areas, partners, options)
