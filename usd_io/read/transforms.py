"""Meshes between local and world space, in float64, and where a scale or visibility hides them.

For the matrices of prims see `usd_io.read.matrices`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pxr import Sdf, Usd, UsdGeom

from usd_io.diagnostics import reading_frame
from usd_io.read.matrices import chain_times, inverse_matrix, prim_matrix
from usd_io.read.mesh import AnimatedMesh
from usd_io.read.select import visibility_times
from usd_io.times import time_code

Matrix = NDArray[np.float64]
# Of many small meshes each is placed a dozen times before a frame is counted.
MOST_KEPT = 2**16
# A transform smaller than this share of what it grows to hides what is below it ...
NOTHING = 0.01
# ... and where it has this share of that, it tells what it would be.
LARGE = 0.5


def world_matrix(mesh: AnimatedMesh, time: float) -> NDArray[np.float64]:
    """Return the local to world matrix (4, 4) float64 of a mesh; see `prim_matrix`."""
    return prim_matrix(mesh.prim, time)


def transform_times(mesh: AnimatedMesh) -> NDArray[np.float64]:
    """Return time codes (N,), sorted, of all animated transforms from the mesh to the root."""
    return np.array(sorted(chain_times(mesh.prim)), dtype=np.float64)


def local_points(
    mesh: AnimatedMesh, time: float, world: ArrayLike, matrix: Matrix | None = None
) -> NDArray[np.float64]:
    """Return world points (..., 3) in the local space of the mesh at a time code, float64.

    matrix: local to world (4, 4); None: see `world_matrix`.
    """
    matrix = world_matrix(mesh, time) if matrix is None else matrix
    inverse = inverse_matrix(matrix, path=mesh.path, time=time)
    # Subtract the offset before turning: no digits are lost far from the origin.
    centred = np.asarray(world, dtype=np.float64) - matrix[3, :3]
    local: NDArray[np.float64] = centred @ inverse[:3, :3]
    return local


def world_faces(mesh: AnimatedMesh, time: float) -> NDArray[np.int32]:
    """Return triangles (F, 3) int32 for world space: flipped where the transform mirrors."""
    if np.linalg.det(WorldMatrices()(mesh, time)[:3, :3]) < 0.0:
        return np.ascontiguousarray(mesh.faces[:, [0, 2, 1]])
    return mesh.faces


class WorldMatrices:
    """World matrices of meshes, each read once for a time: of a stage that does not change.

    Where a scale hides a mesh, its matrix is what it would be with the scale of the nearest time at
    which it can be seen. visibility: whether what is invisible at a time counts as hidden, too.
    """

    def __init__(self, *, visibility: bool = True) -> None:
        self._visibility = visibility
        self._kept: dict[tuple[str, float | None], tuple[Matrix, bool]] = {}
        self._growing: dict[Sdf.Path, list[_Growing]] = {}
        self._chains: dict[Sdf.Path, list[UsdGeom.Xformable]] = {}
        self._switched: dict[Sdf.Path, bool] = {}

    def __call__(self, mesh: AnimatedMesh, time: float) -> Matrix:
        """Return the local to world matrix (4, 4) float64, not to be changed; see `prim_matrix`."""
        return self._found(mesh, time)[0]

    def hidden(self, mesh: AnimatedMesh, time: float) -> bool:
        """Return whether a mesh that is seen at other times is hidden at this one."""
        if self._found(mesh, time)[1]:
            return True
        if not self._visibility or not self._switches(mesh.prim):
            return False
        seen = UsdGeom.Imageable(mesh.prim).ComputeVisibility(time_code(time))
        return bool(seen == UsdGeom.Tokens.invisible)

    def _found(self, mesh: AnimatedMesh, time: float) -> tuple[Matrix, bool]:
        """Return the matrix, and whether a scale hides the mesh."""
        # NaN, the default time, is no key: it differs from itself.
        key = mesh.path, None if math.isnan(time) else time
        if (found := self._kept.get(key)) is None:
            found = self._read(mesh, time)
            found[0].flags.writeable = False
            if len(self._kept) >= MOST_KEPT:
                self._kept.clear()
            self._kept[key] = found
        return found

    def _read(self, mesh: AnimatedMesh, time: float) -> tuple[Matrix, bool]:
        with reading_frame(mesh.path, time):
            code = Usd.TimeCode.EarliestTime() if math.isnan(time) else time_code(time)
            chain = self._chain(mesh.prim)
            if not any(own.nothing(code) for one in chain for own in self._growing_of(one)):
                return world_matrix(mesh, time), False
            matrix = np.eye(4)
            for one in chain:
                matrix = matrix @ self._grown(one, code)
        return matrix, True

    def _grown(self, prim: UsdGeom.Xformable, code: Usd.TimeCode) -> Matrix:
        """Return the local matrix (4, 4) of a prim whose transforms are not nothing."""
        growing = {own.operation.GetOpName(): own for own in self._growing_of(prim)}
        matrix = np.eye(4)
        for operation in reversed(prim.GetOrderedXformOps()):
            own = growing.get(operation.GetOpName())
            grown = own.grown(code) if own else np.array(operation.GetOpTransform(code))
            matrix = matrix @ grown
        return matrix

    def _chain(self, prim: Usd.Prim) -> list[UsdGeom.Xformable]:
        """Return a prim and those above it that move it; none where nothing may hide it."""
        path = prim.GetPath()
        if path not in self._chains:
            chain = _movable(prim)
            grows = any(self._growing_of(one) for one in chain)
            self._chains[path] = chain if grows else []
        return self._chains[path]

    def _growing_of(self, prim: UsdGeom.Xformable) -> list[_Growing]:
        path = prim.GetPath()
        if path not in self._growing:
            operations = prim.GetOrderedXformOps()
            self._growing[path] = [own for one in operations if (own := _growing(one))]
        return self._growing[path]

    def _switches(self, prim: Usd.Prim) -> bool:
        """Return whether the visibility of a prim, or of one above it, changes over time."""
        path = prim.GetPath()
        if path not in self._switched:
            self._switched[path] = len(visibility_times(prim)) > 1
        return self._switched[path]


class _Growing(NamedTuple):
    """A transform that is nothing at some times, and the times (N,) at which it is large."""

    operation: UsdGeom.XformOp
    large: NDArray[np.float64]
    size: float

    def nothing(self, code: Usd.TimeCode) -> bool:
        return _size(self.operation, code) < NOTHING * self.size

    def grown(self, code: Usd.TimeCode) -> Matrix:
        """Return its matrix (4, 4); where it is nothing, of the nearest time at which it is not."""
        matrix = np.array(self.operation.GetOpTransform(code))
        if self.nothing(code):
            time = max(code.GetValue(), self.large[0])
            nearest = float(self.large[np.abs(self.large - time).argmin()])
            matrix[:3, :3] = np.array(self.operation.GetOpTransform(nearest))[:3, :3]
        return matrix


def _growing(operation: UsdGeom.XformOp) -> _Growing | None:
    """Return a transform that is nothing at one of its samples; None of others."""
    if operation.GetOpType() not in (UsdGeom.XformOp.TypeScale, UsdGeom.XformOp.TypeTransform):
        return None
    times = np.array(operation.GetTimeSamples(), dtype=np.float64)
    if len(times) < 2:
        return None
    sizes = np.array([_size(operation, Usd.TimeCode(time)) for time in times])
    # The inverse of nothing is no number.
    if not (np.isfinite(sizes).all() and sizes.min() < NOTHING * sizes.max()):
        return None
    return _Growing(operation, times[sizes >= LARGE * sizes.max()], float(sizes.max()))


def _size(operation: UsdGeom.XformOp, code: Usd.TimeCode) -> float:
    """Return the length of the longest axis of a transform."""
    linear = np.array(operation.GetOpTransform(code))[:3, :3]
    return float(np.linalg.norm(linear, axis=1).max())


def _movable(prim: Usd.Prim) -> list[UsdGeom.Xformable]:
    """Return a prim and what is above it, as far as transforms are inherited."""
    found = []
    while prim and not prim.IsPseudoRoot():
        movable = UsdGeom.Xformable(prim)
        if movable:
            found.append(movable)
            if movable.GetResetXformStack():
                break
        prim = prim.GetParent()
    return found
