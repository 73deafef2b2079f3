"""How far a repaired mesh is from its input: displacement, edge lengths, jitter, volume."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray, diagonal, lengths


def displacements(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return how far each vertex moved (V,), relative to the bounding-box diagonal of `before`."""
    return lengths(after - before) / (diagonal(before) or 1.0)


def edge_log_ratio(before: FloatArray, after: FloatArray, edges: IntArray) -> float:
    """Return the root mean square of the logarithm of the edges' length ratios.

    It is 0 for a rigid motion. before, after: (V, 3); edges: (E, 2).
    """
    if len(edges) == 0:
        return 0.0
    first, second = edges.T
    old, new = (lengths(p.take(first, axis=0) - p.take(second, axis=0)) for p in (before, after))
    floor = 1e-12 * (diagonal(before) or 1.0)
    return float(np.sqrt(np.mean(np.log(np.maximum(new, floor) / np.maximum(old, floor)) ** 2)))


def volume(points: FloatArray, faces: IntArray) -> float:
    """Return the signed volume of a closed mesh, cubed length units (divergence theorem)."""
    a, b, c = (points[faces[:, k]] - points.mean(axis=0) for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def jitter(before: FloatArray, after: FloatArray) -> float:
    """Return the root mean square second difference of the displacement (T, V, 3), in diagonals."""
    moved = after - before
    if len(moved) < 3:
        return 0.0
    second = moved[2:] - 2.0 * moved[1:-1] + moved[:-2]
    return float(np.sqrt(np.mean(np.sum(second**2, axis=2))) / (diagonal(before[0]) or 1.0))
