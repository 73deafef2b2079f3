"""As-rigid-as-possible steps towards the edges of the input."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from dtrepair.device import start_warp
from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.operators import Solver
from dtrepair.repair.surface.surface import BoolArray, Surface


@dataclass(frozen=True, kw_only=True)
class ArapOptions:
    """Numbers of the as-rigid-as-possible steps.

    Args:
        small_region: Fraction of the vertices. A region below it gets a factor of its own; above
            it the factor of the whole mesh, which is made once, costs less.
    """

    small_region: float = 1 / 3


class ArapSystem:
    """Pulls poses of a surface towards the edges of one original pose (V, 3).

    The system L + anchor M is factored once per topology; only the rotations follow the pose
    (Sorkine & Alexa 2007). Where only a small region moves, its block of the system is factored
    instead, and the surroundings keep their places.
    """

    def __init__(
        self,
        surface: Surface,
        original: FloatArray,
        *,
        region: BoolArray | None = None,
        options: ArapOptions = ArapOptions(),
    ) -> None:
        """Use the operators of `surface` and the edges of `original`.

        Vertices outside of the region (V,) need not move. Beyond the neighbours of the region,
        rotations are taken to be none.
        """
        from dtrepair.repair.elastic import arap_kernels

        self._kernels = arap_kernels
        self._warp, self._device = start_warp(), surface.device
        self._surface, self._anchor = surface, surface.options.anchor
        self._original = self._home = np.ascontiguousarray(original)
        if region is None:
            region = np.ones(surface.count, dtype=bool)
        turning = np.flatnonzero(surface.dilate(region)).astype(np.int32)
        self._turning = self._device.array(turning, self._warp.int32)
        self._inner = np.flatnonzero(region) if region.mean() < options.small_region else None
        laplacian = surface.laplacian
        self._matrix = [
            self._device.array(laplacian.indptr.astype(np.int32), self._warp.int32),
            self._device.array(laplacian.indices.astype(np.int32), self._warp.int32),
            self._device.array(laplacian.data, self._warp.float64),
        ]
        self._own: tuple[sparse.csr_matrix, Solver] | None = None

    def hold(self, home: FloatArray, weight: float) -> None:
        """Pull vertices to places (V, 3) as well, by a weight next to that of the edges."""
        anchor = self._surface.options.anchor
        if self._anchor != anchor + weight:
            self._anchor, self._own = anchor + weight, None
        self._home = (anchor * self._original + weight * home) / (anchor + weight)

    def target(self, points: FloatArray) -> FloatArray:
        """Return the right-hand side (V, 3) of a step from `points`, zero beyond a small region."""
        warp, count = self._warp, self._surface.count
        original = self._device.view(self._original, warp.vec3d)
        rotations = self._fitted(points)
        edges = self._device.zeros(count, warp.vec3d)
        rows = np.arange(count) if self._inner is None else self._inner
        inputs = [self._device.array(rows, warp.int32), *self._matrix, original, rotations, edges]
        self._device.launch(self._kernels.rotated_edges, len(rows), inputs)
        right: FloatArray = edges.numpy() + self._anchored(self._home)
        return right

    def rotations(self, points: FloatArray) -> FloatArray:
        """Return how the surroundings of each vertex turned from the original: (V, 3, 3)."""
        fitted: FloatArray = self._fitted(points).numpy()
        return fitted

    def _fitted(self, points: FloatArray) -> Any:
        """Return the rotations of all vertices on the device, none beyond a region."""
        warp = self._warp
        identities = np.tile(np.eye(3), (self._surface.count, 1, 1))
        rotations = self._device.array(identities, warp.mat33d)
        inputs = [self._turning, *self._matrix, self._device.view(self._original, warp.vec3d)]
        inputs += [self._device.view(points, warp.vec3d), rotations]
        self._device.launch(self._kernels.fit_rotations, len(self._turning), inputs)
        return rotations

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the pose (V, 3) of a right-hand side, or the motion of its change."""
        if self._inner is None:
            return self._surface.arap_factor_with(self._anchor)(right)
        result = np.zeros_like(right)
        result[self._inner] = self._region()[1](right[self._inner])
        return result

    def image(self, points: FloatArray) -> FloatArray:
        """Return the system applied to a pose (V, 3): the right-hand side that would give it."""
        if self._inner is None:
            right: FloatArray = self._surface.laplacian @ points + self._anchored(points)
            return right
        result = self._anchored(points)
        result[self._inner] += self._region()[0] @ points
        return result

    def _region(self) -> tuple[sparse.csr_matrix, Solver]:
        """Return rows of the Laplacian of a small region, and the factor of its block."""
        if self._own is None:
            rows = self._surface.laplacian[self._inner]
            anchor = sparse.diags(self._anchor * self._surface.mass[self._inner])
            self._own = rows, self._surface.factor(rows[:, self._inner] + anchor)
        return self._own

    def _anchored(self, points: FloatArray) -> FloatArray:
        if self._inner is None:
            return self._anchor * self._surface.mass[:, None] * points
        result = np.zeros_like(points)
        result[self._inner] = (
            self._anchor * self._surface.mass[self._inner, None] * points[self._inner]
        )
        return result
