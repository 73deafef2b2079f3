"""Writes the stages of `scene_stages.py` and reads back any stage in world space, by pxr alone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.scene_stages import Stage
from dtrepair.numerics.geometry import FloatArray, IntArray, weld_map


@dataclass(frozen=True)
class World:
    """The meshes of a stage in world space at its time codes: points (T, V, 3), faces (F, 3).

    bits: what the stage holds for each mesh, frame by frame, in the space of the mesh.
    """

    paths: list[str]
    faces: list[IntArray]
    points: list[FloatArray]
    bits: list[list[bytes]]

    def joined(self, frame: int) -> tuple[FloatArray, IntArray]:
        """All meshes of a frame as one."""
        faces = [own + start for own, start in zip(self.faces, self._starts(), strict=False)]
        return np.concatenate([own[frame] for own in self.points]), np.concatenate(faces)

    def weld(self) -> IntArray:
        """Vertices of a mesh at one position of the first frame count as one."""
        pairs = zip(self.points, self._starts(), strict=False)
        return np.concatenate([weld_map(own[0]) + start for own, start in pairs]).astype(np.int32)

    def _starts(self) -> IntArray:
        return np.cumsum([0, *(own.shape[1] for own in self.points)]).astype(np.int32)


def read_world(path: Path) -> World:
    """Every mesh of a stage at every time code of its range; polygons as fans."""
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    codes = [Usd.TimeCode(0.0)]
    if stage.HasAuthoredTimeCodeRange():
        first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
        codes = [Usd.TimeCode(time) for time in np.arange(first, last + 0.5)]
    result = World([], [], [], [])
    for prim in stage.Traverse():
        if not prim.IsA(UsdGeom.Mesh):
            continue
        values = [np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get(code)) for code in codes]
        caches = [UsdGeom.XformCache(code) for code in codes]
        worlds = [np.array(cache.GetLocalToWorldTransform(prim)) for cache in caches]
        placed = [
            points.astype(np.float64) @ matrix[:3, :3] + matrix[3, :3]
            for points, matrix in zip(values, worlds, strict=True)
        ]
        faces = _triangles(UsdGeom.Mesh(prim))
        mirrored = np.linalg.det(worlds[0][:3, :3]) < 0
        result.paths.append(str(prim.GetPath()))
        result.faces.append(faces[:, ::-1] if mirrored else faces)
        result.points.append(np.stack(placed))
        result.bits.append([points.tobytes() for points in values])
    return result


def _triangles(mesh: Any) -> IntArray:
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get())
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get())
    first = np.repeat(np.cumsum(counts) - counts, counts - 2)
    step = np.concatenate([np.arange(1, count - 1) for count in counts])
    fans = np.stack([first, first + step, first + step + 1], axis=1)
    triangles: IntArray = corners[fans].astype(np.int32)
    return triangles


def write_stage(stage: Stage, path: Path) -> None:
    """Write a stage with one Xform for each parent."""
    from pxr import Gf, Usd, UsdGeom, Vt

    usd = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(usd, stage.up)
    UsdGeom.SetStageMetersPerUnit(usd, stage.metres)
    every = [time for part in stage.parts for time in part.times]
    if every:
        usd.SetStartTimeCode(min(every))
        usd.SetEndTimeCode(max(every))
    still = (Usd.TimeCode.Default(),)
    for part in stage.parts:
        prim_path = f"/World/{part.name}"
        for level, matrix in enumerate(part.parents):
            prim_path += f"/Parent{level}"
            operation = UsdGeom.Xform.Define(usd, prim_path).AddTransformOp()
            codes = part.times if matrix.ndim == 3 else still
            for code, values in zip(codes, np.reshape(matrix, (-1, 4, 4)), strict=True):
                operation.Set(Gf.Matrix4d(values.tolist()), code)
        mesh = UsdGeom.Mesh.Define(usd, f"{prim_path}/Mesh")
        mesh.CreateSubdivisionSchemeAttr("none")
        mesh.CreateFaceVertexCountsAttr(np.full(len(part.faces), 3, dtype=np.int32))
        mesh.CreateFaceVertexIndicesAttr(np.ascontiguousarray(part.faces.ravel()))
        codes = part.times if part.points.ndim == 3 else still
        for code, values in zip(codes, np.reshape(part.points, (len(codes), -1, 3)), strict=True):
            mesh.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(values.astype(np.float32)), code)
    usd.GetRootLayer().Save()
