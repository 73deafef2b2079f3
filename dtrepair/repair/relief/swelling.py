"""Closed parts with a little too much or too little volume swell or shrink where nothing is near.

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
    diagonal,
    dots,
    lengths,
    pair_keys,
    vector_areas,
)
from dtrepair.repair.scene.bounds import badness, pairs_and_enclosed, strain_of
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene

# A limit of displacements is kept by this much: rounding to float32 must not exceed it.
ROUNDING = 1e-6


@dataclass(frozen=True, kw_only=True)
class SwellingOptions:
    """How far parts swell, and where.

    Args:
        farthest: Farther outwards, or inwards, than this is another shape; units of the diagonal.
        aim: The change goes to this part of its bound.
        tries: What meets something in one keeps its place in the next, with its surroundings.
        rings: So many rings of edges and ties around that keep their place too.
    """

    farthest: float = 0.005
    aim: float = 0.95
    tries: int = 6
    rings: int = 2


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
    for own in excess:
        if own.kind is not StrainKind.VOLUME:
            continue
        swollen = _swollen(scene, pose, points, own.part, options)
        less = strain_of(scene, pose.centred, swollen)
        if badness(less) >= badness(excess):
            continue
        inside = [pairs_and_enclosed(scene, pose, found)[1] for found in (points, swollen)]
        if inside[1] <= inside[0]:
            points, excess = swollen, less
    return points


def _swollen(
    scene: Scene, pose: OpenedPose, points: FloatArray, part: int, options: SwellingOptions
) -> FloatArray:
    """Return a pose (V, 3) with a part at the bound of its volume; as it is if it has no room."""
    parts, weld = scene.strain_meter.parts, scene.rest_weld
    faces = parts.faces[parts.of_face == part]
    areas = vector_areas(points, faces)
    had, has = (_volume(pose_of, faces) for pose_of in (pose.centred, points))
    bound = options.aim * scene.strain.volume
    wanted = had * np.clip(has / had, 1.0 - bound, 1.0 + bound)
    normals = np.zeros_like(points)
    for corner in faces.T:
        np.add.at(normals, corner, areas / 3.0)
    area = lengths(normals)
    outwards = normals / np.maximum(area, 1e-300)[:, None]
    # Vertices at one position of the rest go together.
    fixed = np.zeros(len(points), dtype=bool)
    fixed[weld[scene.mobility == 0.0]] = True
    free = (parts.of_vertex == part) & ~fixed
    size = diagonal(pose.centred)
    known = pair_keys(scene.pairs(points, pose.weld))
    for _ in range(options.tries):
        if not (area * free).any():
            break
        height = (wanted - has) / float((area * free).sum())
        if abs(height) > options.farthest * size:
            break
        trial: FloatArray = points + (height * free[:, None] * outwards)[weld]
        beyond = free[weld] & _too_far(scene, pose, trial)
        pairs = scene.pairs(trial, pose.weld)
        met = pairs[~np.isin(pair_keys(pairs), known)]
        if not len(met) and not beyond.any():
            return trial
        near = np.zeros(len(points), dtype=bool)
        near[weld[scene.faces[met]]] = True
        free &= ~parts.grown(near, options.rings)
        free[weld[beyond]] = False
    return points


def _too_far(scene: Scene, pose: OpenedPose, points: FloatArray) -> NDArray[np.bool_]:
    """Return which vertices (V,) of a correction go beyond the limit of displacements."""
    limit = scene.options.maximum_displacement
    if limit is None:
        return np.zeros(len(points), dtype=bool)
    return lengths(points - pose.centred) > limit * (1.0 - ROUNDING)


def _volume(points: FloatArray, faces: IntArray) -> float:
    """Return the volume that closed triangles (F, 3) enclose."""
    centred = points - points[faces[0, 0]]
    return float(dots(centred[faces[:, 0]], vector_areas(centred, faces)).sum()) / 3.0
