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
    lengths,
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
        folded: In a pose nothing is led out where the mean normal is no longer than this.
        sunk: It has sunk if it is lower than at rest by more than this fraction of its size; up to
            twice this it is led out by a part of the way only, so that it does not jump.
        width: Standard deviation, in frames, over which it comes and goes.
    """

    larger: float = 10.0
    flat: float = 0.8
    outside: float = 0.1
    near: float = 0.35
    folded: float = 0.5
    sunk: float = 0.05
    width: float = 1.75


class Sitter(NamedTuple):
    """A part that sits on a larger one.

    Args:
        joint: The number of the pair of both, the smaller number times their count and the larger.
        vertices: All vertices (N,) of the part.
        triangles: Corners (K, 3) of what it is tied to on the host, ...
        weights: ... and its places there (K, 3).
        size: Extent of the part at rest.
        radius: Its mean radius there.
        height: Of its middle above the host, there.
    """

    joint: int
    vertices: IntArray
    triangles: IntArray
    weights: FloatArray
    size: float = 0.0
    radius: float = 0.0
    height: float = 0.0

    def above(self, points: FloatArray) -> tuple[float, FloatArray]:
        """Return how high the middle of the part is in a pose (V, 3), and the mean normal (3,)."""
        places = np.einsum("nk,nkj->nj", self.weights, points[self.triangles])
        normal = triangle_normals(points, self.triangles).mean(axis=0)
        way = points[self.vertices].mean(axis=0) - places.mean(axis=0)
        return float(way @ normal) / max(float(np.linalg.norm(normal)), 1e-300), normal

    def radius_in(self, points: FloatArray) -> float:
        """Return the mean radius of the part in a pose (V, 3): characters grow and shrink."""
        own = points[self.vertices]
        return float(lengths(own - own.mean(axis=0)).mean())

    def way_out(self, points: FloatArray, options: SunkenOptions) -> FloatArray:
        """Return the shift (3,) that leads it out to where it was modelled, zero if it is there."""
        height, normal = self.above(points)
        scale, flat = self.radius_in(points) / self.radius, float(np.linalg.norm(normal))
        missing = scale * self.height - height
        # Where the host is folded nobody knows which way is out; a hidden part is a point.
        if flat <= options.folded or scale == 0.0:
            return np.zeros(3)
        size = scale * self.size
        part = np.clip(missing / (options.sunk * size) - 1.0, 0.0, 1.0)
        return np.asarray(part * min(missing, size) / flat * normal)


def sitters(
    scene: Scene, met: IntArray | None = None, *, options: SunkenOptions = SunkenOptions()
) -> list[Sitter]:
    """Return the parts of a scene that sit on one other at rest, and are attached to no third.

    met: only of these pairs of parts, numbered as `Sitter.joint`. Stiff, held and directed bodies
    are left to what leads them.
    """
    parts, rest = scene.strain_meter.parts, scene.centred_rest
    if parts.ties is None:
        return []
    areas = np.bincount(parts.of_face, triangle_areas(rest, parts.faces), parts.count)
    vertices, triangles, weights, _ = parts.ties
    part, corners = parts.of_vertex[vertices], parts.corners[triangles]
    small = (part >= 0) & (options.larger * areas[part] < areas[parts.of_vertex[corners[:, 0]]])
    joints = np.unique(parts.joint)
    hosts = np.bincount(np.append(joints // parts.count, joints % parts.count))
    small &= hosts[part] == 1
    part_of_vertex = parts.of_vertex[scene.rest_sewn]
    found = []
    for joint in np.unique(parts.joint[small]) if met is None else met:
        ties = np.flatnonzero(small & (parts.joint == joint))
        if len(ties) == 0:
            continue
        own = np.flatnonzero(part_of_vertex == part[ties[0]]).astype(np.int32)
        sitter = Sitter(int(joint), own, corners[ties], weights[ties])
        height, normal = sitter.above(rest)
        size = extent(rest[own])
        sits = options.outside * size < height < options.near * size
        if sits and np.linalg.norm(normal) > options.flat and _may_move(scene, own):
            radius = sitter.radius_in(rest)
            found.append(sitter._replace(size=size, radius=radius, height=height))
    return found


def _may_move(scene: Scene, vertices: IntArray) -> bool:
    """Return whether vertices (N,) may be led out: neither stiff, nor held, nor directed."""
    free = not any(scene.is_stiff(int(body)) for body in np.unique(scene.body_of_vertex[vertices]))
    free &= bool((scene.mobility[vertices] == 1.0).all())
    return free and not scene.direction[vertices].any()


def raised_frames(
    scene: Scene,
    poses: FloatArray,
    pairs: Sequence[IntArray],
    frames: FloatArray,
    *,
    options: SunkenOptions = SunkenOptions(),
) -> FloatArray:
    """Return poses (T, V, 3) in which what sank into what it sits on, and meets it, is led out.

    With a largest displacement all is left to the repair of contacts, which keeps to it.

    Args:
        scene: The bodies.
        poses: Poses (T, V, 3).
        pairs: Of each frame the pairs (K, 2) of triangles that intersect and should not.
        frames: Times (T,) in frame units.
        options: Numbers of this stage.
    """
    chosen = scene.options
    if chosen.method != "full" or chosen.maximum_displacement is not None:
        return poses
    met = [_joints_of(scene, own) for own in pairs]
    result = poses
    for sitter in sitters(scene, np.unique(np.concatenate(met)), options=options):
        meets = [sitter.joint in own for own in met]
        shifts = np.zeros((len(poses), 1, 3))
        for index in np.flatnonzero(meets):
            shifts[index] = sitter.way_out(poses[index], options)
        if shifts.any():
            if len(frames) > 1:
                shifts = undamped(gaussian_kernel(frames, options.width), shifts)
            result = result.copy() if result is poses else result
            result[:, sitter.vertices] += shifts
    return result


def _joints_of(scene: Scene, pairs: IntArray) -> IntArray:
    """Return the pairs of parts (N,), numbered as `Sitter.joint`, that pairs (K, 2) join."""
    parts = scene.strain_meter.parts
    met = np.sort(parts.of_vertex[parts.corners[pairs, 0]], axis=1)
    return np.unique(met[:, 0] * parts.count + met[:, 1])
