"""Deformation gradients of posed triangles as one sparse operator on [pose; scaled normals]."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.numerics.geometry import FloatArray, IntArray, triangle_normals, vector_areas
from dtrepair.numerics.operators import gradient_operator

# A triangle lower than this fraction of its longest edge has no usable gradient: its height is not
# much more than the rounding of float32 coordinates, 6e-8 of their size.
DEGENERATE_HEIGHT = 1e-6


def scaled_normals(points: FloatArray, faces: IntArray) -> FloatArray:
    """Return fourth vertex minus first of each triangle (F, 3): n / sqrt|n|, n = cross product.

    Sumner & Popovic 2004, eq. 1. The square root makes it scale with the edges, so that a scaled
    triangle has a scaled deformation gradient.
    """
    cross = 2.0 * vector_areas(points, faces)
    root = np.sqrt(np.linalg.norm(cross, axis=1, keepdims=True))
    normals: FloatArray = np.divide(cross, root, out=np.zeros_like(cross), where=root > 0)
    return normals


def degenerate_triangles(points: FloatArray, faces: IntArray) -> NDArray[np.bool_]:
    """Return the mask (F,) of triangles whose height is below 1e-6 of their longest edge."""
    corners = points[faces]
    edges = corners - np.roll(corners, 1, axis=1)
    longest = np.einsum("fij,fij->fi", edges, edges).max(axis=1, initial=0.0)
    double_area = 2.0 * np.linalg.norm(vector_areas(points, faces), axis=1)
    degenerate: NDArray[np.bool_] = ~(double_area > DEGENERATE_HEIGHT * longest)
    return degenerate


def surface_gradient(
    points: FloatArray, faces: IntArray, degenerate: NDArray[np.bool_]
) -> sparse.csr_matrix:
    """Return the gradient operator (3F, V), zero rows for degenerate triangles, 1 / length."""
    good = np.flatnonzero(~degenerate)
    entries = gradient_operator(points, faces[good]).tocoo()
    rows = 3 * good[entries.row // 3] + entries.row % 3
    shape = (3 * len(faces), len(points))
    return sparse.coo_matrix((entries.data, (rows, entries.col)), shape=shape).tocsr()


def deformation_operator(
    points: FloatArray, faces: IntArray, degenerate: NDArray[np.bool_]
) -> sparse.csr_matrix:
    """Return A (3F, V + F): A @ [pose; its scaled normals] = deformation gradients.

    Row 3t + i of the product is column i of the deformation gradient of triangle t (Sumner &
    Popovic 2004, eq. 3-4, with the fourth vertex kept as an offset). Rows of degenerate
    triangles are zero.
    """
    good = np.flatnonzero(~degenerate)
    lengths = np.linalg.norm(scaled_normals(points, faces[good]), axis=1, keepdims=True)
    normal_rows = triangle_normals(points, faces[good]) / lengths
    rows = (3 * good[:, None] + np.arange(3)).ravel()
    normal_part = sparse.coo_matrix(
        (normal_rows.ravel(), (rows, np.repeat(good, 3))), shape=(3 * len(faces), len(faces))
    )
    return sparse.hstack([surface_gradient(points, faces, degenerate), normal_part], format="csr")


def stacked(pose: FloatArray, faces: IntArray) -> FloatArray:
    """Return [positions; scaled normals] of a pose (V + F, 3), positions relative to their mean.

    Gradients do not see a translation; taking it out first keeps poses far from the origin exact.
    """
    centred = pose - pose.mean(axis=0)
    return np.concatenate([centred, scaled_normals(centred, faces)])
