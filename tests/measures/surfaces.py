"""Position-welded triangle surfaces: connected parts, edges, volumes, nearest points, winding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

# Point-triangle combinations that are looked at together: bounds the memory.
CHUNK = 500_000


@dataclass(frozen=True)
class Surface:
    """What does not change with the pose: welded topology and connected parts.

    Attributes:
        vertex_of: welded vertex of each input point (V,).
        point_of: an input point of each welded vertex (W,).
        faces: triangles in welded vertices (F, 3).
        edges: welded edges (E, 2), each once.
        part_of_vertex: part of each welded vertex (W,), -1 for a vertex of no triangle.
        part_of_face: part of each triangle (F,).
        closed: for each part (P,) whether its directed edges cancel, so that it bounds a volume.
    """

    vertex_of: Ints
    point_of: Ints
    faces: Ints
    edges: Ints
    part_of_vertex: Ints
    part_of_face: Ints
    closed: Mask

    @property
    def parts(self) -> int:
        """Number of connected parts."""
        return len(self.closed)

    def vertices(self, part: int) -> Ints:
        """Welded vertices of a part."""
        return np.flatnonzero(self.part_of_vertex == part)

    def triangles(self, part: int) -> Ints:
        """Triangles of a part."""
        return np.flatnonzero(self.part_of_face == part)

    def normals(self, points: Floats) -> Floats:
        """Unit normals (W, 3) of welded points (W, 3), triangles weighted by area."""
        a, b, c = (points[self.faces[:, k]] for k in range(3))
        total = np.zeros_like(points)
        for k in range(3):
            np.add.at(total, self.faces[:, k], np.cross(b - a, c - a))
        unit: Floats = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)
        return unit

    def graph(self, points: Floats) -> sparse.csr_array:
        """Edge lengths (W, W) of welded points (W, 3) as a symmetric sparse matrix."""
        first, second = self.edges.T
        length = np.linalg.norm(points[first] - points[second], axis=1)
        # A length of zero would be no edge.
        length = np.maximum(length, np.finfo(np.float64).tiny)
        ends = np.concatenate([first, second]), np.concatenate([second, first])
        ends = ends[0].astype(np.int32), ends[1].astype(np.int32)  # as scipy 1.13 wants them
        count = len(self.point_of)
        return sparse.csr_array((np.tile(length, 2), ends), shape=(count, count))


def make_surface(rest: Floats, faces: Ints, owner: Ints | None = None) -> Surface:
    """Weld points (V, 3) of one owner (V,) at one float32 position, and find the parts."""
    single = rest.astype(np.float32) + np.float32(0.0)
    keys = np.column_stack([single, np.zeros(len(single)) if owner is None else owner])
    _, point_of, vertex_of = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    vertex_of = vertex_of.reshape(-1).astype(np.int64)
    welded = vertex_of[faces]
    count = len(point_of)
    directed = np.concatenate([welded[:, [0, 1]], welded[:, [1, 2]], welded[:, [2, 0]]])
    edges = np.unique(np.sort(directed, axis=1), axis=0)
    edges = edges[edges[:, 0] < edges[:, 1]]
    link = sparse.coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), (count, count))
    label = csgraph.connected_components(link, directed=False)[1]
    _, first, of_face = np.unique(label[welded[:, 0]], return_index=True, return_inverse=True)
    # Parts are numbered by their first triangles.
    part_of_face = np.argsort(np.argsort(first))[of_face.reshape(-1)]
    part_of_vertex = np.full(count, -1, dtype=np.int64)
    part_of_vertex[welded] = part_of_face[:, None]
    return Surface(
        vertex_of=vertex_of,
        point_of=point_of.astype(np.int64),
        faces=welded,
        edges=edges,
        part_of_vertex=part_of_vertex,
        part_of_face=part_of_face,
        closed=_closed(directed, np.tile(part_of_face, 3), len(first)),
    )


def _closed(directed: Ints, part: Ints, parts: int) -> Mask:
    """Whether every edge of a part is run through as often one way as the other."""
    proper = directed[:, 0] != directed[:, 1]
    directed, part = directed[proper], part[proper]
    sign = np.where(directed[:, 0] < directed[:, 1], 1, -1)
    _, index = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True)
    index = index.reshape(-1)
    excess = np.bincount(index, sign)
    closed = np.ones(parts, dtype=bool)
    closed[part[excess[index] != 0]] = False
    return closed


def areas(points: Floats, faces: Ints) -> Floats:
    """Area of each triangle (F,)."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    result: Floats = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return result


def volumes(points: Floats, surface: Surface) -> Floats:
    """Signed volume of each part (P,) by the divergence theorem; NaN for a part that is open."""
    centred = points - points.mean(axis=0)
    a, b, c = (centred[surface.faces[:, k]] for k in range(3))
    sixth = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    total = np.bincount(surface.part_of_face, sixth, surface.parts)
    return np.where(surface.closed, total, np.nan)


def openings(points: Floats, surface: Surface) -> Floats:
    """Area of the openings of each part (P,) over its own area: 0 closed, 1 a flat sheet.

    An opening is a connected piece of boundary; its area is the length of its vector area.
    """
    directed = np.concatenate([surface.faces[:, [k, (k + 1) % 3]] for k in range(3)])
    keys = np.sort(directed, axis=1)
    _, index = np.unique(keys, axis=0, return_inverse=True)
    sign = np.where(directed[:, 0] < directed[:, 1], 1, -1)
    boundary = np.bincount(index.reshape(-1), sign)[index.reshape(-1)] != 0
    ends = directed[boundary]
    count = len(surface.point_of)
    link = sparse.coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (count, count))
    label = csgraph.connected_components(link, directed=False)[1]
    centred = points - points.mean(axis=0)
    swept = 0.5 * np.cross(centred[ends[:, 0]], centred[ends[:, 1]])
    vector = np.zeros((count, 3))
    np.add.at(vector, label[ends[:, 0]], swept)
    part = np.zeros(count, dtype=np.int64)
    part[label[ends[:, 0]]] = surface.part_of_vertex[ends[:, 0]]
    open_area = np.bincount(part, np.linalg.norm(vector, axis=1), surface.parts)
    own = np.bincount(surface.part_of_face, areas(points, surface.faces), surface.parts)
    return open_area / np.where(own > 0, own, 1.0)


def grown(surface: Surface, seeds: Ints, rings: int) -> Mask:
    """Welded vertices (W,) within so many edges of the seeds."""
    mask = np.zeros(len(surface.point_of), dtype=bool)
    mask[seeds] = True
    for _ in range(rings):
        touched = surface.edges[mask[surface.edges].any(axis=1)]
        mask[touched] = True
    return mask


def flooded(surface: Surface, start: Ints, test: Callable[[Ints], Mask]) -> Ints:
    """Vertices that pass the test and hang together with `start` through such; start is tested."""
    passed = np.zeros(len(surface.point_of), dtype=bool)
    known = passed.copy()
    front = np.unique(start)
    while len(front):
        known[front] = True
        front = front[test(front)]
        passed[front] = True
        fresh = np.zeros_like(known)
        fresh[front] = True
        fresh[surface.edges[fresh[surface.edges].any(axis=1)]] = True
        front = np.flatnonzero(fresh & ~known)
    return np.flatnonzero(passed)


def winding_numbers(queries: Floats, triangles: Floats) -> Floats:
    """Winding number of triangles (F, 3, 3) around each query (N, 3): 1 inside a closed part.

    The solid angles are those of van Oosterom & Strackee 1983, over 4 pi.
    """
    result = np.zeros(len(queries))
    step = max(CHUNK // max(len(triangles), 1), 1)
    for begin in range(0, len(queries), step):
        own = slice(begin, begin + step)
        a, b, c = (triangles[None, :, k] - queries[own, None] for k in range(3))
        la, lb, lc = (np.sqrt(np.einsum("nfk,nfk->nf", v, v)) for v in (a, b, c))
        triple = np.einsum("nfk,nfk->nf", a, np.cross(b, c))
        below = la * lb * lc
        for (u, v), length in zip(((a, b), (b, c), (c, a)), (lc, la, lb), strict=True):
            below += np.einsum("nfk,nfk->nf", u, v) * length
        result[own] = np.arctan2(triple, below).sum(axis=1) / (2.0 * np.pi)
    return result


def nearest_on_triangles(queries: Floats, triangles: Floats) -> tuple[Ints, Floats, Floats]:
    """Nearest of triangles (F, 3, 3), barycentric weights (N, 3) there, distance (N,)."""
    index = np.zeros(len(queries), dtype=np.int64)
    weights = np.zeros((len(queries), 3))
    best = np.full(len(queries), np.inf)
    if not len(queries) or not len(triangles):
        return index, weights, best
    centres = triangles.mean(axis=1)
    radius = float(np.linalg.norm(triangles - centres[:, None], axis=2).max())
    bound = cKDTree(triangles.reshape(-1, 3)).query(queries)[0]
    near = cKDTree(centres).query_ball_point(queries, bound * (1 + 1e-9) + radius)
    counts = np.array([len(own) for own in near])
    for own in _runs(counts):
        row = np.repeat(own, counts[own])
        face = np.concatenate([near[k] for k in own]).astype(np.int64)
        bary = closest_weights(queries[row], triangles[face])
        away = np.linalg.norm(queries[row] - np.einsum("nk,nkd->nd", bary, triangles[face]), axis=1)
        order = np.lexsort((face, away, row))
        first = order[np.unique(row[order], return_index=True)[1]]
        index[row[first]], weights[row[first]] = face[first], bary[first]
        best[row[first]] = away[first]
    return index, weights, best


def _runs(counts: Ints) -> list[Ints]:
    """Rows in runs whose counts add up to about CHUNK."""
    ends = np.cumsum(counts) // CHUNK
    return np.split(np.arange(len(counts)), np.flatnonzero(np.diff(ends)) + 1)


def closest_weights(queries: Floats, triangles: Floats) -> Floats:
    """Barycentric weights (N, 3) of the point of each triangle (N, 3, 3) nearest to its query.

    The foot of the perpendicular where it lies inside, else the best of the three edges.
    """
    a, b, c = (triangles[:, k] for k in range(3))
    u, v, w = b - a, c - a, queries - a
    uu, uv, vv, wu, wv = (
        np.einsum("nd,nd->n", p, q) for p, q in ((u, u), (u, v), (v, v), (w, u), (w, v))
    )
    det = uu * vv - uv * uv
    safe = np.where(det > 0, det, 1.0)
    s, t = (vv * wu - uv * wv) / safe, (uu * wv - uv * wu) / safe
    inside = (det > 0) & (s >= 0) & (t >= 0) & (s + t <= 1)
    best = np.stack([1 - s - t, s, t], axis=1)
    least = np.full(len(queries), np.inf)
    for k in range(3):
        start, end = triangles[:, k], triangles[:, (k + 1) % 3]
        along = end - start
        square = np.einsum("nd,nd->n", along, along)
        part = np.einsum("nd,nd->n", queries - start, along) / np.where(square > 0, square, 1.0)
        part = np.clip(part, 0.0, 1.0)
        away = np.linalg.norm(start + part[:, None] * along - queries, axis=1)
        better = ~inside & (away < least)
        least[better] = away[better]
        rows = np.flatnonzero(better)
        best[rows] = 0.0
        best[rows, k], best[rows, (k + 1) % 3] = 1 - part[rows], part[rows]
    return best
