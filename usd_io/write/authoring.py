"""New stages of animated meshes, for demonstrations and transferred animations."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from usd_io.errors import UsageError, time_text
from usd_io.polygons import check_topology
from usd_io.values import extent_of, vec3f_array
from usd_io.write.atomic_layer import AtomicLayer
from usd_io.write.metadata import set_record


@dataclass(frozen=True)
class AuthoredMesh:
    """One mesh of a new stage.

    Attributes:
        path: prim path such as /Character/Body; missing parents become Xforms.
        faces: polygons: an array (F, k), or a list of index lists of any lengths.
        points: one (V, 3) per time code: an array (T, V, 3), or any sequence, which is read frame
            by frame; empty or None for a mesh without animation.
        rest: default-time points (V, 3); needed if there is no animation.
        st: texture coordinates (N, 2): one per vertex, per corner, or per entry of `st_indices`.
        st_indices: index into `st` of each corner (C,).
        transforms: matrix (4, 4) of the parent Xform per time code (row vectors), (T, 4, 4); a
            single (4, 4) for a fixed one.
        left_handed: orientation of the faces.
    """

    path: str
    faces: ArrayLike | Sequence[Sequence[int]]
    points: Sequence[ArrayLike] | NDArray[np.floating] | None = None
    rest: ArrayLike | None = None
    st: ArrayLike | None = None
    st_indices: ArrayLike | None = None
    transforms: ArrayLike | None = None
    left_handed: bool = False


def write_animation(
    path: str | os.PathLike[str],
    meshes: AuthoredMesh | Sequence[AuthoredMesh],
    *,
    times: ArrayLike = (),
    up: str = "Y",
    meters_per_unit: float = 1.0,
    fps: float = 24.0,
    record: Mapping[str, Any] | None = None,
) -> None:
    """Write a new stage of animated meshes, atomically, with extents.

    Args:
        path: output .usd, .usdc or .usda; an older file is replaced.
        meshes: one mesh or several.
        times: time codes (T,) of points and transforms.
        up: Y or Z.
        meters_per_unit: metres per stage unit.
        fps: frames, and time codes, per second.
        record: entries of customLayerData.dtrepair.

    Raises:
        UsageError: the output is not a USD layer, a prim path is ill-formed, or `up` is unknown.
        ValueError: arrays of a mesh do not fit together.
        OutputError: the output cannot be written; an older one is unchanged.
    """
    if up not in ("Y", "Z"):
        raise UsageError(f"expected up Y or Z, got {up!r}")
    meshes = [meshes] if isinstance(meshes, AuthoredMesh) else list(meshes)
    codes = np.asarray(times, dtype=np.float64).reshape(-1)
    checked = [_checked(mesh, len(codes)) for mesh in meshes]
    with AtomicLayer(path) as file:
        stage = Usd.Stage.Open(file.layer)
        UsdGeom.SetStageUpAxis(stage, up)
        UsdGeom.SetStageMetersPerUnit(stage, meters_per_unit)
        _set_times(stage, codes, fps)
        geometries = [
            _define(stage, mesh, *topology) for mesh, topology in zip(meshes, checked, strict=True)
        ]
        if meshes:
            root = Sdf.Path(meshes[0].path).GetPrefixes()[0]
            stage.SetDefaultPrim(stage.GetPrimAtPath(root))
        for mesh, geometry in zip(meshes, geometries, strict=True):
            _author_transforms(geometry, mesh, codes)
        for row, time in enumerate(codes):
            for mesh, geometry, (_, _, count) in zip(meshes, geometries, checked, strict=True):
                if len(_frames(mesh)):
                    _author_frame(geometry, mesh, row, time, count)
                    file.end_frame()
        if record:
            set_record(stage.GetRootLayer(), record)
        del geometries, stage
        file.commit()


def define_mesh(stage: Usd.Stage, mesh: AuthoredMesh) -> UsdGeom.Mesh:
    """Define a mesh without animation on a stage; ValueError, UsageError as `write_animation`."""
    return _define(stage, mesh, *_checked(mesh, len(_frames(mesh))))


def _set_times(stage: Usd.Stage, codes: NDArray[np.float64], fps: float) -> None:
    """Author start, end and rate of the stage's time codes (T,)."""
    stage.SetTimeCodesPerSecond(fps)
    stage.SetFramesPerSecond(fps)
    if len(codes):
        stage.SetStartTimeCode(float(codes.min()))
        stage.SetEndTimeCode(float(codes.max()))


def _frames(mesh: AuthoredMesh) -> Sequence[ArrayLike] | NDArray[np.floating]:
    """Return the points of the frames of a mesh, none for a still one."""
    return () if mesh.points is None else mesh.points


def _checked(
    mesh: AuthoredMesh, time_count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Return face counts, face indices and the number of points. Raises ValueError, UsageError."""
    if not Sdf.Path.IsValidPathString(mesh.path) or not Sdf.Path(mesh.path).IsPrimPath():
        raise UsageError(f"{mesh.path!r}: not a prim path; expected one like /Character/Body")
    if not Sdf.Path(mesh.path).IsAbsolutePath():
        raise UsageError(f"{mesh.path!r}: not an absolute prim path; start it with /")
    frames = _frames(mesh)
    if len(frames) not in (0, time_count):
        raise ValueError(f"{mesh.path}: expected points for {time_count} times, got {len(frames)}")
    if mesh.rest is None and not len(frames):
        raise ValueError(f"{mesh.path}: expected rest points or animated points, got neither")
    shape = np.shape(frames[0] if mesh.rest is None else mesh.rest)
    if len(shape) != 2 or shape[1] != 3:
        raise ValueError(f"{mesh.path}: expected points (V, 3), got {shape}")
    counts, indices = _topology(mesh.faces)
    try:
        check_topology(counts, indices, shape[0])
    except ValueError as error:
        raise ValueError(f"{mesh.path}: {error}") from None
    return counts, indices, shape[0]


def _topology(
    faces: ArrayLike | Sequence[Sequence[int]],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return counts and indices of polygons given as an array (F, k) or as lists."""
    if isinstance(faces, np.ndarray):
        counts = np.full(len(faces), faces.shape[1], dtype=np.int64)
        return counts, faces.reshape(-1).astype(np.int64)
    polygons = [np.asarray(face, dtype=np.int64) for face in cast(Sequence[Sequence[int]], faces)]
    counts = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    return counts, np.concatenate([*polygons, np.empty(0, dtype=np.int64)])


def _define(
    stage: Usd.Stage,
    mesh: AuthoredMesh,
    counts: NDArray[np.int64],
    indices: NDArray[np.int64],
    point_count: int,
) -> UsdGeom.Mesh:
    """Define a mesh with its parents, topology, rest points and texture coordinates."""
    for ancestor in Sdf.Path(mesh.path).GetParentPath().GetPrefixes():
        if not stage.GetPrimAtPath(ancestor):
            UsdGeom.Xform.Define(stage, ancestor)
    geometry = UsdGeom.Mesh.Define(stage, mesh.path)
    geometry.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(counts.astype(np.int32)))
    geometry.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(indices.astype(np.int32)))
    geometry.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    if mesh.left_handed:
        geometry.CreateOrientationAttr(UsdGeom.Tokens.leftHanded)
    if mesh.rest is not None:
        _author_points(geometry, np.asarray(mesh.rest), Usd.TimeCode.Default())
    if mesh.st is not None:
        _author_st(geometry, mesh, len(indices), point_count)
    return geometry


def _author_st(
    geometry: UsdGeom.Mesh, mesh: AuthoredMesh, corner_count: int, point_count: int
) -> None:
    """Author texture coordinates of vertices or corners. Raises ValueError."""
    values = np.ascontiguousarray(mesh.st, dtype=np.float32)
    indices = None if mesh.st_indices is None else np.asarray(mesh.st_indices, dtype=np.int32)
    count = len(values) if indices is None else len(indices)
    kinds = {point_count: UsdGeom.Tokens.vertex, corner_count: UsdGeom.Tokens.faceVarying}
    if count not in kinds or values.shape != (len(values), 2):
        raise ValueError(
            f"{mesh.path}: expected st (N, 2) for {point_count} points or {corner_count} corners, "
            f"got {values.shape} with {count} elements"
        )
    primvar = UsdGeom.PrimvarsAPI(geometry).CreatePrimvar(
        "st", Sdf.ValueTypeNames.TexCoord2fArray, kinds[count]
    )
    primvar.Set(Vt.Vec2fArray.FromNumpy(values))
    if indices is not None:
        primvar.SetIndices(Vt.IntArray.FromNumpy(indices.reshape(-1)))


def _author_points(
    geometry: UsdGeom.Mesh, points: NDArray[np.floating], code: Usd.TimeCode
) -> None:
    """Author points (V, 3) and their extent at a time."""
    values = vec3f_array(points)
    geometry.CreatePointsAttr().Set(values, code)
    geometry.CreateExtentAttr().Set(extent_of(np.asarray(values)), code)


def _author_frame(
    geometry: UsdGeom.Mesh, mesh: AuthoredMesh, row: int, time: float, count: int
) -> None:
    """Author the points (V, 3) of frame `row`. Raises ValueError for another shape."""
    points = np.asarray(_frames(mesh)[row])
    if points.shape != (count, 3):
        raise ValueError(
            f"{mesh.path} at {time_text(time)}: expected points {(count, 3)}, got {points.shape}"
        )
    _author_points(geometry, points, Usd.TimeCode(time))


def _author_transforms(
    geometry: UsdGeom.Mesh, mesh: AuthoredMesh, codes: NDArray[np.float64]
) -> None:
    """Author the transform of the parent, or one for each time code (T,). Raises ValueError."""
    if mesh.transforms is None:
        return
    matrices = np.asarray(mesh.transforms, dtype=np.float64)
    parent = UsdGeom.Xformable(geometry.GetPrim().GetParent())
    if not parent:
        raise ValueError(f"{mesh.path}: transforms need a parent prim; use /Group{mesh.path}")
    if matrices.shape not in ((4, 4), (len(codes), 4, 4)):
        raise ValueError(
            f"{mesh.path}: expected transforms (4, 4) or ({len(codes)}, 4, 4), got {matrices.shape}"
        )
    operation = parent.MakeMatrixXform()
    if matrices.ndim == 2:
        operation.Set(Gf.Matrix4d(matrices.tolist()))
        return
    for time, matrix in zip(codes, matrices, strict=True):
        operation.Set(Gf.Matrix4d(matrix.tolist()), Usd.TimeCode(time))
