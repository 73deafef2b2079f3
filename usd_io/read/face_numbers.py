"""A whole number for each triangle, out of a primvar of faces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from usd_io.errors import StageError
from usd_io.read.mesh import AnimatedMesh
from usd_io.read.vertex_weights import find_primvar


def read_face_numbers(mesh: AnimatedMesh, name: str) -> NDArray[np.int32] | None:
    """Return a whole number for each triangle (F,) of a mesh; None without a primvar of that name.

    A primvar (`name` with or without `primvars:`) of integers with uniform interpolation, one for
    each face, or constant, one for the mesh; at the default time, or else its earliest sample.

    Raises:
        StageError: another interpolation or type, or a wrong count.
    """
    primvar = find_primvar(mesh, name)
    if primvar is None:
        return None
    where = f"{mesh.path}: primvar {name}"
    value = primvar.ComputeFlattened(Usd.TimeCode.Default())
    if value is None:
        value = primvar.ComputeFlattened(Usd.TimeCode.EarliestTime())
    numbers = np.asarray(value)
    if numbers.dtype.kind not in "iu" or (np.abs(numbers.astype(np.float64)) >= 2**31).any():
        raise StageError(f"{where}: expected 32-bit whole numbers, got {primvar.GetTypeName()}")
    interpolation = primvar.GetInterpolation()
    if interpolation == UsdGeom.Tokens.constant and numbers.size == 1:
        return np.full(len(mesh.faces), numbers.reshape(-1)[0], dtype=np.int32)
    counts = mesh.geometry.GetFaceVertexCountsAttr().Get(Usd.TimeCode.EarliestTime())
    if interpolation != UsdGeom.Tokens.uniform or numbers.shape != (len(counts),):
        raise StageError(
            f"{where}: expected one number for each of {len(counts)} faces, or one for the mesh, "
            f"got {numbers.size} with {interpolation} interpolation"
        )
    return numbers.astype(np.int32)[mesh.polygons]
