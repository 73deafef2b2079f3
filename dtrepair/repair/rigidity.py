"""As-rigid-as-possible steps towards the edges of the input."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.device import start_warp
from dtrepair.geometry import FloatArray
from dtrepair.repair.surface import ANCHOR, BoolArray, Surface


class Rigidity:
    """Pulls poses of a surface towards the edges of one original pose (V, 3).

    The system L + ANCHOR M is factored once per topology; only the rotations follow the pose
    (Sorkine & Alexa 2007).
    """

    def __init__(
        self, surface: Surface, original: FloatArray, *, moving: BoolArray | None = None
    ) -> None:
        """Use the operators of `surface` and the edges of `original`.

        The surroundings of vertices outside of `moving` (V,) are taken for unturned.
        """
        from dtrepair.repair import rigidity_kernels

        self._kernels = rigidity_kernels
        self._warp = start_warp()
        self._surface = surface
        self._original = np.ascontiguousarray(original)
        self._moving = np.ones(surface.count, dtype=bool) if moving is None else moving
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
        inputs = [*self._matrix, original, self._array(points, warp.vec3d)]
        inputs += [self._array(self._moving.view(np.uint8), warp.uint8), rotations]
        warp.launch(self._kernels.fit_rotations, dim=count, inputs=inputs, device="cpu")
        inputs = [*self._matrix, original, rotations, edges]
        warp.launch(self._kernels.rotated_edges, dim=count, inputs=inputs, device="cpu")
        return edges.numpy() + ANCHOR * self._surface.mass[:, None] * self._original

    def solve(self, right: FloatArray) -> FloatArray:
        """The pose (V, 3) of a right-hand side."""
        return self._surface.rigidity_factor(right)

    def image(self, points: FloatArray) -> FloatArray:
        """The system applied to a pose (V, 3): the right-hand side that would give it."""
        surface = self._surface
        return surface.laplacian @ points + ANCHOR * surface.mass[:, None] * points

    def _array(self, values: NDArray[Any], dtype: Any) -> Any:
        return self._warp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu")
