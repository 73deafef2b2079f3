"""A part of a mesh for a small file: whole near a place, coarser the farther away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ExcerptOptions:
    """How an excerpt is made.

    Args:
        triangles: It has about so many at most.
        near: Share of them that stay as they are around the place.
        first_cell: Cells just beyond those, of the diagonal; they grow with the distance.
        growth: Factor on the cells until the excerpt is small enough.
    """

    triangles: int = 14000
    near: float = 0.5
    first_cell: float = 0.005
    growth: float = 1.25


@dataclass(frozen=True)
class Excerpt:
    """Vertices (N,) of a mesh that are kept, and triangles between them.

    Args:
        vertices: Numbers of vertices of the mesh, rising.
        faces: Triangles (M, 3) of these vertices.
        triangles: The triangle (M,) of the mesh that each of them stands for.
    """

    vertices: NDArray[np.int64]
    faces: NDArray[np.int32]
    triangles: NDArray[np.int64]


def make_excerpt(
    points: FloatArray,
    faces: NDArray[np.int32],
    place: NDArray[np.integer],
    *,
    options: ExcerptOptions = ExcerptOptions(),
) -> Excerpt:
    """Return an excerpt that keeps what is near the triangles `place` (K,) as it is.

    Vertices farther away that lie in one cell, and are connected within it, become one of them.
    points (V, 3): the pose in which it is near; the excerpt shows any pose of the mesh.
    """
    if len(faces) <= options.triangles:
        return _taken(np.arange(len(points)), points, faces)
    distance = cKDTree(points[np.unique(faces[place])]).query(points)[0]
    farthest = distance[faces].max(axis=1)
    reach = np.partition(farthest, round(options.near * options.triangles))[
        round(options.near * options.triangles)
    ]
    # The triangles of the place itself stay, however many they are.
    near = distance <= max(reach, 0.0)
    near[faces[place]] = True
    level = np.ceil(np.log2(np.maximum(distance / max(reach, 1e-30), 1.0))).astype(np.int64)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    cell = options.first_cell * size
    while True:
        merged = _merged(points, faces, near, cell * 2.0**level)
        found = _taken(merged, points, faces)
        if len(found.faces) <= options.triangles or cell > size:
            return found
        cell *= options.growth


def _merged(
    points: FloatArray, faces: NDArray[np.int32], near: NDArray[np.bool_], cells: FloatArray
) -> NDArray[np.int64]:
    """Return for each vertex (V,) the one that stands for it."""
    low = points.min(axis=0)
    keys = np.floor((points - low) / cells[:, None]).astype(np.int64)
    _, cell = np.unique(np.column_stack([keys, cells]), axis=0, return_inverse=True)
    cell = cell.ravel()
    ends = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    joined = (cell[ends[:, 0]] == cell[ends[:, 1]]) & ~near[ends].any(axis=1)
    ends = ends[joined]
    graph = sparse.coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (len(points),) * 2)
    count, cluster = csgraph.connected_components(graph, directed=False)
    size = np.bincount(cluster, minlength=count)
    middle = np.stack([np.bincount(cluster, points[:, k], count) for k in range(3)], axis=1)
    off = np.linalg.norm(points - (middle / size[:, None])[cluster], axis=1)
    order = np.lexsort((off, cluster))
    nearest = order[np.searchsorted(cluster[order], np.arange(count))]
    standing: NDArray[np.int64] = nearest[cluster].astype(np.int64)
    return standing


def _taken(standing: NDArray[np.int64], points: FloatArray, faces: NDArray[np.int32]) -> Excerpt:
    """Return what is left of the triangles where `standing` (V,) take the place of vertices."""
    corners = standing[faces]
    a, b, c = corners.T
    whole = np.flatnonzero((a != b) & (b != c) & (c != a))
    vertices, renumbered = np.unique(corners[whole], return_inverse=True)
    return Excerpt(vertices, renumbered.reshape(-1, 3).astype(np.int32), whole)
