"""Parts of the published loop as launches on a device: forces, and sparse matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from scipy import sparse
from torch import Tensor

from dtrepair.device import start_warp
from dtrepair.intersect.detector import Detector
from dtrepair.repair.descent import Descent
from dtrepair.repair.descent_kernels import FORCE_UNITS, multiply_rows, push_pairs
from dtrepair.repair.energy import (
    NEAREST,
    SignedTangentPoint,
    UnsignedTangentPoint,
    pair_energy,
)
from dtrepair.repair.fixed_detection import FixedDetection


class Forces:
    """Gradient of the energy of the pairs that a detection found, the same on every run.

    Tangent-point energies take one launch, which sums in integers (see `FORCE_UNITS`); the other
    kernels are evaluated by PyTorch on all slots of the buffer.
    """

    def __init__(self, descent: Descent, detector: Detector) -> None:
        """Take energy, triangles and directions from `descent`."""
        self.descent, self.device = descent, detector.device
        warp = start_warp()
        faces = descent.faces.to(torch.int32).contiguous()
        direction = descent.direction
        if direction is None:
            direction = torch.zeros((0, 3), dtype=torch.float64, device=faces.device)
        self._kept = faces, direction.double().contiguous()
        self._faces = warp.from_torch(self._kept[0], dtype=warp.vec3i)
        self._direction = warp.from_torch(self._kept[1], dtype=warp.vec3d)

    def __call__(self, points: Tensor, found: FixedDetection, going: Tensor) -> Tensor:
        """Gradient (B, V, 3) for the frames `going` (B,) of poses (B, V, 3)."""
        warp, kernel = start_warp(), self.descent.kernel
        if not isinstance(kernel, (SignedTangentPoint, UnsignedTangentPoint)):
            return self._by_torch(points, found, going)
        forces = torch.zeros(points.shape, dtype=torch.int64, device=points.device)
        exact = points.double().contiguous()
        inputs: list[Any] = [
            found.views["pairs"],
            found.views["count"],
            warp.from_torch(going, dtype=warp.bool),
            warp.from_torch(exact, dtype=warp.vec3d),
            self._faces,
            self._direction,
            float(kernel.exponent),
            float(kernel.power),
            int(isinstance(kernel, SignedTangentPoint)),
            NEAREST,
            8.0 * torch.finfo(points.dtype).eps,
            warp.from_torch(forces, dtype=warp.int64),
        ]
        warp.launch(push_pairs, dim=found.capacity[1], inputs=inputs, device=self.device)
        return (forces.double() / FORCE_UNITS).to(points.dtype)

    def _by_torch(self, points: Tensor, found: FixedDetection, going: Tensor) -> Tensor:
        slots = torch.arange(len(found.pairs), device=points.device)
        pairs = torch.where((slots < found.count)[:, None], found.pairs, 0).long()
        weights = ((slots < found.count) & going[pairs[:, 0]]).to(points.dtype)
        _, gradient = pair_energy(
            points,
            self.descent.faces,
            pairs,
            kernel=self.descent.kernel,
            weights=weights,
            direction=self.descent.direction,
        )
        return gradient


class RowOperator:
    """A sparse matrix (V, V) applied to fields (B, V, 3) on a device, rows summed in order."""

    def __init__(self, matrix: sparse.csr_matrix, *, device: str) -> None:
        """Upload the matrix."""
        warp, rows = start_warp(), sparse.csr_matrix(matrix)
        self.device = device
        self._rows = [
            warp.array(np.ascontiguousarray(values), dtype=kind, device=device)
            for values, kind in (
                (rows.indptr.astype(np.int32), warp.int32),
                (rows.indices.astype(np.int32), warp.int32),
                (rows.data.astype(np.float64), warp.float64),
            )
        ]

    def __call__(self, field: Tensor) -> Tensor:
        """matrix @ field of each frame, summed in double."""
        warp = start_warp()
        source = field.double().contiguous()
        result = torch.empty_like(source)
        inputs = [*self._rows, *(warp.from_torch(t, dtype=warp.vec3d) for t in (source, result))]
        warp.launch(multiply_rows, dim=tuple(field.shape[:2]), inputs=inputs, device=self.device)
        return result.to(field.dtype)
