"""Small stages made in code, for the tests of `usd_io`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

CUBE = np.array(
    [[x, y, z] for z in (-1.0, 1.0) for y in (-1.0, 1.0) for x in (-1.0, 1.0)], dtype=np.float32
)
CUBE_QUADS = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]


def vec3f(points: ArrayLike) -> Vt.Vec3fArray:
    """Points (V, 3) as pxr has them."""
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points, dtype=np.float32))


def moved_cube(time: float) -> NDArray[np.float32]:
    """The cube of a frame: every coordinate depends on the time and is exact in no base."""
    return (CUBE * np.float32(1.0 + 0.1 * time) + np.float32(time / 7.0)).astype(np.float32)


def define_cube(
    stage: Usd.Stage,
    path: str = "/Root/Cube",
    *,
    times: Sequence[float] = (),
    points: ArrayLike | None = CUBE,
    polygons: Sequence[Sequence[int]] = CUBE_QUADS,
) -> UsdGeom.Mesh:
    """A cube with default points, or with points at the times only."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateFaceVertexCountsAttr([len(polygon) for polygon in polygons])
    mesh.CreateFaceVertexIndicesAttr([corner for polygon in polygons for corner in polygon])
    mesh.CreateSubdivisionSchemeAttr("none")
    if len(times):
        for time in times:
            mesh.CreatePointsAttr().Set(vec3f(moved_cube(time)), time)
    elif points is not None:
        mesh.CreatePointsAttr().Set(vec3f(points))
    return mesh


def new_stage(path: Path) -> Usd.Stage:
    """An empty stage to be saved at a path, with a root Xform."""
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Root").GetPrim())
    return stage


def cube_file(path: Path, *, times: Sequence[float] = (), **options: Any) -> Path:
    """A file with one cube, /Root/Cube."""
    stage = new_stage(path)
    define_cube(stage, times=times, **options)
    stage.GetRootLayer().Save()
    return path


def authored_properties(path: Path | str) -> set[str]:
    """Paths of all properties in a layer file."""
    layer = Sdf.Layer.FindOrOpen(str(path))
    found: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, found.append)
    return {str(item) for item in found if item.IsPropertyPath()}
