"""Sparse operators of a triangle mesh, their factors (cholespy), and those of patches (SuperLU)."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from dtrepair.numerics.geometry import FloatArray, IntArray, cross, unique_edges, vertex_areas
from dtrepair.numerics.work import add_work

# A factorisation takes so many units of work (see `work`) for a row of its matrix, and a solve so
# many for a number of its solution.
WORK_A_ROW = 3
WORK_A_NUMBER = 0.025
# Keeps the system of a patch definite where it has no fixed surroundings.
REGULARIZATION = 1e-10


def cotangent_laplacian(
    points: FloatArray, faces: IntArray, *, clamp: tuple[float, float] | None = None
) -> sparse.csr_matrix:
    """Return the cotangent Laplacian (V, V), positive semidefinite, dimensionless.

    Pinkall & Polthier 1993.

    `clamp` bounds the weight of every edge from below and above: with positive weights the matrix
    is an M-matrix, so a diffused field never exceeds its source (maximum principle).
    """
    count = len(points)
    rows, columns, weights = [], [], []
    for corner in range(3):
        apex, left, right = (faces[:, (corner + k) % 3] for k in range(3))
        u, v = points[left] - points[apex], points[right] - points[apex]
        double_area = np.linalg.norm(cross(u, v), axis=1)
        # A zero-area corner has no cotangent: bounded by the lengths of its edges, or, as bounds
        # of both signs are no longer semidefinite, as wide as half a right angle.
        floor = 1e-12 * np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1) + 1e-300
        rows.append(left)
        columns.append(right)
        cotangent = np.einsum("ij,ij->i", u, v) / np.maximum(double_area, floor)
        weights.append(0.5 * np.where((double_area > floor) | (clamp is not None), cotangent, 1.0))
    row, column, weight = (np.concatenate(parts) for parts in (rows, columns, weights))
    proper = row != column
    half = sparse.coo_matrix((weight[proper], (row[proper], column[proper])), shape=(count, count))
    edges = (half + half.T).tocsr()
    edges.eliminate_zeros()
    if clamp is not None:
        edges.data = np.clip(edges.data, *clamp)
    return _laplacian(edges)


def uniform_laplacian(faces: IntArray, count: int) -> sparse.csr_matrix:
    """Return the graph Laplacian (count, count): degree on the diagonal, -1 for each edge."""
    edges = unique_edges(faces)
    half = sparse.coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), (count, count))
    return _laplacian((half + half.T).tocsr())


def lumped_mass(points: FloatArray, faces: IntArray, *, floor: float = 1e-2) -> FloatArray:
    """Return vertex areas (V,) scaled to mean 1 over the vertices in use, and at least `floor`."""
    areas = vertex_areas(points, faces)
    used = areas[areas > 0]
    return np.maximum(areas / used.mean() if len(used) else areas, floor)


def gradient_operator(points: FloatArray, faces: IntArray) -> sparse.csr_matrix:
    """Return the gradient (3F, V) of a piecewise linear function, in 1 / length.

    Rows 3t, 3t + 1 and 3t + 2 are the gradient's x, y and z in triangle t.

    A zero-area triangle has no gradient: its rows are zero.
    """
    double_normals = cross(
        points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
    )
    squared = np.einsum("ij,ij->i", double_normals, double_normals)
    inverse = np.divide(1.0, squared, out=np.zeros_like(squared), where=squared > 0)
    blocks = []
    for corner in range(3):
        opposite = points[faces[:, (corner + 2) % 3]] - points[faces[:, (corner + 1) % 3]]
        blocks.append(cross(double_normals, opposite) * inverse[:, None])
    values = np.stack(blocks, axis=1)  # (F, corner, xyz)
    rows = 3 * np.arange(len(faces))[:, None, None] + np.arange(3)[None, None, :]
    columns = np.broadcast_to(faces[:, :, None], values.shape)
    return sparse.coo_matrix(
        (values.ravel(), (np.broadcast_to(rows, values.shape).ravel(), columns.ravel())),
        shape=(3 * len(faces), len(points)),
    ).tocsr()


def _laplacian(edges: sparse.csr_matrix) -> sparse.csr_matrix:
    """Return the Laplacian of symmetric edge weights (V, V): their sums on the diagonal."""
    return (sparse.diags(np.asarray(edges.sum(axis=1)).ravel()) - edges).tocsr()


class Solver(Protocol):
    """Solves with one sparse symmetric positive definite matrix (V, V), factorised once.

    The seam for other devices: what stages solve with comes from a `Factorise` that their surface
    was given, and only `solve` has frames of a batch at once.
    """

    size: int

    def __call__(self, right_hand_side: NDArray[np.floating]) -> FloatArray:
        """Return the solution of one right-hand side, (V,) or (V, k), float64."""
        ...

    def solve(self, frames: NDArray[np.floating]) -> FloatArray:
        """Return the solutions (B, V, k) of the right-hand sides (B, V, k) of B frames.

        A frame has the bits that it has alone, whatever else is in the batch.
        """
        ...


# Makes the solver of a matrix (V, V); ValueError where it has none.
Factorise = Callable[[sparse.spmatrix], Solver]


class Factor:
    """The solver of the CPU: a sparse Cholesky factor.

    `Factor.count` counts the factorisations of the process, so that a test can assert reuse.
    """

    count: ClassVar[int] = 0

    def __init__(self, matrix: sparse.spmatrix) -> None:
        """Factorise `matrix` (n, n); ValueError when it is not square or not finite."""
        from cholespy import CholeskySolverD, MatrixType

        entries = sparse.csc_matrix(matrix)
        entries.sum_duplicates()
        entries.sort_indices()
        if entries.shape[0] != entries.shape[1]:
            raise ValueError(f"matrix should be square, got {entries.shape}")
        if not np.isfinite(entries.data).all():
            raise ValueError("matrix should be finite: check the mesh for points that are not")
        Factor.count += 1
        self.size = int(entries.shape[0])
        add_work(WORK_A_ROW * self.size)
        self._solver = CholeskySolverD(
            self.size,
            entries.indptr.astype(np.int32),
            entries.indices.astype(np.int32),
            entries.data.astype(np.float64),
            MatrixType.CSC,
        )

    def __call__(self, right_hand_side: NDArray[np.floating]) -> FloatArray:
        """Return the solution x of matrix @ x = right_hand_side, shape (n,) or (n, k), float64."""
        rows = np.ascontiguousarray(right_hand_side, dtype=np.float64)
        if rows.shape[0] != self.size:
            raise ValueError(f"right-hand side should have {self.size} rows, got {rows.shape}")
        solution = np.zeros_like(rows)
        add_work(WORK_A_NUMBER * solution.size)
        self._solver.solve(rows, solution)
        return solution

    def solve(self, frames: NDArray[np.floating]) -> FloatArray:
        """Return the solutions (B, V, k) of the right-hand sides (B, V, k) of B frames.

        One after the other: columns of several frames in one solve are rounded otherwise.
        """
        result = np.empty(frames.shape)
        for frame, right in enumerate(frames):
            result[frame] = self(right)
        return result


def patch_factor(matrix: sparse.spmatrix) -> Callable[[FloatArray], FloatArray]:
    """Return what solves a sparse symmetric system of a patch, entries of about 1."""
    add_work(WORK_A_ROW * matrix.shape[0])
    # Patches come and go: a general factorisation each, with an ordering for symmetric matrices.
    factor = linalg.splu(
        sparse.csc_matrix(matrix + REGULARIZATION * sparse.identity(matrix.shape[0])),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return lambda right: factor.solve(np.ascontiguousarray(right))
