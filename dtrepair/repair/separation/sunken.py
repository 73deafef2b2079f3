"""What sank into what it sits on is led out first, to where it was modelled: a pouch on a vest.

A push moves both sides of a contact the short way, which for a pouch deep in a thin vest is through
it: it would end behind the vest, and intersect nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    extent,
    triangle_areas,
    triangle_normals,
)
from dtrepair.numerics.temporal import gaussian_kernel, undamped
from dtrepair.repair.scene.scene import Scene


@dataclass(frozen=True, kw_only=True)
class SunkenOptions:
    """What sits on something, and when it has sunk.

    Args:
        larger: What it sits on has so many times its area.
        flat: There it faces one way: least length of its mean normal. A ball in a socket does not
            sit on it.
        outside, near: At rest the middle of the part is at least, and at most, these fractions of
            its size above it.
        sunk: It has sunk if it is lower than at rest by more than this fraction of its size.
        width: Standard deviation, in frames, over which it comes and goes.
    """

    larger: float = 10.0
    flat: float = 0.8
    outside: float = 0.1
    near: float = 0.35
    sunk: float = 0.05
    width: float = 1.75


class Sitter(NamedTuple):
    """A part that sits on a larger one.

    Args:
        part, host: Numbers of both in the strain meter's parts.
        vertices: All vertices (N,) of the part.
        triangles: Corners (K, 3) of what it is tied to on the host, ...
        weights: ... and its places there (K, 3).
        size: Extent of the part at rest.
        height: Of its middle above the host, at rest.
    """

    part: int
    host: int
    vertices: IntArray
    triangles: IntArray
    weights: FloatArray
    size: float
    height: float

    def above(self, points: FloatArray) -> tuple[float, FloatArray]:
        """Return how high the middle of the part is in a pose (V, 3), and the mean normal (3,)."""
        places = np.einsum("nk,nkj->nj", self.weights, points[self.triangles])
        normal = triangle_normals(points, self.triangles).mean(axis=0)
        way = points[self.vertices].mean(axis=0) - places.mean(axis=0)
        return float(way @ normal) / max(float(np.linalg.norm(normal)), 1e-300), normal


def sitters(scene: Scene, *, options: SunkenOptions = SunkenOptions()) -> list[Sitter]:
    """Return the parts of a scene that sit on one other at rest, and are attached to no third."""
    parts, rest = scene.strain_meter.parts, scene.centred_rest
    if parts.ties is None:
        return []
    areas = np.bincount(parts.of_face, triangle_areas(rest, parts.faces), parts.count)
    vertices, triangles, weights = parts.ties
    part = parts.of_vertex[vertices]
    part_of_vertex = parts.of_vertex[scene.rest_sewn]
    corners = parts.corners[triangles]
    host = parts.of_vertex[corners[:, 0]]
    small = (options.larger * areas[part] < areas[host]) & (part >= 0)
    keys = np.where(small, part * parts.count + host, -1)
    joints = np.unique(parts.joint)
    hosts = np.bincount(np.append(joints // parts.count, joints % parts.count))
    found = []
    for key in np.unique(keys[small]).tolist():
        ties = np.flatnonzero(keys == key)
        own = np.flatnonzero(part_of_vertex == key // parts.count).astype(np.int32)
        upper, lower = divmod(key, parts.count)
        sitter = Sitter(upper, lower, own, corners[ties], weights[ties], 0.0, 0.0)
        height, normal = sitter.above(rest)
        size, movable = extent(rest[own]), (scene.mobility[own] > 0.0).all()
        sits = options.outside * size < height < options.near * size
        if np.linalg.norm(normal) > options.flat and sits and movable and hosts[upper] == 1:
            found.append(sitter._replace(size=size, height=height))
    return found


def raised_frames(
    scene: Scene,
    poses: FloatArray,
    pairs: Sequence[IntArray],
    frames: FloatArray,
    *,
    options: SunkenOptions = SunkenOptions(),
) -> FloatArray:
    """Return poses (T, V, 3) in which what sank into what it sits on is as high as at rest.

    Args:
        scene: The bodies.
        poses: Poses (T, V, 3).
        pairs: Of each frame the pairs (K, 2) of triangles that intersect and should not.
        frames: Times (T,) in frame units.
        options: Numbers of this stage.
    """
    parts = scene.strain_meter.parts
    result = poses
    for sitter in sitters(scene, options=options) if any(map(len, pairs)) else ():
        shifts = np.zeros((len(poses), 1, 3))
        for index, (pose, own) in enumerate(zip(poses, pairs, strict=True)):
            met = np.sort(parts.of_vertex[parts.corners[own, 0]], axis=1)
            if not (met == sorted((sitter.part, sitter.host))).all(axis=1).any():
                continue
            height, normal = sitter.above(pose)
            if sitter.height - height > options.sunk * sitter.size:
                length = min(sitter.height - height, sitter.size)
                shifts[index] = length * normal / np.linalg.norm(normal)
        if shifts.any():
            if len(frames) > 1:
                shifts = undamped(gaussian_kernel(frames, options.width), shifts)
            result = result.copy() if result is poses else result
            result[:, sitter.vertices] += shifts
    return result
