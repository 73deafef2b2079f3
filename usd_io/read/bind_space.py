"""Displacements of posed points as displacements before the joints move them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usd_io.errors import FrameError
from usd_io.read.mesh import AnimatedMesh
from usd_io.read.reader import raw_points

# Joints that shrink a vertex's surroundings below this part cannot be undone.
SMALLEST_SCALE = 1e-6


def bind_offsets(
    mesh: AnimatedMesh, time: float, points: NDArray[np.floating]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what blend shapes have to add so that a mesh is posed as given.

    What joints do to a vertex is affine, whatever the method of skinning: it is measured with
    UsdSkel at the vertex and one step along each axis from it.

    Args:
        mesh: skinned or not.
        time: time code.
        points: where the posed points are to be (V, 3), local space of the mesh.

    Returns:
        Offsets (V, 3) in the space of the unposed points, and the largest factor (V,) by which
        joints stretch them. Vertices that are at their place have zero offsets.

    Raises:
        FrameError: the mesh has no points then, or joints flatten it where it is to move.
    """
    base = raw_points(mesh, time) if mesh.skin is None else mesh.skin.unposed(time)
    if base is None:
        raise FrameError(mesh.path, time, "the sample is blocked; leave the frame out")
    old = base if mesh.skin is None else mesh.skin.posed(base, time)
    wanted = np.asarray(points, dtype=np.float64)
    moved = (np.asarray(points, dtype=np.float32) != old).any(axis=1)
    if mesh.skin is None or not moved.any():
        return np.where(moved[:, None], wanted - base, 0.0), np.ones(len(base))
    linear = _linear_parts(mesh, time, base, old)
    scales = np.linalg.svd(linear[moved], compute_uv=False)
    if scales[:, 2].min() <= SMALLEST_SCALE * max(float(scales[:, 0].max()), 1e-30):
        raise FrameError(mesh.path, time, "the joints flatten what is to move; mend them")
    offsets = np.zeros((len(base), 3))
    # Again, as the first step has the rounding of measuring.
    for _ in range(2):
        posed = mesh.skin.posed(base + offsets, time)
        left = (wanted - posed)[moved]
        offsets[moved] += np.linalg.solve(linear[moved].transpose(0, 2, 1), left[:, :, None])[
            ..., 0
        ]
    stretch = np.ones(len(base))
    stretch[moved] = scales[:, 0]
    return offsets, stretch


def _linear_parts(
    mesh: AnimatedMesh, time: float, base: NDArray[np.float32], old: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Return the linear part (V, 3, 3) of what joints do: posed = unposed @ part + ..."""
    assert mesh.skin is not None
    step = max(float(np.ptp(base, axis=0).max()), 1e-30)
    rows = []
    for axis in range(3):
        there = base.copy()
        there[:, axis] += np.float32(step)
        # Divided by the step that float32 made of it.
        taken = there[:, axis].astype(np.float64) - base[:, axis]
        rows.append((mesh.skin.posed(there, time).astype(np.float64) - old) / taken[:, None])
    return np.stack(rows, axis=1)
