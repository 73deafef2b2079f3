"""Normals of written meshes, and what else their output needs to know of the input."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from usd_io.normals import Polygons, recompute_normals
from usd_io.read.mesh import AnimatedMesh
from usd_io.times import time_code

NORMALS = ("primvars:normals", "normals")
RATES = ("velocities", "accelerations")


# Indices are written where they save at least this part of the normals.
_WORTH = 0.25


@dataclass(frozen=True)
class Slots:
    """Corners that share a normal: number of each corner's normal (C,), a corner of each (G,)."""

    numbers: NDArray[np.int32]
    first: NDArray[np.int64]


@dataclass(frozen=True)
class NormalsSource:
    """Authored normals of an input mesh.

    Attributes:
        name: normals or primvars:normals.
        interpolation: vertex, varying, uniform, faceVarying or constant.
        indices: the primvar's indices attribute, invalid if the normals are not indexed.
        polygons: the topology.
        slots: which corners share a normal; None where all are written.
    """

    name: str
    interpolation: str
    indices: Usd.Attribute | None
    polygons: Polygons
    slots: Slots | None = None

    @property
    def written_name(self) -> str:
        """The attribute that is written: only primvars have indices."""
        return self.name if self.slots is None else "primvars:normals"

    def stored(self, normals: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return normals (N, 3) as they are stored: those that corners share once."""
        return normals if self.slots is None else normals[self.slots.first]

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
    if len(sources) == 1 and sources[0].indices is None:
        return [replace(sources[0], slots=shared_slots(mesh, sources[0]))]
    return sources


def shared_slots(mesh: AnimatedMesh, source: NormalsSource) -> Slots | None:
    """Return which corners have the same vertex, and bit for bit the same normal at all times.

    None where they are not face-varying, do not fit, or where little would be saved.
    """
    if source.interpolation != UsdGeom.Tokens.faceVarying:
        return None
    vertices = source.polygons.indices
    groups = vertices.astype(np.int64)
    for time in mesh.prim.GetAttribute(source.name).GetTimeSamples() or [np.nan]:
        normals = source.value(mesh, float(time))
        if normals is None:
            continue
        if len(normals) != len(vertices):
            return None
        bits = np.ascontiguousarray(normals).view(np.uint32).astype(np.int64)
        _, first, numbers = np.unique(groups, return_index=True, return_inverse=True)
        groups = numbers.reshape(-1)
        if not np.array_equal(bits, bits[first[groups]]):
            key = np.column_stack([groups, bits])
            groups = np.unique(key, axis=0, return_inverse=True)[1].reshape(-1)
    _, first, numbers = np.unique(groups, return_index=True, return_inverse=True)
    if len(first) > (1.0 - _WORTH) * len(vertices):
        return None
    return Slots(numbers.reshape(-1).astype(np.int32), first)


def authored_rates(mesh: AnimatedMesh) -> list[str]:
    """Return which of velocities and accelerations the input has."""
    return [name for name in RATES if mesh.prim.GetAttribute(name).HasAuthoredValue()]
