"""The Poisson system of the target: what remains when the fourth vertices are eliminated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.transfer.gradients import surface_gradient

# Edge terms that hold degenerate triangles together, relative to the median diagonal entry.
WEAK_EDGE = 1e-8


def poisson_system(
    points: FloatArray,
    faces: IntArray,
    degenerate: NDArray[np.bool_],
    weights: FloatArray,
) -> tuple[sparse.csr_matrix, sparse.csr_matrix]:
    """Return divergence (V, 3F) and matrix (V, V) of the Poisson system.

    Degenerate triangles have no gradient term; uniform edge terms |x_j - x_i - S (v_j - v_i)|^2
    of negligible weight say where their vertices go when nothing else does.
    """
    gradient = surface_gradient(points, faces, degenerate)
    divergence = gradient.T @ sparse.diags(np.repeat(np.where(degenerate, 0.0, weights), 3))
    matrix = divergence @ gradient
    if not degenerate.any():
        return divergence.tocsr(), matrix.tocsr()
    diagonal = matrix.diagonal()
    positive = diagonal[diagonal > 0]
    weight = WEAK_EDGE * (np.median(positive) if len(positive) else 1.0)
    differences, wanted = _edge_terms(points, faces, np.flatnonzero(degenerate))
    divergence = divergence + weight * (differences.T @ wanted)
    return divergence.tocsr(), (matrix + weight * (differences.T @ differences)).tocsr()


def _edge_terms(
    points: FloatArray, faces: IntArray, triangles: NDArray[np.int64]
) -> tuple[sparse.csr_matrix, sparse.csr_matrix]:
    """Return edges of triangles as differences (E, V), and S (v_j - v_i) as (E, 3F)."""
    first, second = faces[triangles].ravel(), np.roll(faces[triangles], -1, axis=1).ravel()
    count = len(first)
    rows, ones = np.arange(count), np.ones(count)
    ends = sparse.coo_matrix((ones, (rows, second)), (count, len(points)))
    starts = sparse.coo_matrix((ones, (rows, first)), (count, len(points)))
    edges = points[second] - points[first]
    columns = 3 * np.repeat(triangles, 3)[:, None] + np.arange(3)
    wanted = sparse.coo_matrix(
        (edges.ravel(), (np.repeat(rows, 3), columns.ravel())), (count, 3 * len(faces))
    )
    return (ends - starts).tocsr(), wanted.tocsr()
