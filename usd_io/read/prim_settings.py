"""What a pipeline writes on a prim for a program to read: the values of one namespace."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from usd_io.read.mesh import AnimatedMesh


def read_constants(mesh: AnimatedMesh, namespace: str) -> dict[str, Any]:
    """Return all primvars and attributes of a mesh in a namespace, by the rest of their names.

    `primvars:NAMESPACE:x`, inherited from the prims above as constant primvars are, or else the
    custom attribute `NAMESPACE:x` of the mesh itself. Values at the default time, or else at the
    earliest; arrays of one element count as that element, longer ones come as numpy arrays.
    """
    prefix = f"{namespace}:"
    settings: dict[str, Any] = {}
    for attribute in mesh.prim.GetAttributes():
        if attribute.GetName().startswith(prefix):
            _take(settings, attribute.GetName().removeprefix(prefix), attribute)
    for primvar in UsdGeom.PrimvarsAPI(mesh.prim).FindPrimvarsWithInheritance():
        name = primvar.GetPrimvarName()
        # The indices of an indexed primvar are no value of their own.
        if name.startswith(prefix) and not name.endswith(":indices"):
            _take(settings, name.removeprefix(prefix), primvar.GetAttr())
    return settings


def _take(settings: dict[str, Any], name: str, attribute: Usd.Attribute) -> None:
    """Add the value of an attribute, if it has one, to the settings."""
    value = attribute.Get(Usd.TimeCode.Default())
    if value is None:
        value = attribute.Get(Usd.TimeCode.EarliestTime())
    if value is None:
        return
    if not isinstance(value, bool | int | float | str):
        array = np.asarray(value)
        value = array.reshape(-1)[0].item() if array.size == 1 else array
    settings[name] = value
