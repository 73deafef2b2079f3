"""The meshes of a request as a USD stage, and repaired points out of the layer over it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, Vt

from ..host.exchange import Request, SampledMesh

PIN, DIRECTION = "dtrepairPin", "dtrepairDirection"


def prim_paths(request: Request) -> list[str]:
    """Return a path for each mesh, near to its name, since messages tell it."""
    paths: list[str] = []
    for mesh in request.meshes:
        stem = path = "/" + Tf.MakeValidIdentifier(mesh.name)
        number = 1
        while path in paths:
            number += 1
            path = f"{stem}_{number}"
        paths.append(path)
    return paths


def write_cache(request: Request, points: Mapping[str, NDArray[Any]], path: Path) -> None:
    """Write the meshes that moved, with their repaired points (see `read_points`)."""
    meshes = tuple(
        replace(mesh, points=points[f"{index}.points"], pin=None, direction=None)
        for index, mesh in enumerate(request.meshes)
    )
    both = zip(request.meshes, meshes, strict=True)
    changed = [not np.array_equal(old.points, new.points) for old, new in both]
    write_stage(replace(request, meshes=meshes), path, changed)


def write_stage(request: Request, path: Path, chosen: Sequence[bool] | None = None) -> None:
    """Write the meshes, or those chosen; the rest pose stands at the default time."""
    layer = Sdf.Layer.CreateNew(str(path))
    stage = Usd.Stage.Open(layer)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    named = list(zip(request.meshes, prim_paths(request), strict=True))
    named = named if chosen is None else list(compress(named, chosen))
    with Sdf.ChangeBlock():
        for _, name in named:
            Sdf.CreatePrimInLayer(layer, name).specifier = Sdf.SpecifierDef
    for mesh, name in named:
        _write_mesh(UsdGeom.Mesh.Define(stage, name), mesh, request.frames)
    layer.Save()


def read_points(layer: Path, request: Request) -> dict[str, NDArray[Any]]:
    """Return points (T, V, 3) of each mesh, from the layer that a repair wrote over the stage."""
    stage = Usd.Stage.Open(str(layer))
    found = {}
    for index, path in enumerate(prim_paths(request)):
        points = UsdGeom.Mesh(stage.GetPrimAtPath(path)).GetPointsAttr()
        found[f"{index}.points"] = np.stack([np.array(points.Get(f)) for f in request.frames])
    return found


def _write_mesh(prim: UsdGeom.Mesh, mesh: SampledMesh, frames: tuple[int, ...]) -> None:
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(mesh.counts))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.corners))
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    points = prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(mesh.rest))
    place = prim.AddTransformOp()
    place.Set(Gf.Matrix4d(mesh.rest_matrix.T.tolist()))
    for frame, pose, matrix in zip(frames, mesh.points, mesh.matrices, strict=True):
        points.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(pose)), frame)
        place.Set(Gf.Matrix4d(matrix.T.tolist()), frame)
    primvars = UsdGeom.PrimvarsAPI(prim)
    vertex, kinds = UsdGeom.Tokens.vertex, Sdf.ValueTypeNames
    if mesh.pin is not None:
        values = Vt.FloatArray.FromNumpy(mesh.pin)
        primvars.CreatePrimvar(PIN, kinds.FloatArray, vertex).Set(values)
    if mesh.direction is not None:
        vectors = Vt.Vec3fArray.FromNumpy(mesh.direction)
        primvars.CreatePrimvar(DIRECTION, kinds.Vector3fArray, vertex).Set(vectors)
