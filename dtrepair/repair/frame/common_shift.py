"""What a character moved by as a whole: contacts of its own parts do not ask for that.

Pushes of one contact seldom cancel each other to the last, and over many sweeps a light character
drifts along with them, by more than is taken back later.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray, lengths, triangle_normals
from dtrepair.repair.surface.surface import BoolArray, Surface


@dataclass(frozen=True, kw_only=True)
class CommonShiftOptions:
    """Which shifts are taken back.

    Args:
        faint: Those below this are left, units of the size; up to twice this they fade in.
        one_way: Along what stands still, as a floor, a shift goes back first, if the mean of the
            normals that were met there is at least this long.
    """

    faint: float = 1e-3
    one_way: float = 0.8


def carried_vertices(surface: Surface) -> BoolArray | None:
    """Return which vertices (V,) a shift of all that moves carries; None where there is no such.

    There are none where several clusters of bodies lean on each other, where some vertices of a
    body are held, and where displacements have a direction.
    """
    if surface.clusters > 1 or surface.direction is not None:
        return None
    carried = surface.scale.counted(surface.count)
    if not carried.any() or (surface.mobility[carried] < 1.0).any():
        return None
    return None if surface.stiff[carried].all() else carried


def common_shifts(
    surface: Surface,
    moved: FloatArray,
    carried: BoolArray,
    *,
    options: CommonShiftOptions = CommonShiftOptions(),
) -> FloatArray:
    """Return by what (T, 3) half of the area of what is carried moved at least, axis by axis.

    moved: displacements (T, V, 3); carried: vertices (V,).
    """
    soft = np.flatnonzero(carried & ~surface.stiff)
    own = moved[:, soft]
    order = np.argsort(own, axis=1, kind="stable")
    weight = np.cumsum(surface.mass[soft][order], axis=1)
    middle = (weight < 0.5 * weight[:, -1:]).sum(axis=1, keepdims=True)
    place = np.take_along_axis(order, middle, axis=1)
    shifts: FloatArray = np.take_along_axis(own, place, axis=1)[:, 0]
    shifts *= np.clip(lengths(shifts) / options.faint - 1.0, 0.0, 1.0)[:, None]
    return shifts


def along_and_across(
    surface: Surface,
    shifts: FloatArray,
    poses: FloatArray,
    pairs: Sequence[IntArray],
    *,
    options: CommonShiftOptions = CommonShiftOptions(),
) -> list[FloatArray]:
    """Return shifts (T, 3) split into those along what stands still and is met, and across it.

    As they are, where it faces several ways or nothing is met. poses (T, V, 3) and their pairs
    (K, 2), which tell what is met.
    """
    normals = [np.zeros((0, 3))]
    for pose, found in zip(poses, pairs, strict=True):
        met = np.unique(found)
        met = met[surface.fixed[surface.faces[met]].all(axis=1)]
        normals.append(triangle_normals(pose, surface.faces[met]))
    met_normals = np.concatenate(normals)
    normal = met_normals.mean(axis=0) if len(met_normals) else np.zeros(3)
    length = float(np.linalg.norm(normal))
    if length < options.one_way:
        return [shifts]
    across = np.outer(shifts @ normal, normal) / length**2
    return [shifts - across, across]
