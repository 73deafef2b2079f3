"""Meshes between local and world space, in float64; for the matrices see `usd_io.read.matrices`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from usd_io.read.matrices import chain_times, inverse_matrix, prim_matrix
from usd_io.read.mesh import AnimatedMesh

# Of many small meshes each is placed a dozen times before a frame is counted.
MOST_KEPT = 2**16


def world_matrix(mesh: AnimatedMesh, time: float) -> NDArray[np.float64]:
    """Return the local to world matrix (4, 4) float64 of a mesh; see `prim_matrix`."""
    return prim_matrix(mesh.prim, time)


class WorldMatrices:
    """World matrices of meshes, each read once for a time: of a stage that does not change."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, float | None], NDArray[np.float64]] = {}

    def __call__(self, mesh: AnimatedMesh, time: float) -> NDArray[np.float64]:
        """Return what `world_matrix` returns, not to be changed."""
        # NaN, the default time, is no key: it differs from itself.
        key = mesh.path, None if math.isnan(time) else time
        if (found := self._kept.get(key)) is None:
            found = world_matrix(mesh, time)
            found.flags.writeable = False
            if len(self._kept) >= MOST_KEPT:
                self._kept.clear()
            self._kept[key] = found
        return found


def transform_times(mesh: AnimatedMesh) -> NDArray[np.float64]:
    """Return time codes (N,), sorted, of all animated transforms from the mesh to the root."""
    return np.array(sorted(chain_times(mesh.prim)), dtype=np.float64)


def local_points(mesh: AnimatedMesh, time: float, world: ArrayLike) -> NDArray[np.float64]:
    """Return world points (..., 3) in the local space of the mesh at a time code, float64."""
    matrix = world_matrix(mesh, time)
    inverse = inverse_matrix(matrix, path=mesh.path, time=time)
    # Subtract the offset before turning: no digits are lost far from the origin.
    centred = np.asarray(world, dtype=np.float64) - matrix[3, :3]
    local: NDArray[np.float64] = centred @ inverse[:3, :3]
    return local


def world_faces(mesh: AnimatedMesh, time: float) -> NDArray[np.int32]:
    """Return triangles (F, 3) int32 for world space: flipped where the transform mirrors."""
    if np.linalg.det(world_matrix(mesh, time)[:3, :3]) < 0.0:
        return np.ascontiguousarray(mesh.faces[:, [0, 2, 1]])
    return mesh.faces
