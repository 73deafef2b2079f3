"""Arrays of numbers as values of attributes, and the attributes that hold them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Vt

VALUE_TYPES = {
    "points": Sdf.ValueTypeNames.Point3fArray,
    "extent": Sdf.ValueTypeNames.Float3Array,
    "normals": Sdf.ValueTypeNames.Normal3fArray,
    "primvars:normals": Sdf.ValueTypeNames.Normal3fArray,
    "primvars:normals:indices": Sdf.ValueTypeNames.IntArray,
    "velocities": Sdf.ValueTypeNames.Vector3fArray,
    "accelerations": Sdf.ValueTypeNames.Vector3fArray,
}


def create_attribute(layer: Sdf.Layer, prim_path: Sdf.Path, name: str) -> Sdf.Path:
    """Create an attribute of an `over` prim in a layer and return its path.

    One that exists is kept.
    """
    path = prim_path.AppendProperty(name)
    if not layer.GetAttributeAtPath(path):
        prim = Sdf.CreatePrimInLayer(layer, prim_path)
        Sdf.AttributeSpec(prim, name, VALUE_TYPES[name])
    return path


def vec3f_array(values: Any) -> Vt.Vec3fArray:
    """Return values (N, 3) as a Vec3fArray; one that is there already is passed through."""
    if isinstance(values, Vt.Vec3fArray):
        return values
    array = np.ascontiguousarray(values, dtype=np.float32).reshape(-1, 3)
    return Vt.Vec3fArray.FromNumpy(array)


def point_rows(value: object) -> NDArray[np.floating]:
    """Return the value of points as numpy has it, (N, 3). Raises ValueError for another type."""
    try:
        points = np.asarray(value)
    except (TypeError, ValueError):
        points = np.zeros(())
    if points.size == 0 and points.ndim:
        return np.zeros((0, 3), dtype=np.float32)
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise ValueError(f"points should be of type point3f[], got {_type_text(value)}")
    return points


def index_row(value: object, name: str) -> NDArray[np.int64]:
    """Return the value of an attribute of whole numbers, (N,). None counts as no numbers.

    Raises ValueError for another type.
    """
    if value is None:
        return np.zeros(0, dtype=np.int64)
    try:
        numbers = np.asarray(value)
    except (TypeError, ValueError):
        numbers = np.zeros(())
    if numbers.ndim != 1 or (numbers.size and numbers.dtype.kind not in "iu"):
        raise ValueError(f"{name} should be of type int[], got {_type_text(value)}")
    return numbers.astype(np.int64)


def _type_text(value: object) -> str:
    """Return the type of a value in a few words."""
    return type(value).__name__


def extent_of(points: NDArray[np.floating]) -> Vt.Vec3fArray | Sdf.ValueBlock:
    """Return the bounds [min, max] of the finite points (N, 3); a block if there is none."""
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        return Sdf.ValueBlock()
    return vec3f_array([finite.min(axis=0), finite.max(axis=0)])
