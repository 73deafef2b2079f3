"""Pairs of triangles that floating point cannot settle, settled exactly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtrepair.device import start_warp
from dtrepair.intersect.topology.device_mesh import DeviceMesh
from dtrepair.numerics.geometry import IntArray


def settled(mesh: DeviceMesh, points: NDArray[np.float32], pairs: IntArray) -> NDArray[np.bool_]:
    """Return whether the closed triangles of each pair have a common point (K,).

    points: poses (B, V, 3) of `mesh`; pairs: (K, 3), frame, triangle, triangle. A triangle without
    area is the segment, or the point, that its corners span.
    """
    if len(pairs) == 0:
        return np.zeros(0, dtype=bool)
    from dtrepair.intersect.exact_kernels import settle

    warp, device = start_warp(), mesh.device
    arrays = [
        device.view(np.ascontiguousarray(values, dtype), kind)
        for values, dtype, kind in (
            (pairs, np.int32, warp.vec3i),
            ([len(pairs)], np.int32, warp.int32),
            (points, np.float32, warp.vec3f),
        )
    ]
    meet = device.empty(len(pairs), warp.bool)
    device.launch(settle, len(pairs), [*arrays, mesh.faces, meet])
    verdicts: NDArray[np.bool_] = meet.numpy()
    return verdicts


__all__ = ["settled"]
