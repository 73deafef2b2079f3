"""What a written mesh's output needs to know about its input: normals and rates of change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from usd_io.normals import Polygons, recompute_normals
from usd_io.read.mesh import AnimatedMesh
from usd_io.times import time_code

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
        """Return the input's normals (N, 3) at a time code, None if there are none."""
        value = mesh.prim.GetAttribute(self.name).Get(time_code(time))
        return None if value is None else np.asarray(value, dtype=np.float32).reshape(-1, 3)

    def recomputed(
        self, mesh: AnimatedMesh, time: float, points: NDArray[np.floating]
    ) -> NDArray[np.float64] | None:
        """Return normals for new points; None where they must be blocked."""
        old = self.value(mesh, time)
        if old is None:
            return None
        slots = None
        if self.indices:
            slots = np.asarray(self.indices.Get(time_code(time)), dtype=np.int64)
        return recompute_normals(self.polygons, points, old, self.interpolation, slots)


def normals_sources(mesh: AnimatedMesh) -> list[NormalsSource]:
    """Return all authored normals of a mesh; for clients `primvars:normals` wins."""
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
    """Return which of velocities and accelerations the input has."""
    return [name for name in RATES if mesh.prim.GetAttribute(name).HasAuthoredValue()]
