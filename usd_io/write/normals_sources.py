"""What a written mesh's output needs to know about its input: normals and rates of change."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from usd_io.normals import Polygons, recompute_normals
from usd_io.read.mesh import AnimatedMesh
from usd_io.times import time_code

VALUE_TYPES = {
    "points": Sdf.ValueTypeNames.Point3fArray,
    "extent": Sdf.ValueTypeNames.Float3Array,
    "normals": Sdf.ValueTypeNames.Normal3fArray,
    "primvars:normals": Sdf.ValueTypeNames.Normal3fArray,
    "velocities": Sdf.ValueTypeNames.Vector3fArray,
    "accelerations": Sdf.ValueTypeNames.Vector3fArray,
}
NORMALS = ("primvars:normals", "normals")
RATES = ("velocities", "accelerations")


@dataclass(frozen=True)
class NormalsSource:
    """Authored normals of an input mesh.

    Attributes:
        name: normals or primvars:normals.
        interpolation: vertex, varying, uniform, faceVarying or constant.
        indices: the primvar's indices attribute, invalid if the normals are not indexed.
        polygons: the topology.
    """

    name: str
    interpolation: str
    indices: Usd.Attribute | None
    polygons: Polygons

    def value(self, mesh: AnimatedMesh, time: float) -> NDArray[np.float32] | None:
        """The input's normals (N, 3) at a time code, None if there are none."""
        value = mesh.prim.GetAttribute(self.name).Get(time_code(time))
        return None if value is None else np.asarray(value, dtype=np.float32).reshape(-1, 3)

    def recomputed(
        self, mesh: AnimatedMesh, time: float, points: NDArray[np.floating]
    ) -> NDArray[np.float64] | None:
        """Normals for new points, None where they cannot be recomputed and must be blocked."""
        old = self.value(mesh, time)
        if old is None:
            return None
        slots = None
        if self.indices:
            slots = np.asarray(self.indices.Get(time_code(time)), dtype=np.int64)
        return recompute_normals(self.polygons, points, old, self.interpolation, slots)


def normals_sources(mesh: AnimatedMesh) -> list[NormalsSource]:
    """All authored normals of a mesh; `primvars:normals` wins over `normals` for clients."""
    geometry = mesh.geometry
    first = Usd.TimeCode.EarliestTime()
    sources = []
    for name in NORMALS:
        attribute = mesh.prim.GetAttribute(name)
        if not attribute or not attribute.HasAuthoredValue():
            continue
        primvar = UsdGeom.Primvar(attribute) if name == "primvars:normals" else None
        interpolation = (
            primvar.GetInterpolation() if primvar else geometry.GetNormalsInterpolation()
        )
        indexed = primvar is not None and primvar.IsIndexed()
        polygons = Polygons(
            np.asarray(geometry.GetFaceVertexCountsAttr().Get(first), dtype=np.int64),
            np.asarray(geometry.GetFaceVertexIndicesAttr().Get(first), dtype=np.int64),
            geometry.GetOrientationAttr().Get(first) == UsdGeom.Tokens.leftHanded,
        )
        indices = primvar.GetIndicesAttr() if primvar and indexed else None
        sources.append(NormalsSource(name, interpolation, indices, polygons))
    return sources


def authored_rates(mesh: AnimatedMesh) -> list[str]:
    """Which of velocities and accelerations the input has."""
    return [name for name in RATES if mesh.prim.GetAttribute(name).HasAuthoredValue()]


def create_attribute(layer: Sdf.Layer, prim_path: Sdf.Path, name: str) -> Sdf.Path:
    """Make an attribute of an `over` prim in a layer; its path. Existing ones are returned."""
    path = prim_path.AppendProperty(name)
    if not layer.GetAttributeAtPath(path):
        prim = Sdf.CreatePrimInLayer(layer, prim_path)
        Sdf.AttributeSpec(prim, name, VALUE_TYPES[name])
    return path


def vec3f_array(values: Any) -> Vt.Vec3fArray:
    """Any (N, 3) values as a Vec3fArray; one that is there already is passed through."""
    if isinstance(values, Vt.Vec3fArray):
        return values
    array = np.ascontiguousarray(values, dtype=np.float32).reshape(-1, 3)
    return Vt.Vec3fArray.FromNumpy(array)


def extent_of(points: NDArray[np.floating]) -> Vt.Vec3fArray | Sdf.ValueBlock:
    """Bounds [min, max] of the finite points (N, 3); a block if there is none."""
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        return Sdf.ValueBlock()
    return vec3f_array([finite.min(axis=0), finite.max(axis=0)])
