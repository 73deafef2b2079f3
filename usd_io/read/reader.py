"""Stage to AnimatedMesh, and one frame at a time after that."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pxr import Sdf, Usd, UsdGeom

from usd_io.diagnostics import reading, reading_frame
from usd_io.errors import FrameError, StageError, time_text
from usd_io.polygons import Triangulation, triangulate
from usd_io.read.matrices import chain_times, check_transforms, scaled_to_nothing
from usd_io.read.mesh import AnimatedMesh, MeshSelection, mesh_warnings
from usd_io.read.select import Candidate, select_prims, select_shapes
from usd_io.read.skinning import Skin, find_skin
from usd_io.read.stages import OpenedStage, as_stage
from usd_io.times import time_code
from usd_io.values import index_row, point_rows

UP_AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


class _Skip(Exception):
    """A mesh that takes no part; the text is a warning."""


def read_meshes(
    stage: OpenedStage | Usd.Stage,
    *,
    prim: str | None = None,
    exclude: str | None = None,
    include_invisible: bool = False,
    include_purposes: bool = False,
    skip_varying: bool = False,
    uninstance: bool = False,
    instances: bool = False,
) -> MeshSelection:
    """Find the meshes of a stage and read their topology and rest points.

    Args:
        stage: from `open_stage`.
        prim: `Sdf.PathExpression` such as `//hero//{isa:Mesh}`; None takes every mesh.
        exclude: expression of prims to leave out, with all below them.
        include_invisible: take invisible meshes too.
        include_purposes: take meshes of purpose proxy and guide too.
        skip_varying: skip meshes whose topology changes over time, with a warning.
        uninstance: expand instances (instanceable = false, on the session layer here and in the
            output of `OverrideWriter`), so that meshes in them can be changed.
        instances: take meshes in instances, with a warning; they can only be read.

    Raises:
        SelectionError: an expression is ill-formed or matches no usable mesh.
        StageError: a selected mesh is unusable (bad indices, varying topology, inside an
            instance unless those are taken, or named explicitly and without points), or the stage
            has no mesh.
    """
    usd = as_stage(stage)
    chosen: dict[str, Any] = {
        "prim": prim,
        "exclude": exclude,
        "include_invisible": include_invisible,
        "include_purposes": include_purposes,
    }
    candidates, warnings = select_prims(usd, **chosen, uninstance=uninstance, instances=instances)
    meshes, checked = [], set[Sdf.Path]()
    for candidate in candidates:
        try:
            with reading(str(candidate.prim.GetPath())):
                check_transforms(candidate.prim, checked)
                _check_scale(candidate.prim)
                mesh = _read_mesh(usd, candidate, skip_varying=skip_varying)
        except _Skip as skip:
            if candidate.explicit:
                raise StageError(str(skip)) from None
            warnings.append(f"{skip}; skipped")
            continue
        warnings.extend(mesh.warnings)
        meshes.append(mesh)
    return MeshSelection(tuple(meshes), tuple(warnings), tuple(select_shapes(usd, **chosen)))


def read_frame(mesh: AnimatedMesh, time: float) -> NDArray[np.float32] | None:
    """Return the local points (V, 3) float32 of one frame; None for a blocked sample.

    The array is read-only and shares memory with pxr where it can.

    Raises:
        FrameError: NaN or infinite points, or another number of points than the topology has.
    """
    return check_points(mesh, time, raw_points(mesh, time))


def raw_points(mesh: AnimatedMesh, time: float) -> NDArray[np.float32] | None:
    """Return the local points (N, 3) float32 of one frame, unchecked; None if blocked."""
    with reading_frame(mesh.path, time):
        if mesh.skin is not None:
            return mesh.skin.points(time)
        value = mesh.geometry.GetPointsAttr().Get(time_code(time))
        if value is None:
            return None
        try:
            points = point_rows(value)
        except ValueError as error:
            raise FrameError(mesh.path, time, f"{error}; export the frame again") from None
        # point3d data hides behind point3f[]: cast.
        return points.astype(np.float32, copy=False)


def check_points(
    mesh: AnimatedMesh, time: float, points: NDArray[np.float32] | None
) -> NDArray[np.float32] | None:
    """Return the points. Raises FrameError if they do not fit the mesh or are not finite."""
    if points is None:
        return None
    if len(points) != len(mesh.rest):
        raise FrameError(
            mesh.path,
            time,
            f"expected {len(mesh.rest)} points as in the topology, got {len(points)}; "
            "export the frame again",
        )
    if not np.isfinite(points).all():
        wrong = ~np.isfinite(points).all(axis=1)
        count, first = int(wrong.sum()), int(np.argmax(wrong))
        what = f"{count} points are NaN or infinite, first {first}"
        if count == 1:
            what = f"point {first} is NaN or infinite"
        raise FrameError(mesh.path, time, f"{what}; export the frame again")
    return points


def read_points(mesh: AnimatedMesh, times: ArrayLike) -> NDArray[np.float32]:
    """Return the local points (T, V, 3) float32 of several frames, all in memory.

    Raises:
        FrameError: a frame is unusable, or blocked.
    """
    times = np.asarray(times, dtype=np.float64).reshape(-1)
    points = np.empty((len(times), len(mesh.rest), 3), dtype=np.float32)
    for row, time in enumerate(times):
        frame = read_frame(mesh, float(time))
        if frame is None:
            raise FrameError(mesh.path, float(time), "the sample is blocked; leave the frame out")
        points[row] = frame
    return points


def _check_scale(prim: Usd.Prim) -> None:
    """Raise _Skip for a mesh that no frame can show."""
    if scaled_to_nothing(prim, chain_times(prim)):
        raise _Skip(f"{prim.GetPath()}: scaled to nothing at all times; mend its scale to take it")


def _read_mesh(stage: Usd.Stage, candidate: Candidate, *, skip_varying: bool) -> AnimatedMesh:
    """Return a mesh of a stage. Raises _Skip for one that takes no part, StageError."""
    geometry = UsdGeom.Mesh(candidate.prim)
    path = str(candidate.prim.GetPath())
    try:
        _check_fixed_topology(geometry, path)
    except StageError as error:
        if skip_varying:
            raise _Skip(str(error)) from None
        raise
    samples = np.array(geometry.GetPointsAttr().GetTimeSamples(), dtype=np.float64)
    times = samples if len(samples) else np.array([np.nan])
    values, rest_time = _rest(geometry, path, samples)
    rest = np.array(values, dtype=np.float64)
    triangles = _triangles(geometry, path, rest)
    if not len(triangles.faces):
        raise _Skip(f"{path}: the mesh has no faces")
    skin = find_skin(candidate.prim)
    if skin is not None:
        rest, times = _skinned(skin, rest_time)
    mesh = AnimatedMesh(
        path=path,
        rest=rest,
        faces=triangles.faces,
        polygons=triangles.polygons,
        times=times,
        up=_up_axis(stage),
        meters_per_unit=float(UsdGeom.GetStageMetersPerUnit(stage)),
        rest_time=rest_time,
        uninstanced=candidate.uninstanced,
        stage=stage,
        skin=skin,
    )
    return replace(mesh, warnings=mesh_warnings(mesh, triangles.degenerate))


def _up_axis(stage: Usd.Stage) -> NDArray[np.float64]:
    """Return the up axis (3,) of a stage; Y where it names none that exists."""
    return np.array(UP_AXES.get(UsdGeom.GetStageUpAxis(stage), UP_AXES["Y"]))


def _skinned(skin: Skin, rest_time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return rest points and times of a skinned mesh. Raises StageError if it cannot be skinned."""
    try:
        times = skin.times()
        skin.points(float(times[0]))
        return skin.rest(rest_time), times
    except FrameError as error:
        raise StageError(f"{error}; mend the skin or exclude the mesh") from None


def _topology(geometry: UsdGeom.Mesh) -> tuple[Usd.Attribute, Usd.Attribute, Usd.Attribute]:
    """Return the attributes of face counts, face indices and holes."""
    return (
        geometry.GetFaceVertexCountsAttr(),
        geometry.GetFaceVertexIndicesAttr(),
        geometry.GetHoleIndicesAttr(),
    )


def _check_fixed_topology(geometry: UsdGeom.Mesh, path: str) -> None:
    """Raise StageError if the topology changes over time; many equal samples are fine."""
    for attribute in _topology(geometry):
        times = attribute.GetTimeSamples()
        first = attribute.Get(Usd.TimeCode.EarliestTime())
        for time in times[1:]:
            if attribute.Get(time) != first:
                raise StageError(
                    f"{path}: the topology changes ({attribute.GetName()} at "
                    f"{time_text(time)}); leave it out with --skip-varying or --exclude"
                )


def _rest(
    geometry: UsdGeom.Mesh, path: str, samples: NDArray[np.float64]
) -> tuple[NDArray[np.floating], float]:
    """Return rest points (V, 3) and their time: the default time if it fits, else a sample's.

    Some caches have all points at one place by default, as a mark that nothing is known.
    """
    attribute = geometry.GetPointsAttr()
    default = _points(attribute, path, math.nan)
    if not len(samples):
        if default is None:
            raise _Skip(f"{path}: the mesh has no points")
        if not len(default):
            raise _Skip(f"{path}: the mesh is empty")
        if not np.isfinite(default).all():
            raise StageError(
                f"{path}: points are NaN or infinite; export the mesh again or exclude it"
            )
        return default, np.nan
    used = _highest_index(geometry, path) + 1
    for time in samples:
        value = _points(attribute, path, time)
        if value is None or len(value) < max(used, 1) or not np.isfinite(value).all():
            continue
        fits = default is not None and len(default) == len(value) and np.isfinite(default).all()
        if default is not None and fits and (np.ptp(default, axis=0).any() or len(value) == 1):
            return default, np.nan
        return value, float(time)
    values = [_points(attribute, path, time) for time in samples]
    if all(value is None for value in values):
        raise _Skip(f"{path}: the mesh has no points (all samples are blocked)")
    if all(value is None or not len(value) for value in values):
        raise _Skip(f"{path}: the mesh is empty")
    raise StageError(
        f"{path}: no sample has finite points for all indices (expected at least {used} points); "
        "export the mesh again or exclude it"
    )


def _points(attribute: Usd.Attribute, path: str, time: float) -> NDArray[np.floating] | None:
    """Return the points (N, 3) of a mesh at a time, None without any. Raises StageError."""
    value = attribute.Get(time_code(time))
    try:
        return None if value is None else point_rows(value)
    except ValueError as error:
        raise StageError(f"{path}: {error}; export the mesh again or exclude it") from None


def _whole_numbers(attribute: Usd.Attribute, path: str) -> NDArray[np.int64]:
    """Return the earliest whole numbers (N,) of an attribute. Raises StageError."""
    try:
        return index_row(attribute.Get(Usd.TimeCode.EarliestTime()), attribute.GetName())
    except ValueError as error:
        raise StageError(f"{path}: {error}; mend the mesh or exclude it") from None


def _highest_index(geometry: UsdGeom.Mesh, path: str) -> int:
    """Return the highest vertex index of the faces, -1 without any."""
    return int(_whole_numbers(geometry.GetFaceVertexIndicesAttr(), path).max(initial=-1))


def _triangles(geometry: UsdGeom.Mesh, path: str, rest: NDArray[np.floating]) -> Triangulation:
    """Return the triangulation of the rest pose (V, 3). Raises StageError."""
    counts, indices, holes = (_whole_numbers(item, path) for item in _topology(geometry))
    orientation = geometry.GetOrientationAttr().Get(Usd.TimeCode.EarliestTime())
    flip = orientation == UsdGeom.Tokens.leftHanded
    try:
        return triangulate(counts, indices, rest, holes=holes, flip=flip)
    except ValueError as error:
        raise StageError(f"{path}: {error}; mend the mesh or exclude it") from None
