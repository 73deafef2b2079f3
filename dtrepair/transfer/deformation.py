"""Deformation transfer: one factor per target, then poses of the source -> poses of the target."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from dtrepair.numerics.geometry import FloatArray, IntArray, as_mesh, as_points, triangle_areas
from dtrepair.numerics.operators import Factor
from dtrepair.numerics.threads import one_thread
from dtrepair.transfer.arrays import Array, floating_type, like, to_numpy
from dtrepair.transfer.gradients import (
    deformation_operator,
    degenerate_triangles,
    stacked,
)
from dtrepair.transfer.matching.alignment import checked_rotation, unit_vector
from dtrepair.transfer.matching.correspondence import (
    HarmonicFill,
    averaging_operator,
    checked_pairs,
)
from dtrepair.transfer.placement import Match, Pieces, Placement, ground_level, ground_ratio
from dtrepair.transfer.poisson import poisson_system

Weights = Literal["area", "cotan", "count", "uniform"]


class Transfer:
    """Transfers poses of a source mesh to a target mesh (Sumner & Popovic 2004).

    The fourth vertex of each triangle is eliminated; what is left is a Poisson system in the
    target vertices,
        min_x  sum_t  w_t || G_t x - S_t P_t ||^2,
    with S_t the mean deformation gradient of the source triangles paired with t and P_t the
    projector on its plane. The matrix is factorised once; each frame is one sparse product and
    one back-substitution. Translations, which the system does not see, follow `Placement`.

    weights: "area" (default; "cotan" is the same: the matrix is the cotangent Laplacian),
        "count" (number of pairs of the triangle, as in the paper; fails on sliver triangles) or
        "uniform".
    rotation: rotation (3, 3) that turns the source's axes into the target's, for stages of
        different up axis or rests that face different ways: S' = R S R^T.
    up: the target's up axis, for the height over the ground.
    scale: factor of the root's translation; None takes the ratio of the heights over the ground.
    pieces: what connected pieces other than the largest do: "seated" or "separate"; see
        `Placement`.
    snap: move each frame along `up` so that the lowest target vertex is as high over the ground
        as the lowest source vertex, times `scale`.
    """

    def __init__(
        self,
        source: Array,
        source_faces: Array,
        target: Array,
        target_faces: Array,
        pairs: Array,
        *,
        weights: Weights = "area",
        rotation: ArrayLike | None = None,
        up: ArrayLike = (0.0, 1.0, 0.0),
        scale: float | None = None,
        pieces: Pieces = "seated",
        snap: bool = False,
    ) -> None:
        """Factorise for rests (Vs, 3), (Vt, 3), faces (F, 3) and pairs (K, 2) of triangles.

        Raises ValueError for arrays of wrong shape, indices out of range, a `rotation` that is
        none, meshes without a usable pair, and a system that cannot be factorised.
        """
        self._turn = checked_rotation(rotation)
        self.source_rest, self.source_faces = as_mesh(to_numpy(source), to_numpy(source_faces))
        self.source = self.source_rest @ self._turn.T  # in the target's axes
        self.target, self.target_faces = as_mesh(to_numpy(target), to_numpy(target_faces))
        self.pairs = checked_pairs(pairs, len(self.source_faces), len(self.target_faces))
        self.degenerate = degenerate_triangles(self.target, self.target_faces)
        if self.degenerate.all():
            raise ValueError("the target should have triangles with an area, got none")
        unusable = degenerate_triangles(self.source, self.source_faces)
        deformation = deformation_operator(self.source, self.source_faces, unusable)
        average = averaging_operator(self.pairs, ~unusable, len(self.target_faces))
        self.gradients = _GradientSource(self.target, self.target_faces, average, deformation)
        divergence, matrix = poisson_system(
            self.target, self.target_faces, self.degenerate, self._weights(weights, average)
        )
        match = Match(self.source, self.source_faces, self.target, self.target_faces, average)
        self.up = unit_vector(up, "up")
        ratio = ground_ratio(match, self.up) if scale is None else float(scale)
        self.placement = Placement(match, deformation, ratio, pieces)
        self.snap = snap
        self._assemble(divergence, matrix)

    def _weights(self, weights: Weights, average: sparse.csr_matrix) -> FloatArray:
        """Return the weight of each target triangle (Ft,)."""
        if weights in ("area", "cotan"):
            areas = triangle_areas(self.target, self.target_faces)
            return areas / float(areas.mean())
        if weights == "count":
            counts: FloatArray = np.maximum(np.diff(average.indptr), 1).astype(np.float64)
            return counts
        if weights == "uniform":
            return np.ones(len(self.target_faces))
        raise ValueError(
            f"weights should be 'area', 'cotan', 'count' or 'uniform', got {weights!r}"
        )

    @one_thread()
    def _assemble(self, divergence: sparse.csr_matrix, matrix: sparse.csr_matrix) -> None:
        free = np.ones(len(self.target), dtype=bool)
        free[self.placement.anchors()] = False
        self.free = np.flatnonzero(free)
        self.factor = Factor(matrix[self.free][:, self.free])
        self._matched_part, self._filled_part = self.gradients.right_hand_sides(
            divergence[self.free]
        )
        if not np.isfinite(self.solve(stacked(self.source, self.source_faces))).all():
            raise ValueError(
                "the system of the target could not be factorised: it has sliver triangles; "
                "use weights='area'"
            )

    @one_thread()
    def __call__(self, poses: Array) -> Array:
        """Return target positions (T, Vt, 3), target units, of source poses (T, Vs, 3).

        A single pose (Vs, 3) gives (Vt, 3). float32 comes back as float32, torch as torch. Raises
        ValueError for other shapes and numbers that are not finite.
        """
        frames = to_numpy(poses)
        if frames.ndim not in (2, 3):
            raise ValueError(
                f"poses should have shape (T, {len(self.source)}, 3), got {frames.shape}"
            )
        single = frames.ndim == 2
        batch = frames[None] if single else frames
        result = np.empty((len(batch), len(self.target), 3), dtype=floating_type(frames))
        for index, frame in enumerate(batch):
            pose = self.turned(frame)
            stack = stacked(pose, self.source_faces)
            result[index] = self.placed(self.solve(stack), pose, stack)
        return like(result[0] if single else result, poses)

    def turned(self, frame: Array) -> FloatArray:
        """Return one pose (Vs, 3), checked, in the target's axes."""
        return as_points(frame, len(self.source)) @ self._turn.T

    def solve(self, stack: FloatArray) -> FloatArray:
        """Return target positions (Vt, 3) with the anchor of each piece at zero."""
        right = self._matched_part @ stack
        if self._filled_part is not None:
            right += self._filled_part @ self.gradients.filled(stack)
        points = np.zeros((len(self.target), 3))
        points[self.free] = self.factor(right)
        return points

    def back_substitute(self, loads: FloatArray) -> FloatArray:
        """Return the responses (Vt, k) to loads (Vt, k), the anchor of each piece at zero."""
        responses = np.zeros(loads.shape)
        responses[self.free] = self.factor(loads[self.free])
        return responses

    def placed(
        self,
        points: FloatArray,
        pose: FloatArray,
        stack: FloatArray,
        held: NDArray[np.bool_] | None = None,
    ) -> FloatArray:
        """Move a solution (Vt, 3) to its place; pieces in the mask `held` stay where they are."""
        points = self.placement(points, pose, stack, held)
        if self.snap and held is None:
            points += self.up * (self._ground_wanted(pose) - self._lowest(points))
        return points

    def _ground_wanted(self, pose: FloatArray) -> float:
        source_ground = ground_level(self.source, self.source_faces, self.up)
        lift = ground_level(pose, self.source_faces, self.up) - source_ground
        return self._lowest(self.target) + self.placement.ratio * lift

    def _lowest(self, points: FloatArray) -> float:
        return ground_level(points, self.target_faces, self.up)


def transfer_blend_shapes(transfer: Transfer, offsets: Array) -> Array:
    """Return blend shapes of the target (K, Vt, 3) from the source's (K, Vs, 3), as offsets.

    Each shape is transferred once, at full weight; the animation of the weights is kept as it is
    (within 0.2 % of the diagonal of transferring the blended poses).
    """
    shapes = to_numpy(offsets)
    if shapes.ndim != 3 or shapes.shape[1:] != transfer.source.shape:
        raise ValueError(
            f"offsets should have shape (K, {len(transfer.source)}, 3), got {shapes.shape}"
        )
    rest = transfer.source_rest
    moved = transfer(rest + shapes.astype(np.float64)) - transfer(rest)
    return like(moved.astype(floating_type(shapes)), offsets)


class _GradientSource:
    """Deformation gradients of the target's triangles, as linear maps of the source's stack."""

    def __init__(
        self,
        target: FloatArray,
        faces: IntArray,
        average: sparse.csr_matrix,
        deformation: sparse.csr_matrix,
    ) -> None:
        self.matched = np.diff(average.indptr) > 0
        self.known = (
            sparse.kron(average[self.matched], sparse.eye(3), format="csr") @ deformation
        ).tocsr()
        self.fill = None if self.matched.all() else HarmonicFill(target, faces, self.matched)

    def filled(self, stack: FloatArray) -> FloatArray:
        """Return gradients of the unmatched triangles, stacked as rows (3 * unmatched, 3)."""
        assert self.fill is not None
        known = (self.known @ stack).reshape(-1, 9)
        return self.fill(known).reshape(-1, 3)

    def __call__(self, stack: FloatArray) -> FloatArray:
        """Return the deformation gradients S (Ft, 3, 3) asked of the target's triangles."""
        columns = np.empty((len(self.matched), 9))
        known = (self.known @ stack).reshape(-1, 9)
        columns[self.matched] = known
        if self.fill is not None:
            columns[~self.matched] = self.fill(known)
        return np.swapaxes(columns.reshape(-1, 3, 3), 1, 2)

    def right_hand_sides(
        self, divergence: sparse.csr_matrix
    ) -> tuple[sparse.csr_matrix, sparse.csr_matrix | None]:
        """Return the right-hand side's two factors: on the stack, and on the filled gradients."""
        matched = np.repeat(self.matched, 3)
        direct = (divergence[:, matched] @ self.known).tocsr()
        direct.eliminate_zeros()
        return direct, None if self.fill is None else divergence[:, ~matched].tocsr()
