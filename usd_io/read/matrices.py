"""Matrices of prims and points through them, in float64.

Matrices are (4, 4) in USD's row-vector convention: world = [local, 1] @ matrix. float32 would lose
whole units under a transform such as scale (100, 0.01, 3) with an offset of 1e6.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pxr import Sdf, Usd, UsdGeom

from usd_io.diagnostics import reading, reading_frame
from usd_io.errors import FrameError, StageError
from usd_io.times import time_code

# Determinant of the linear part over the product of its row lengths: 1 for a rotation with any
# scale, 0 for a flat one. A shear of 1:1e6 still passes.
SMALLEST_DETERMINANT = 1e-9
# Numbers of a transform; beyond, points leave the range of float32.
LARGEST_NUMBER = 1e38


def prim_matrix(prim: Usd.Prim, time: float) -> NDArray[np.float64]:
    """Return the local to world matrix (4, 4) float64 of a prim at a time code.

    At the default time (NaN) an animated transform without default values is taken at its
    earliest sample (pxr would silently leave it out).

    Raises:
        FrameError: a transform cannot be read, or is no number: NaN, infinite, or so large that
            points through it leave the range of float32.
    """
    path = str(prim.GetPath())
    with reading_frame(path, time):
        # Where nothing is animated, that is the default.
        code = Usd.TimeCode.EarliestTime() if math.isnan(time) else time_code(time)
        matrix = np.array(UsdGeom.Imageable(prim).ComputeLocalToWorldTransform(code))
    if not (np.abs(matrix) < LARGEST_NUMBER).all():
        raise FrameError(
            path, time, "the transform is NaN, infinite or beyond 1e38; mend it or exclude the mesh"
        )
    return matrix


def check_transforms(prim: Usd.Prim, checked: set[Sdf.Path] | None = None) -> None:
    """Raise StageError if a transform of a prim or above it is missing or of a wrong type.

    Prims above that are in `checked` are taken as right; those that are right are added to it.
    pxr leaves out what `xformOpOrder` names and the prim does not have, so that a mesh would be
    somewhere else than its author meant.
    """
    with reading(str(prim.GetPath())):
        UsdGeom.Imageable(prim).ComputeLocalToWorldTransform(Usd.TimeCode.EarliestTime())
    checked = set() if checked is None else checked
    while prim and not prim.IsPseudoRoot() and prim.GetPath() not in checked:
        movable = UsdGeom.Xformable(prim)
        order = movable.GetXformOpOrderAttr().Get() if movable else None
        for name in () if order is None else order:
            own = name == "!resetXformStack!" or prim.HasAttribute(name.removeprefix("!invert!"))
            if not own:
                raise StageError(
                    f"{prim.GetPath()}: xformOpOrder names {name!r}, which the prim does not have; "
                    "mend it or exclude the meshes below"
                )
        checked.add(prim.GetPath())
        prim = prim.GetParent()


def chain_times(prim: Usd.Prim, *, below: Sdf.Path = Sdf.Path.absoluteRootPath) -> set[float]:
    """Return the time codes of the transforms of a prim and its ancestors below `below`.

    Those of samples, and of the knots of splines.
    """
    times: set[float] = set()
    while prim and prim.GetPath() != below and not prim.IsPseudoRoot():
        xformable = UsdGeom.Xformable(prim)
        if xformable:
            times.update(xformable.GetTimeSamples())
            times.update(_knots(xformable))
            if xformable.GetResetXformStack():
                break
        prim = prim.GetParent()
    return times


def scaled_to_nothing(prim: Usd.Prim, times: set[float]) -> bool:
    """Return whether no axis of a prim has a length at any of the times; of none: by default."""
    codes = [Usd.TimeCode(time) for time in sorted(times)] or [Usd.TimeCode.Default()]
    placed = UsdGeom.Imageable(prim)
    return not any(
        np.array(placed.ComputeLocalToWorldTransform(code))[:3, :3].any() for code in codes
    )


def _knots(xformable: UsdGeom.Xformable) -> set[float]:
    """Return the time codes of the knots of transforms that are splines."""
    times: set[float] = set()
    for operation in xformable.GetOrderedXformOps():
        attribute = operation.GetAttr()
        # OpenUSD before 25.5 has no splines.
        if hasattr(attribute, "HasSpline") and attribute.HasSpline():
            times.update(attribute.GetSpline().GetKnots().keys())
    return times


def transform_points(points: ArrayLike, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (..., 3) transformed by a matrix (4, 4), in float64."""
    points = np.asarray(points, dtype=np.float64)
    moved: NDArray[np.float64] = points @ matrix[:3, :3] + matrix[3, :3]
    return moved


def inverse_matrix(
    matrix: NDArray[np.float64], *, path: str = "transform", time: float = math.nan
) -> NDArray[np.float64]:
    """Return world to local: the inverse (4, 4) of an affine matrix.

    Raises:
        FrameError: the matrix flattens space (a zero scale) or is not finite; pxr would return a
            matrix of FLT_MAX.
    """
    linear = matrix[:3, :3]
    lengths = np.linalg.norm(linear, axis=1)
    if not np.isfinite(matrix).all() or not (lengths > 0.0).all():
        raise FrameError(path, time, "the transform has a zero or infinite scale; mend it")
    determinant = float(np.linalg.det(linear / lengths[:, None]))
    if abs(determinant) < SMALLEST_DETERMINANT:
        raise FrameError(
            path, time, f"the transform flattens space (determinant {determinant:.1e}); mend it"
        )
    # Rows scaled to length one first, so that the inverse is as exact as the rotation in it.
    inverse = np.eye(4)
    inverse[:3, :3] = np.linalg.inv(linear / lengths[:, None]) / lengths[None, :]
    inverse[3, :3] = -matrix[3, :3] @ inverse[:3, :3]
    return inverse
