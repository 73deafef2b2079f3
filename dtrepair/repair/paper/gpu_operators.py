"""Parts of the published loop as launches on a device: forces, and sparse matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from scipy import sparse
from torch import Tensor

from dtrepair.device import DeviceQueue, start_warp
from dtrepair.repair.paper import gpu_kernels as kernels
from dtrepair.repair.paper.corner_energy import (
    ConicalField,
    Kernel,
    PointToPlane,
    SignedTangentPoint,
    UnsignedTangentPoint,
)
from dtrepair.repair.paper.descent import Descent
from dtrepair.repair.paper.gpu_detection import FixedDetection

# Whole numbers per unit of force, in a mesh of unit size. Tangent-point and conical forces are
# about an edge length, and at most 2 sqrt(A) / nearest = 2000: 2^44 keeps them to 6e-14 and sums up
# to 5e5. Those of point-to-plane are areas times depths, about 1e-7 and at most 2.
SCALE = 2.0**44
FINE_SCALE = 2.0**52


class Forces:
    """Gradient of the energy of the pairs that a detection found, the same on every run.

    One launch, which sums in integers (see `SCALE`).
    """

    def __init__(self, descent: Descent) -> None:
        """Take energy, triangles and directions from `descent`."""
        warp = start_warp()
        faces = descent.faces.to(torch.int32).contiguous()
        direction = descent.direction
        if direction is None:
            direction = torch.zeros((0, 3), dtype=torch.float64, device=faces.device)
        self._kept = faces, direction.double().contiguous()
        self._faces = warp.from_torch(self._kept[0], dtype=warp.vec3i)
        self._direction = warp.from_torch(self._kept[1], dtype=warp.vec3d)
        self._energy = energy_parameters(descent.kernel)

    def __call__(self, points: Tensor, found: FixedDetection, going: Tensor) -> Tensor:
        """Return the gradient (B, V, 3) for the frames `going` (B,) of poses (B, V, 3)."""
        warp = start_warp()
        forces = torch.zeros(points.shape, dtype=torch.int64, device=points.device)
        exact = points.double().contiguous()
        inputs: list[Any] = [
            found.views["pairs"],
            found.views["count"],
            warp.from_torch(going, dtype=warp.bool),
            warp.from_torch(exact, dtype=warp.vec3d),
            self._faces,
            self._direction,
            self._energy,
            warp.from_torch(forces, dtype=warp.int64),
        ]
        found.queue.launch(kernels.push_pairs, found.capacity[1:], inputs)
        gradient: Tensor = (forces.double() / self._energy.scale).to(points.dtype)
        return gradient


def energy_parameters(kernel: Kernel) -> Any:
    """Return what the kernels need to know of an energy: a `gpu_kernels.Energy`."""
    energy = kernels.Energy()
    energy.noise, energy.scale = 8.0 * torch.finfo(torch.float64).eps, SCALE
    if isinstance(kernel, SignedTangentPoint | UnsignedTangentPoint):
        signed = isinstance(kernel, SignedTangentPoint)
        energy.kind = int(kernels.SIGNED_TANGENT_POINT if signed else kernels.TANGENT_POINT)
        energy.exponent, energy.power = float(kernel.exponent), float(kernel.power)
        energy.nearest = kernel.nearest
    elif isinstance(kernel, PointToPlane):
        energy.kind, energy.scale = int(kernels.POINT_TO_PLANE), FINE_SCALE
    else:
        assert isinstance(kernel, ConicalField), f"no kernel on a device for {kernel}"
        energy.kind, energy.height = int(kernels.CONICAL), kernel.height
        energy.nearest = kernel.nearest
    return energy


class RowOperator:
    """A sparse matrix (V, V) applied to fields (B, V, 3) on a device, rows summed in order."""

    def __init__(self, matrix: sparse.csr_matrix, queue: DeviceQueue) -> None:
        """Upload the matrix."""
        warp, rows = start_warp(), sparse.csr_matrix(matrix)
        self.queue = queue
        self._rows = [
            warp.array(np.ascontiguousarray(values), dtype=kind, device=queue.device)
            for values, kind in (
                (rows.indptr.astype(np.int32), warp.int32),
                (rows.indices.astype(np.int32), warp.int32),
                (rows.data.astype(np.float64), warp.float64),
            )
        ]

    def __call__(self, field: Tensor) -> Tensor:
        """Return matrix @ field of each frame, summed in double."""
        warp = start_warp()
        source = field.double().contiguous()
        result = torch.empty_like(source)
        inputs = [*self._rows, *(warp.from_torch(t, dtype=warp.vec3d) for t in (source, result))]
        self.queue.launch(kernels.multiply_rows, tuple(field.shape[:2]), inputs)
        return result.to(field.dtype)
