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
from dtrepair.repair.scene.bounds import badness, strain_of
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene


@dataclass(frozen=True, kw_only=True)
class SwellingOptions:
    """How far parts swell, and where.

    Args:
        farthest: Farther outwards, or inwards, than this is another shape; units of the diagonal.
        aim: The change goes to this part of its bound.
        tries: What meets something in one keeps its place in the next, with its surroundings.
        rings: So many rings of edges around that keep their place too.
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

    Each where that is less strained and brings no contact.
    """
    excess = strain_of(scene, pose.centred, points)
    for own in excess:
        if own.kind is StrainKind.VOLUME:
            swollen = _swollen(scene, pose, points, own.part, options)
            less = strain_of(scene, pose.centred, swollen)
            if badness(less) < badness(excess):
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
    free = parts.of_vertex == part
    size = diagonal(pose.centred)
    known = pair_keys(scene.pairs(points, pose.weld))
    for _ in range(options.tries):
        if not (area * free).any():
            break
        height = (wanted - has) / float((area * free).sum())
        if abs(height) > options.farthest * size:
            break
        trial: FloatArray = points + (height * free[:, None] * outwards)[weld]
        pairs = scene.pairs(trial, pose.weld)
        met = pairs[~np.isin(pair_keys(pairs), known)]
        if not len(met):
            return trial
        free &= ~_grown(scene, weld[scene.faces[met]].ravel(), options.rings)
    return points


def _grown(scene: Scene, vertices: NDArray[np.integer], rings: int) -> NDArray[np.bool_]:
    """Return a mask (V,) of some vertices, and of rings of edges around them."""
    edges = scene.strain_meter.parts.edges
    mask = np.zeros(len(scene.rest), dtype=bool)
    mask[vertices] = True
    for _ in range(rings):
        mask[edges[mask[edges].any(axis=1)]] = True
    return mask


def _volume(points: FloatArray, faces: IntArray) -> float:
    """Return the volume that closed triangles (F, 3) enclose."""
    centred = points - points[faces[0, 0]]
    return float(dots(centred[faces[:, 0]], vector_areas(centred, faces)).sum()) / 3.0
