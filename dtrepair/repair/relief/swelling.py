"""Closed parts and pieces of limbs a little beyond the bound of their volume swell or shrink.

A part that its neighbours press from all sides may end a per cent beyond its bound, and a thin
plate by its thickness. The whole of its correction would be given up for that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    lengths,
    pair_keys,
    vector_areas,
)
from dtrepair.repair.scene.bounds import badness, pairs_and_enclosed, strain_of
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.strain.bounds import Excess
from dtrepair.repair.strain.volumes import Pieces

# A limit of displacements is kept by this much: rounding to float32 must not exceed it.
ROUNDING = 1e-6


@dataclass(frozen=True, kw_only=True)
class SwellingOptions:
    """How far parts swell, and where.

    Args:
        farthest: Farther outwards, or inwards, than this is another shape; units of the diagonal.
        aim: The change goes to this part of its bound.
        tries: What meets something in one keeps its place in the next, with its surroundings.
        rings: So many rings of edges and ties around that keep their place too; the second only
            where with the first there is no room.
    """

    farthest: float = 0.005
    aim: float = 0.95
    tries: int = 6
    rings: tuple[int, ...] = (2, 0)


def with_volume(
    scene: Scene,
    pose: OpenedPose,
    points: FloatArray,
    *,
    options: SwellingOptions = SwellingOptions(),
) -> FloatArray:
    """Return what was found (V, 3) for a pose, parts with another volume led within its bound.

    Each where that is less strained, brings no contact and swallows nothing. What is fixed stays,
    and nothing goes beyond a limit of displacements.
    """
    excess = strain_of(scene, pose.centred, points)
    inside: int | None = None
    for own in excess:
        if own.kind not in (StrainKind.VOLUME, StrainKind.LIMB):
            continue
        swollen = _swollen(scene, pose, points, own, options)
        less = strain_of(scene, pose.centred, swollen)
        if badness(less) >= badness(excess):
            continue
        if inside is None:
            inside = pairs_and_enclosed(scene, pose, points)[1]
        if (now := pairs_and_enclosed(scene, pose, swollen)[1]) <= inside:
            points, excess, inside = swollen, less, now
    return points


def _swollen(
    scene: Scene, pose: OpenedPose, points: FloatArray, own: Excess, options: SwellingOptions
) -> FloatArray:
    """Return a pose (V, 3) with a part at the bound of its volume; as it is if it has no room."""
    parts, weld = scene.strain_meter.parts, scene.rest_weld
    limb = own.kind is StrainKind.LIMB
    chosen = np.isin(parts.faces, own.vertices).all(axis=1) if limb else parts.of_face == own.part
    piece, faces = Pieces(parts.faces, np.where(chosen, 0, -1), 0.0), parts.faces[chosen]
    areas = vector_areas(points, faces)
    had, has = (_volume(piece, pose_of, parts.faces) for pose_of in (pose.centred, points))
    bound = options.aim * own.bound
    wanted = had * np.clip(has / had, 1.0 - bound, 1.0 + bound)
    normals = np.zeros_like(points)
    for corner in faces.T:
        np.add.at(normals, corner, areas / 3.0)
    within = np.zeros(len(points), dtype=bool)
    within[faces] = True
    # Vertices at one position of the rest go together.
    within[weld[scene.mobility == 0.0]] = False
    for rings in options.rings:
        swollen = _raised(scene, pose, points, within, normals, wanted - has, rings, options)
        if swollen is not None:
            return swollen
    return points


def _raised(
    scene: Scene,
    pose: OpenedPose,
    points: FloatArray,
    free: NDArray[np.bool_],
    normals: FloatArray,
    more: float,
    rings: int,
    options: SwellingOptions,
) -> FloatArray | None:
    """Return a pose (V, 3) that encloses `more` than `points`; None if it has no room for it.

    free: vertices (V,) that may move; normals: the vector areas (V, 3) of vertices.
    """
    parts, weld, free = scene.strain_meter.parts, scene.rest_sewn, free.copy()
    area = lengths(normals)
    outwards = normals / np.maximum(area, 1e-300)[:, None]
    known = pair_keys(scene.pairs(points, pose.weld))
    for _ in range(options.tries):
        if not (area * free).any():
            break
        height = more / float((area * free).sum())
        if abs(height) > options.farthest * scene.scale.diagonal(pose.centred):
            break
        trial: FloatArray = points + (height * free[:, None] * outwards)[weld]
        beyond = free[weld] & too_far(scene, pose, trial)
        pairs = scene.pairs(trial, pose.weld)
        met = pairs[~np.isin(pair_keys(pairs), known)]
        if not len(met) and not beyond.any():
            return trial
        near = np.zeros(len(points), dtype=bool)
        near[weld[scene.faces[met]]] = True
        free &= ~parts.grown(near, rings)
        free[weld[beyond]] = False
    return None


def too_far(scene: Scene, pose: OpenedPose, points: FloatArray) -> NDArray[np.bool_]:
    """Return which vertices (V,) of a correction go beyond the limit of displacements."""
    limit = scene.options.maximum_displacement
    if limit is None:
        return np.zeros(len(points), dtype=bool)
    return lengths(points - pose.centred) > limit * (1.0 - ROUNDING)


def _volume(piece: Pieces, points: FloatArray, faces: IntArray) -> float:
    """Return the volume that a piece of triangles (F, 3) encloses, its rims closed by fans."""
    centred = points - points[faces[0, 0]]
    return float(piece.measures(centred, vector_areas(centred, faces))[0][0])
