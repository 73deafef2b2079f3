"""How deep each vertex is inside the surface: winding numbers from the crossings of a pose."""

from __future__ import annotations

import numpy as np

from dtrepair.geometry import FloatArray, IntArray, dots, lengths, triangle_normals
from dtrepair.intersect.queries import link_labels
from dtrepair.repair.surface import BoolArray, Surface, pair_keys

# Rays a component; odd, so that the median is a vote.
RAYS = 7
# Rays leave along the vertex normal with this much noise, so that edges are not met exactly.
RAY_NOISE = 0.25
# Rings around the contacts in which folds are cut open too.
FOLD_RINGS = 3
# An edge that meets an edge must be cut by one triangle at least: triangles are wider by this part
# of their edges. One edge too many does no harm, one too few joins the inside with the outside.
EDGE_MARGIN = 1e-9


def winding_numbers(surface: Surface, points: FloatArray, pairs: IntArray) -> IntArray:
    """Winding number (V,) of the surface just outside each vertex: 0 is free, 1 buried.

    The surface is cut along every edge that crosses a triangle; on each piece that is left the
    winding number is constant, and a few rays decide it (median of signed crossings). Exact for
    closed surfaces, a good guess for open ones.
    """
    if len(pairs) == 0:
        return np.zeros(surface.count, dtype=np.int32)
    pieces = _pieces(surface, points, pairs)
    sizes = np.bincount(pieces)
    order = np.argsort(pieces, kind="stable")
    starts = np.cumsum(sizes) - sizes
    fractions = np.linspace(0.03, 0.97, RAYS)
    picked = order[starts[:, None] + (fractions * sizes[:, None]).astype(np.int64)].ravel()
    normals = surface.vector_areas(points)
    normals /= lengths(normals)[:, None] + 1e-30
    noise = np.random.default_rng(0).normal(size=(len(picked), 3))
    rays = normals[picked] + RAY_NOISE * noise
    crossings = surface.queries.crossings(surface.written(points), picked.astype(np.int32), rays)
    votes = np.rint(np.median(crossings.reshape(-1, RAYS), axis=1)).astype(np.int32)
    return votes[pieces]


def _pieces(surface: Surface, points: FloatArray, pairs: IntArray) -> IntArray:
    """Label (V,) of the pieces that are left when every crossing edge is cut."""
    around = surface.dilate(surface.vertices_of(pairs), FOLD_RINGS)
    folds = surface.queries.folds(surface.written(points), active=around)
    # Of the rounded coordinates, as the pairs: an edge that just misses the one triangle and hits
    # the next must do so here too.
    rounded = surface.written(points).astype(np.float64)
    cut = crossing_edges(rounded, surface.faces, np.concatenate([pairs, folds]))
    kept = np.ones(len(surface.edges), dtype=bool)
    kept[np.searchsorted(surface.edge_keys, pair_keys(cut))] = False
    # The shared vertex of a fold lies on the cut itself.
    shared = _shared_vertices(surface, folds)
    kept &= ~(shared[surface.edges[:, 0]] | shared[surface.edges[:, 1]])
    return link_labels(surface.edges[kept], surface.count)


def _shared_vertices(surface: Surface, folds: IntArray) -> BoolArray:
    mask = np.zeros(surface.count, dtype=bool)
    first, second = surface.faces[folds[:, 0]], surface.faces[folds[:, 1]]
    mask[first[(first[:, :, None] == second[:, None, :]).any(axis=2)]] = True
    return mask


def crossing_edges(points: FloatArray, faces: IntArray, pairs: IntArray) -> IntArray:
    """Edges (E, 2), i < j, of one triangle of a pair that cross the other; may repeat."""
    edges = []
    for mine, other in ((0, 1), (1, 0)):
        triangle = points[faces[pairs[:, other]]]
        normal = triangle_normals(triangle.reshape(-1, 3), _own_faces(len(pairs)))
        for corner in range(3):
            ends = faces[pairs[:, mine]][:, [corner, (corner + 1) % 3]]
            p, q = points[ends[:, 0]], points[ends[:, 1]]
            s = dots(normal, p - triangle[:, 0])
            t = dots(normal, q - triangle[:, 0])
            crosses = np.flatnonzero((s > 0) != (t > 0))
            weight = (s[crosses] / (s[crosses] - t[crosses]))[:, None]
            hit = p[crosses] + weight * (q[crosses] - p[crosses])
            within = _within(hit, triangle[crosses], normal[crosses])
            edges.append(np.sort(ends[crosses[within]], axis=1))
    return np.concatenate(edges)


def _within(hit: FloatArray, triangle: FloatArray, normal: FloatArray) -> BoolArray:
    """Whether points of the triangles' planes (K, 3) lie in the triangles (K, 3, 3)."""
    inside = np.ones(len(hit), dtype=bool)
    for k in range(3):
        edge = triangle[:, (k + 1) % 3] - triangle[:, k]
        height = dots(normal, np.cross(edge, hit - triangle[:, k]))
        inside &= height >= -EDGE_MARGIN * dots(edge, edge)
    return inside


def _own_faces(count: int) -> IntArray:
    return np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
