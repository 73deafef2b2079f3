"""Catmull-Clark subdivision of closed quad meshes, as a matrix built once and used often."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray


def subdivide(
    quads: NDArray[np.int32], count: int
) -> tuple[scipy.sparse.csr_matrix, NDArray[np.int32]]:
    """Return one Catmull-Clark step: the matrix (V', V) of the new points, and the quads (4Q, 4).

    quads: (Q, 4) vertex indices of a closed surface, each edge in exactly two quads; count: V.
    The new points are the old vertices, then one point for each edge, then one for each quad.
    Source: Catmull and Clark 1978, "Recursively generated B-spline surfaces", Sec. 3.
    Raises ValueError where the surface is not closed.
    """
    sides = np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, side_edge, uses = np.unique(
        np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    if (uses != 2).any():
        raise ValueError(
            f"quads: expected a closed surface, got {np.sum(uses != 2)} edges not in two quads"
        )
    side_edge = side_edge.reshape(-1, 4)
    faces = len(quads)
    face_points = _averages(np.arange(faces).repeat(4), quads.reshape(-1), (faces, count), 4)
    ends = _averages(np.arange(len(edges)).repeat(2), edges.reshape(-1), (len(edges), count), 2)
    beside = _averages(side_edge.reshape(-1), np.arange(faces).repeat(4), (len(edges), faces), 2)
    edge_points = 0.5 * ends + 0.5 * beside @ face_points
    vertex_points = _vertex_rule(quads, edges, ends, face_points, count)
    matrix = scipy.sparse.vstack([vertex_points, edge_points, face_points]).tocsr()
    before = np.roll(side_edge, 1, axis=1)
    centre = np.broadcast_to(np.arange(faces)[:, None], quads.shape) + count + len(edges)
    new = np.stack([quads, side_edge + count, centre, before + count], axis=2)
    return matrix, np.ascontiguousarray(new.reshape(-1, 4), dtype=np.int32)


def _vertex_rule(
    quads: NDArray[np.int32],
    edges: NDArray[np.int32],
    ends: scipy.sparse.csr_matrix,
    face_points: scipy.sparse.csr_matrix,
    count: int,
) -> scipy.sparse.csr_matrix:
    """Return the new position of an old vertex of valence n: (F + 2 R + (n - 3) P) / n."""
    valence = np.bincount(quads.reshape(-1), minlength=count).astype(float)
    inverse = scipy.sparse.diags_array(1 / np.maximum(valence, 1))
    around = _averages(quads.reshape(-1), np.arange(len(quads)).repeat(4), (count, len(quads)), 1)
    along = _averages(edges.reshape(-1), np.arange(len(edges)).repeat(2), (count, len(edges)), 1)
    mean_face = inverse @ around @ face_points
    mean_edge = inverse @ along @ ends
    own = scipy.sparse.diags_array(valence - 3)
    return inverse @ (mean_face + 2 * mean_edge + own)


def _averages(
    rows: NDArray[Any], columns: NDArray[Any], shape: tuple[int, int], members: int
) -> scipy.sparse.csr_matrix:
    values = np.full(len(rows), 1 / members)
    return scipy.sparse.csr_matrix((values, (rows, columns)), shape=shape)
