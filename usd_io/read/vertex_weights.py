"""A number or a vector for each vertex, out of a primvar or a GeomSubset: what artists paint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from usd_io.errors import StageError
from usd_io.read.mesh import AnimatedMesh

_PER_VERTEX = (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying)


def read_vertex_weights(mesh: AnimatedMesh, name: str) -> NDArray[np.float64] | None:
    """Return weights (V,) from 0 to 1 of a mesh; None if it has nothing of that name.

    A primvar (`name` with or without `primvars:`) of numbers with vertex, varying or constant
    interpolation, taken at the default time or else its earliest sample; or a GeomSubset below the
    mesh: 1 at its points, or at the corners of its faces, and 0 elsewhere.

    Raises:
        StageError: another interpolation or type, a wrong count, numbers outside 0..1, or indices
            out of range.
    """
    primvar = find_primvar(mesh, name)
    if primvar is not None:
        weights = _values(mesh, primvar, name, "number", ())
        if not ((weights >= 0.0) & (weights <= 1.0)).all():
            raise StageError(
                f"{mesh.path}: primvar {name}: expected numbers from 0 to 1; scale them"
            )
        return weights
    for child in mesh.prim.GetChildren():
        if child.GetName() == name and child.IsA(UsdGeom.Subset):
            return _from_subset(mesh, UsdGeom.Subset(child))
    return None


def read_vertex_directions(mesh: AnimatedMesh, name: str) -> NDArray[np.float64] | None:
    """Return vectors (V, 3) of a primvar, of any length; None if there is none.

    Vertex, varying or constant interpolation, taken as `read_vertex_weights` does.

    Raises:
        StageError: another interpolation or type, a wrong count, or NaN or infinity.
    """
    primvar = find_primvar(mesh, name)
    if primvar is None:
        return None
    vectors = _values(mesh, primvar, name, "vector", (3,))
    if not np.isfinite(vectors).all():
        raise StageError(f"{mesh.path}: primvar {name}: expected finite vectors; mend it")
    return vectors


def find_primvar(mesh: AnimatedMesh, name: str) -> UsdGeom.Primvar | None:
    """Return the primvar of a name, with or without its namespace; None if there is none."""
    primvars = UsdGeom.PrimvarsAPI(mesh.prim)
    primvar = primvars.FindPrimvarWithInheritance(name.removeprefix("primvars:"))
    return primvar if primvar and primvar.HasAuthoredValue() else None


def _values(
    mesh: AnimatedMesh, primvar: UsdGeom.Primvar, name: str, what: str, shape: tuple[int, ...]
) -> NDArray[np.float64]:
    """Return one number or vector for each vertex, (V, *shape). Raises StageError."""
    where = f"{mesh.path}: primvar {name}"
    value = primvar.ComputeFlattened(Usd.TimeCode.Default())
    if value is None:
        value = primvar.ComputeFlattened(Usd.TimeCode.EarliestTime())
    try:
        values = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise StageError(f"{where}: expected a {what}, got {primvar.GetTypeName()}") from None
    interpolation = primvar.GetInterpolation()
    expected = (len(mesh.rest), *shape)
    if interpolation == UsdGeom.Tokens.constant and values.size == int(np.prod(shape)):
        return np.broadcast_to(values.reshape(shape), expected).copy()
    if interpolation not in _PER_VERTEX or values.shape != expected:
        raise StageError(
            f"{where}: expected one {what} for each of {len(mesh.rest)} vertices, got "
            f"{values.shape} with {interpolation} interpolation"
        )
    return values


def _from_subset(mesh: AnimatedMesh, subset: UsdGeom.Subset) -> NDArray[np.float64]:
    """Return 1 for the vertices of a subset and 0 for others, (V,). Raises StageError."""
    where = f"{mesh.path}: GeomSubset {subset.GetPrim().GetName()}"
    kind = subset.GetElementTypeAttr().Get()
    indices = np.asarray(_first(subset.GetIndicesAttr()), dtype=np.int64).reshape(-1)
    if kind == UsdGeom.Tokens.face:
        counts = np.asarray(_first(mesh.geometry.GetFaceVertexCountsAttr()), dtype=np.int64)
        corners = np.asarray(_first(mesh.geometry.GetFaceVertexIndicesAttr()), dtype=np.int64)
        _check_range(where, indices, len(counts), "faces")
        in_subset = np.zeros(len(counts), dtype=bool)
        in_subset[indices] = True
        indices = corners[np.repeat(in_subset, counts)]
    elif kind != UsdGeom.Tokens.point:
        raise StageError(f"{where}: expected elements of type face or point, got {kind}")
    _check_range(where, indices, len(mesh.rest), "points")
    weights = np.zeros(len(mesh.rest))
    weights[indices] = 1.0
    return weights


def _first(attribute: Usd.Attribute) -> object:
    """Return the earliest value of an attribute, () where it has none."""
    value = attribute.Get(Usd.TimeCode.EarliestTime())
    return () if value is None else value


def _check_range(where: str, indices: NDArray[np.int64], count: int, what: str) -> None:
    """Raise StageError for indices outside 0..count - 1."""
    wrong = indices[(indices < 0) | (indices >= count)]
    if len(wrong):
        raise StageError(f"{where}: expected indices below {count} ({what}), got {wrong[0]}")
