"""As-rigid-as-possible steps towards the edges of the input, with soft pins inside the solve."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.device import start_warp
from dtrepair.geometry import FloatArray
from dtrepair.repair.surface import ANCHOR, Surface

# Conjugate-gradient iterations with the unpinned factor as preconditioner.
PINNED_ITERATIONS = 6


class Rigidity:
    """Pulls poses of a surface towards the edges of one original pose (V, 3).

    The system L + ANCHOR M is factored once per topology; only the rotations follow the pose
    (Sorkine & Alexa 2007).
    """

    def __init__(self, surface: Surface, original: FloatArray) -> None:
        """Use the operators of `surface` and the edges of `original`."""
        from dtrepair.repair import rigidity_kernels

        self._kernels = rigidity_kernels
        self._warp = start_warp()
        self._surface = surface
        self._original = np.ascontiguousarray(original)
        laplacian = surface.laplacian
        self._matrix = [
            self._array(laplacian.indptr.astype(np.int32), self._warp.int32),
            self._array(laplacian.indices.astype(np.int32), self._warp.int32),
            self._array(laplacian.data, self._warp.float64),
        ]

    def target(self, points: FloatArray) -> FloatArray:
        """Right-hand side (V, 3) of a step from `points`."""
        warp, count = self._warp, self._surface.count
        original = self._array(self._original, warp.vec3d)
        rotations = warp.empty(count, dtype=warp.mat33d, device="cpu")
        edges = warp.empty(count, dtype=warp.vec3d, device="cpu")
        inputs = [*self._matrix, original, self._array(points, warp.vec3d), rotations]
        warp.launch(self._kernels.fit_rotations, dim=count, inputs=inputs, device="cpu")
        inputs = [*self._matrix, original, rotations, edges]
        warp.launch(self._kernels.rotated_edges, dim=count, inputs=inputs, device="cpu")
        return edges.numpy() + ANCHOR * self._surface.mass[:, None] * self._original

    def solve(self, target: FloatArray, pins: FloatArray, points: FloatArray) -> FloatArray:
        """The pose of a step; `pins` (V,) are weights that hold vertices at `points`.

        Pinned systems are solved by conjugate gradients from `points`, preconditioned with the
        factor of the unpinned one: the pins change with every attempt, the factor never does.
        """
        factor = self._surface.rigidity_factor
        if not pins.any():
            return factor(target)
        weight = (pins + ANCHOR * self._surface.mass)[:, None]
        right = target + pins[:, None] * points
        solution = points
        residual = right - (self._surface.laplacian @ solution + weight * solution)
        preconditioned = factor(residual)
        search = preconditioned.copy()
        energy = (residual * preconditioned).sum(axis=0)
        for _ in range(PINNED_ITERATIONS):
            image = self._surface.laplacian @ search + weight * search
            length = energy / np.maximum((search * image).sum(axis=0), 1e-300)
            solution = solution + length * search
            residual = residual - length * image
            preconditioned = factor(residual)
            following = (residual * preconditioned).sum(axis=0)
            search = preconditioned + following / np.maximum(energy, 1e-300) * search
            energy = following
        return solution

    def _array(self, values: NDArray[Any], dtype: Any) -> Any:
        return self._warp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu")
