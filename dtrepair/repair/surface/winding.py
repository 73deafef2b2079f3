"""How deep each vertex is inside the surface: winding numbers from the crossings of a pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtrepair.device import start_warp
from dtrepair.intersect.topology.components import link_labels
from dtrepair.numerics.geometry import FloatArray, IntArray, lengths, pair_keys
from dtrepair.repair.surface.surface import BoolArray, Surface
from dtrepair.repair.surface.topology import Topology

# The corner after each of the six of two triangles.
NEXT = np.array([1, 2, 0, 4, 5, 3])


@dataclass(frozen=True, kw_only=True)
class WindingOptions:
    """How winding numbers are told.

    Args:
        rays: For each piece; odd, so that the median is a vote.
        noise: Standard deviation of the rays' directions, next to the unit normal of their
            vertices, so that edges are not met exactly.
        fold_rings: Rings around the contacts in which folds are cut open too.
    """

    rays: int = 7
    noise: float = 0.25
    fold_rings: int = 3


def winding_numbers(
    surface: Surface,
    points: FloatArray,
    pairs: IntArray,
    *,
    options: WindingOptions = WindingOptions(),
) -> IntArray:
    """Return the winding number (V,) of the surface just outside each vertex: 0 is free, 1 buried.

    The surface is cut along every edge that crosses a triangle; on each piece that is left the
    winding number is constant, and a few rays decide it (median of signed crossings). Exact for
    closed surfaces, a good guess for open ones.
    """
    if len(pairs) == 0:
        return np.zeros(surface.count, dtype=np.int32)
    pieces = _pieces(surface, points, pairs, options.fold_rings)
    sizes = np.bincount(pieces)
    # What lies in a zone may be buried by design: the other vertices of a piece vote.
    order = np.lexsort((surface.in_zone, pieces))
    starts = np.cumsum(sizes) - sizes
    free = np.bincount(pieces, ~surface.in_zone).astype(np.int64)
    hidden = free == 0
    sizes = np.where(hidden, sizes, free)
    fractions = np.linspace(0.03, 0.97, options.rays)
    picked = order[starts[:, None] + (fractions * sizes[:, None]).astype(np.int64)].ravel()
    normals = surface.vector_areas(points)
    normals /= lengths(normals)[:, None] + 1e-30
    noise = np.random.default_rng(0).normal(size=(len(picked), 3))
    rays = normals[picked] + options.noise * noise
    crossings = surface.queries.crossings(
        surface.written(points),
        picked.astype(np.int32),
        rays,
        part=surface.covering and surface.covering.part,
        over=surface.covering and surface.covering.over,
    )
    votes = np.rint(np.median(crossings.reshape(-1, options.rays), axis=1)).astype(np.int32)
    votes[hidden] = 0
    of_vertices: IntArray = votes[pieces]
    return of_vertices


def _pieces(surface: Surface, points: FloatArray, pairs: IntArray, fold_rings: int) -> IntArray:
    """Return the label (V,) of the pieces that are left when every crossing edge is cut."""
    around = surface.dilate(surface.vertices_of(pairs), fold_rings)
    folds = surface.queries.folds(surface.written(points), active=around)
    # Of the rounded coordinates, as the pairs: an edge that just misses the one triangle and hits
    # the next must do so here too.
    rounded = surface.written(points).astype(np.float64)
    cut = crossing_edges(surface, rounded, np.concatenate([pairs, folds]))
    kept = np.ones(len(surface.edges), dtype=bool)
    kept[np.searchsorted(surface.edge_keys, pair_keys(cut))] = False
    # The shared vertex of a fold lies on the cut itself.
    shared = _shared_vertices(surface, folds)
    kept &= ~(shared[surface.edges[:, 0]] | shared[surface.edges[:, 1]])
    return link_labels(surface.edges[kept], surface.count, device=surface.device)


def _shared_vertices(surface: Surface, folds: IntArray) -> BoolArray:
    mask = np.zeros(surface.count, dtype=bool)
    first, second = surface.faces[folds[:, 0]], surface.faces[folds[:, 1]]
    mask[first[(first[:, :, None] == second[:, None, :]).any(axis=2)]] = True
    return mask


def crossing_edges(mesh: Topology, points: FloatArray, pairs: IntArray) -> IntArray:
    """Return edges (E, 2), i < j, of one triangle of a pair that cross the other; may repeat."""
    from dtrepair.repair.surface import winding_kernels

    warp, device, vertices = start_warp(), mesh.device, mesh.faces[pairs].reshape(-1, 6)
    corners = device.view(points.take(vertices, axis=0), warp.vec3d)
    cut = device.empty(vertices.shape, warp.uint8)
    device.launch(winding_kernels.find_cut, len(pairs), [corners, cut])
    pair, start = np.nonzero(cut.numpy())
    edges = vertices[pair[:, None], np.stack([start, NEXT[start]], axis=1)]
    return np.sort(edges, axis=1)
