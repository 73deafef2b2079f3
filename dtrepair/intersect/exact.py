"""Pairs of triangles that floating point cannot settle, settled exactly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import IntArray


def settled(points: NDArray[np.float32], faces: IntArray, pairs: IntArray) -> NDArray[np.bool_]:
    """Return whether the closed triangles of each pair have a common point (K,).

    points: poses (B, V, 3); faces: (F, 3); pairs: (K, 3), frame, triangle, triangle. A triangle
    without area is the segment, or the point, that its corners span.
    """
    if len(pairs) == 0:
        return np.zeros(0, dtype=bool)
    from dtrepair.device import start_warp
    from dtrepair.intersect.exact_kernels import settle

    warp = start_warp()
    arrays = [
        warp.array(np.ascontiguousarray(values, dtype), dtype=kind, device="cpu", copy=False)
        for values, dtype, kind in (
            (pairs, np.int32, warp.vec3i),
            ([len(pairs)], np.int32, warp.int32),
            (points, np.float32, warp.vec3f),
            (faces, np.int32, warp.vec3i),
        )
    ]
    meet = warp.empty(len(pairs), dtype=warp.bool, device="cpu")
    warp.launch(settle, dim=len(pairs), inputs=[*arrays, meet], device="cpu")
    verdicts: NDArray[np.bool_] = meet.numpy()
    return verdicts


__all__ = ["settled"]
