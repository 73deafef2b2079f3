"""Seams: where a skin is cut, within a mesh or into several, and its borders lie on each other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    border_edges,
    diagonal,
    lengths,
    pair_keys,
)

# Vertices are at one place up to this part of the diagonal of their mesh: what float32 may round.
WITHIN = 2e-6
# Vertices that are looked at beside each, itself among them.
NEAREST = 9


class Seams(NamedTuple):
    """Pairs (N, 2) of vertices that are one point of a skin, and how far apart (N,) that is."""

    vertices: IntArray
    within: FloatArray

    def across(self, owner: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Return which pairs (N,) are of two meshes, by the mesh (V,) of each vertex."""
        first, second = owner[self.vertices.T]
        return np.asarray(first != second)

    def chosen(self, kept: NDArray[np.bool_]) -> Seams:
        """Return those of the pairs (N,) that are kept."""
        return Seams(self.vertices[kept], self.within[kept])


NO_SEAMS = Seams(np.zeros((0, 2), dtype=np.int32), np.zeros(0))


def find_seams(points: FloatArray, faces: IntArray, owner: NDArray[np.integer]) -> Seams:
    """Return the seams of a skin that is cut, within a mesh or into several.

    Each edge of a border lies on one of another, which runs the other way: the skin goes on there.
    Shells that lie on each other end at one place too, but run the same way. A mesh that lies with
    every vertex on others has no seams with them: nothing of it would be left. Vertices of one mesh
    that only rounding keeps apart, as in a pole, are a seam wherever they are.

    Args:
        points: Positions (V, 3).
        faces: Triangles (F, 3), whose vertices at one position of a mesh are one.
        owner: The mesh (V,) of each vertex.
    """
    edges = faces.ravel()[border_edges(faces, len(points))]
    used, border = np.unique(faces), np.unique(edges)
    if len(used) == 0:
        return NO_SEAMS
    meshes = np.unique(owner[used])
    sizes = np.zeros(int(owner.max(initial=-1)) + 1)
    found = [NO_SEAMS]
    order = used[np.argsort(owner[used], kind="stable")]
    starts = np.searchsorted(owner[order], meshes)
    for mesh, own in zip(meshes.tolist(), np.split(order, starts[1:]), strict=True):
        sizes[mesh] = diagonal(points[own])
        pairs = _close_pairs(points, own, WITHIN * sizes[mesh])
        found.append(Seams(pairs, np.full(len(pairs), WITHIN * sizes[mesh])))
    if len(meshes) > 1:
        # Of two meshes the smaller one counts.
        pairs = _close_pairs(points, border, WITHIN * float(np.sort(sizes)[-2]))
        across = Seams(pairs, WITHIN * sizes[owner[pairs]].min(axis=1))
        apart = lengths(points[pairs[:, 0]] - points[pairs[:, 1]])
        found.append(across.chosen(across.across(owner) & (apart <= across.within)))
    close = Seams(*(np.concatenate(column) for column in zip(*found, strict=True)))
    return close.chosen(_goes_on(close, edges, faces, owner, len(points)))


def _goes_on(
    close: Seams, edges: IntArray, faces: IntArray, owner: NDArray[np.integer], count: int
) -> NDArray[np.bool_]:
    """Return which pairs (N,) are of one mesh, or where the skin goes on beyond a border.

    edges: those (E, 2) of borders, as they run; count: of vertices.
    """
    across = close.across(owner)
    first, second = _facing_edges(_labels(close.vertices, count)[edges])
    ends = np.concatenate([edges[first], edges[second][:, ::-1]], axis=1).reshape(-1, 2, 2)
    facing = np.sort(ends.transpose(0, 2, 1).reshape(-1, 2), axis=1).astype(np.int32)
    on = across & np.isin(pair_keys(close.vertices), pair_keys(facing))
    inner = np.setdiff1d(faces, close.vertices[on])
    on &= np.isin(owner[close.vertices], owner[inner]).all(axis=1)
    return np.asarray(on | ~across)


def _close_pairs(points: FloatArray, own: NDArray[np.integer], reach: float) -> IntArray:
    """Return pairs (N, 2) of some vertices within a reach, first < second, few of each.

    Of thousands at one place each has its nearest ones: enough to join them all.
    """
    if len(own) < 2:
        return np.zeros((0, 2), dtype=np.int32)
    tree, count = cKDTree(points[own]), min(NEAREST, len(own))
    place = tree.query(points[own], np.arange(1, count + 1), distance_upper_bound=reach)[1]
    rows, columns = np.nonzero(place < len(own))
    pairs = np.sort(own[np.stack([rows, place[rows, columns]], axis=1)], axis=1)
    pairs = np.unique(pairs[pairs[:, 0] < pairs[:, 1]], axis=0)
    return pairs.astype(np.int32)


def _facing_edges(edges: IntArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the numbers (N,), (N,) of directed edges (E, 2) that run against each other.

    Only where there are no others at their place: else nobody knows which go together.
    """
    there, back = pair_keys(edges), pair_keys(edges[:, ::-1])
    if len(edges) == 0:
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    keys, place, uses = np.unique(there, return_index=True, return_counts=True)
    found = np.minimum(np.searchsorted(keys, back), len(keys) - 1)
    alone = uses[np.searchsorted(keys, there)] == 1
    first = np.flatnonzero((keys[found] == back) & (uses[found] == 1) & alone)
    return first, place[found[first]]


def _labels(pairs: NDArray[np.integer], count: int) -> IntArray:
    """Return the least vertex (count,) that each is joined to by pairs (N, 2)."""
    graph = sparse.coo_matrix((np.ones(len(pairs)), tuple(pairs.T)), shape=(count, count))
    label = csgraph.connected_components(graph, directed=False)[1]
    first = np.full(int(label.max(initial=-1)) + 1, count, dtype=np.int32)
    np.minimum.at(first, label, np.arange(count, dtype=np.int32))
    return np.asarray(first[label])


def sewn(weld: IntArray, seams: Seams, points: FloatArray) -> IntArray:
    """Return the vertex (V,) that stands for each where seams that are closed are one.

    Args:
        weld: The vertex (V,) that stands for each within its own mesh.
        seams: What is one at rest.
        points: A pose (V, 3), in which some may be open.
    """
    if len(seams.vertices) == 0:
        return weld
    first, second = seams.vertices.T
    joined = lengths(points[first] - points[second]) <= seams.within
    return np.asarray(_labels(weld[seams.vertices[joined]], len(weld))[weld])
