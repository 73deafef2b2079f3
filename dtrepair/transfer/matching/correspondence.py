"""Which source triangles speak for a target triangle: matching, averaging, filling the holes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import FloatArray, IntArray, as_mesh, shared_edges, triangle_normals
from dtrepair.numerics.operators import Factor
from dtrepair.transfer.arrays import Array, like, to_numpy


def identity_pairs(faces: ArrayLike, other_faces: ArrayLike | None = None) -> IntArray:
    """Return pairs (F, 2) of every triangle with itself, for two meshes of one topology.

    Given both face arrays, raises ValueError when they differ.
    """
    triangles = to_numpy(faces)
    if other_faces is not None:
        others = to_numpy(other_faces)
        if triangles.shape != others.shape or not np.array_equal(triangles, others):
            raise ValueError(
                f"without markers both meshes should have the same triangles, got {len(triangles)} "
                f"and {len(others)}{' in another order' * (len(triangles) == len(others))}: "
                "give markers or a correspondence"
            )
    return np.repeat(np.arange(len(triangles), dtype=np.int32)[:, None], 2, axis=1)


def checked_pairs(pairs: ArrayLike, source_count: int, target_count: int) -> IntArray:
    """Return pairs (K, 2) int32 of (source triangle, target triangle), sorted, each once.

    Raises ValueError for a wrong shape, no pair at all and indices out of range.
    """
    rows = to_numpy(pairs)
    if rows.ndim != 2 or rows.shape[1] != 2 or not len(rows):
        raise ValueError(f"pairs should have shape (K, 2) with K > 0, got {rows.shape}")
    if not np.issubdtype(rows.dtype, np.integer):
        raise ValueError(f"pairs should be integers, got {rows.dtype}")
    for column, (name, count) in enumerate((("source", source_count), ("target", target_count))):
        outside = (rows[:, column] < 0) | (rows[:, column] >= count)
        if outside.any():
            raise ValueError(
                f"pairs should hold {name} triangles 0..{count - 1}, got index "
                f"{rows[outside, column][0]} in row {np.flatnonzero(outside)[0]}: "
                "was the correspondence made for other meshes?"
            )
    keys = np.sort(rows[:, 0].astype(np.int64) * target_count + rows[:, 1])
    keys = keys[np.concatenate([[True], keys[1:] != keys[:-1]])]
    return np.stack([keys // target_count, keys % target_count], axis=1).astype(np.int32)


def match_triangles(
    registered: Array,
    source_faces: Array,
    target: Array,
    target_faces: Array,
    *,
    neighbors: int = 64,
    max_distance: float | None = None,
) -> Array:
    """Return pairs (K, 2) int32 of (source triangle, target triangle), sorted.

    Each triangle is paired with the triangle of the other mesh whose centroid is closest among
    its `neighbors` nearest with a normal within 90 degrees; both directions are united (Sumner &
    Popovic 2004, section 4.2). `registered` is the source rest deformed onto the target (Vs, 3),
    in target units, as is `max_distance`. Raises ValueError when nothing matches.
    """
    source_mesh = as_mesh(to_numpy(registered), to_numpy(source_faces))
    target_mesh = as_mesh(to_numpy(target), to_numpy(target_faces))
    if neighbors < 1:
        raise ValueError(f"neighbors should be at least 1, got {neighbors}")
    limit = np.inf if max_distance is None else float(max_distance)
    forward = _closest_compatible(source_mesh, target_mesh, neighbors, limit)
    backward = _closest_compatible(target_mesh, source_mesh, neighbors, limit)
    both = np.concatenate([forward, backward[:, ::-1]])
    if not len(both):
        raise ValueError(
            "no triangle of the source is near one of the target with a normal within 90 degrees: "
            "is the source registered onto the target, and are both wound outward?"
        )
    pairs = checked_pairs(both, len(source_mesh[1]), len(target_mesh[1]))
    return like(pairs, registered)


def _closest_compatible(
    queries: tuple[FloatArray, IntArray],
    others: tuple[FloatArray, IntArray],
    neighbors: int,
    limit: float,
) -> NDArray[np.int64]:
    """Return pairs (K, 2) of each query triangle with the closest compatible other one, if any."""
    if not len(queries[1]) or not len(others[1]):
        return np.zeros((0, 2), dtype=np.int64)
    centroids = queries[0][queries[1]].mean(axis=1)
    normals, other_normals = triangle_normals(*queries), triangle_normals(*others)
    tree = cKDTree(others[0][others[1]].mean(axis=1))
    found = np.full(len(centroids), -1, dtype=np.int64)
    pending, most = np.arange(len(centroids)), min(neighbors, len(other_normals))
    count = min(4, most)
    # Neighbours come sorted by distance, so the first compatible one is the closest: nearly all
    # queries are settled by four, and only the rest pays for more.
    while len(pending):
        nearest = tree.query(centroids[pending], np.arange(1, count + 1))
        facing = np.einsum("qnj,qj->qn", other_normals[nearest[1]], normals[pending]) > 0
        facing &= nearest[0] <= limit
        hit = facing.any(axis=1)
        found[pending[hit]] = nearest[1][hit, facing[hit].argmax(axis=1)]
        pending = pending[~hit]
        if count == most:
            break
        count = min(4 * count, most)
    matched = np.flatnonzero(found >= 0)
    return np.stack([matched, found[matched]], axis=1)


def averaging_operator(
    pairs: IntArray, usable: NDArray[np.bool_], target_count: int
) -> sparse.csr_matrix:
    """Return the mean (Ft, Fs) over the paired, usable source triangles of each target triangle.

    Rows of target triangles without a usable partner are empty. `usable` is a mask (Fs,).
    """
    kept = pairs[usable[pairs[:, 0]]]
    counts = np.bincount(kept[:, 1], minlength=target_count)
    weights = 1.0 / counts[kept[:, 1]]
    return sparse.coo_matrix(
        (weights, (kept[:, 1], kept[:, 0])), shape=(target_count, len(usable))
    ).tocsr()


class HarmonicFill:
    """Deformation gradients of the unmatched triangles from their matched neighbours.

    The values are harmonic over the dual graph of the target (triangles joined by shared edges);
    an unmatched piece that touches no matched triangle hangs on the nearest one and takes its
    value. The identity would stiffen limbs that rotate.
    """

    def __init__(self, target: FloatArray, faces: IntArray, matched: NDArray[np.bool_]) -> None:
        """`matched` is a mask (Ft,); ValueError when nothing is matched."""
        if not matched.any():
            raise ValueError(
                "no target triangle has a usable source triangle: check the correspondence"
            )
        self.unmatched = np.flatnonzero(~matched)
        self.matched = np.flatnonzero(matched)
        links = _linked(target, faces, matched)
        count = len(faces)
        graph = sparse.coo_matrix((np.ones(len(links)), links.T), shape=(count, count))
        graph = (graph + graph.T).tocsr()[self.unmatched]
        degree = sparse.diags(np.asarray(graph.sum(axis=1)).ravel())
        self._boundary = graph[:, self.matched]
        self._factor = Factor(degree - graph[:, self.unmatched])

    def __call__(self, values: FloatArray) -> FloatArray:
        """Return values (unmatched, k) from the values of the matched triangles (matched, k)."""
        return self._factor(self._boundary @ values)


def _linked(target: FloatArray, faces: IntArray, matched: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return dual edges (K, 2) of the fill.

    Pieces without a matched neighbour are linked to the nearest matched triangle.

    A cut-off piece of constant value needs one link only, from its closest triangle.
    """
    links = shared_edges(faces)
    links = links[~matched[links].all(axis=1)]
    count = len(faces)
    graph = sparse.coo_matrix((np.ones(len(links)), links.T), shape=(count, count))
    labels = csgraph.connected_components(graph, directed=False)[1]
    reached = np.zeros(labels.max() + 1, dtype=bool)
    reached[labels[matched]] = True
    stray = np.flatnonzero(~reached[labels])
    if not len(stray):
        return links
    centroids = target[faces].mean(axis=1)
    candidates = np.flatnonzero(matched)
    distances, nearest = cKDTree(centroids[candidates]).query(centroids[stray])
    order = np.lexsort((distances, labels[stray]))
    first = order[np.unique(labels[stray][order], return_index=True)[1]]
    bridges = np.stack([stray[first], candidates[nearest[first]]], axis=1)
    return np.concatenate([links, bridges])
