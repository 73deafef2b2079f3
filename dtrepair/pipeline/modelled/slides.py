"""Joints that slide: rods in cylinders, drawers, telescopes; their overlap moves along one axis."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dtrepair.numerics.geometry import FloatArray, diagonal, lengths
from dtrepair.pipeline.modelled.meshes import Look, PlacedMeshes

if TYPE_CHECKING:
    from dtrepair.numerics.attachments import Reference

# Two connected parts, by any numbers.
PartPair = tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class SlideOptions:
    """When two rigid parts slide in each other, in units of the smaller one's extent.

    Args:
        rounding: Vertices are at most so far from a rigid motion: skinning rounds.
        least: A slide is longer than this.
        apart: Poses show where two parts meet if they have slid on by this.
        straight: It strays from its axis by at most this share of its length.
        tilt: The axis itself turns by at most this angle, in radians; about it the parts may spin.
    """

    rounding: float = 1e-3
    least: float = 0.02
    apart: float = 0.02
    straight: float = 0.05
    tilt: float = 0.05


class RigidMotion(NamedTuple):
    """A rotation about the origin, and what is added to it."""

    rotation: Rotation
    shift: FloatArray

    def back(self, points: FloatArray) -> FloatArray:
        """Return where points (..., 3) came from."""
        return np.asarray(self.rotation.apply(points - self.shift, inverse=True))


def slid_references(
    meshes: PlacedMeshes, shown: Look, *, samples: int, options: SlideOptions = SlideOptions()
) -> list[Reference]:
    """Return frames that show parts which slide in each other, where they have slid on.

    shown: a pose with the contacts that were modelled; samples: frames that are looked at, of the
    whole clip.
    """
    count = len(meshes.rest)
    keys = np.unique(shown.keys)
    of_vertex = np.full(count, -1)
    of_vertex[meshes.weld[meshes.faces]] = meshes.part_of[:, None]
    pairs = {divmod(int(key), count): key for key in keys}
    vertices = {part: np.flatnonzero(of_vertex == part) for pair in pairs for part in pair}
    overlaps = {
        pair: shown.points[meshes.faces[shown.pairs[shown.keys == key]]].mean(axis=(0, 1, 2))
        for pair, key in pairs.items()
    }
    poses = (pose for _, pose in meshes.poses(samples))
    ways = slides(shown.points, poses, vertices, overlaps, options=options)
    found, seen = [], {pair: [0.0] for pair in ways}
    # Read again: few characters have parts that slide.
    for index, (name, pose) in enumerate(meshes.poses(samples) if ways else ()):
        new = []
        for pair, way in ways.items():
            apart = options.apart * min(diagonal(shown.points[vertices[part]]) for part in pair)
            if min(abs(way[index] - other) for other in seen[pair]) > apart:
                seen[pair].append(way[index])
                new.append(pairs[pair])
        if new:
            look = meshes.look(pose, name)
            found.append(look.of(np.isin(look.keys, new)).reference()._replace(slid=True))
    return found


def slides(
    shown: FloatArray,
    poses: Iterable[FloatArray],
    vertices: Mapping[int, NDArray[np.integer]],
    overlaps: Mapping[PartPair, FloatArray],
    *,
    options: SlideOptions = SlideOptions(),
) -> dict[PartPair, FloatArray]:
    """Return how far along its axis each pair of parts that slides has slid in each pose (T,).

    Args:
        shown: The pose (V, 3) that shows how the parts were modelled.
        poses: Others (V, 3), each looked at once.
        vertices: Of each part, (N,).
        overlaps: Middle (3,) of the overlap of each pair of parts in `shown`.
    """
    paths: dict[PartPair, list[FloatArray]] = {pair: [] for pair in overlaps}
    turns: dict[PartPair, list[Rotation]] = {pair: [] for pair in overlaps}
    for pose in poses:
        if not paths:
            return {}
        moved = {
            part: rigid_motion(shown[vertices[part]], pose[vertices[part]], options.rounding)
            for part in {part for pair in paths for part in pair}
        }
        for first, second in list(paths):
            one, other = moved[first], moved[second]
            if one is None or other is None:
                del paths[first, second]
                continue
            there = one.rotation.apply(overlaps[first, second]) + one.shift
            paths[first, second].append(other.back(there) - overlaps[first, second])
            turns[first, second].append(other.rotation.inv() * one.rotation)
    found = {}
    for pair, path in paths.items():
        extent = min(diagonal(shown[vertices[part]]) for part in pair)
        way = _straight_way(np.array(path), turns[pair], extent, options)
        if way is not None:
            found[pair] = way
    return found


def rigid_motion(rest: FloatArray, pose: FloatArray, rounding: float) -> RigidMotion | None:
    """Return the motion that takes points (N, 3) to others, or None if they also deform.

    rounding: how far from it they may be, units of the extent of the rest.
    """
    if len(rest) < 3:
        return None
    middle, there = rest.mean(axis=0), pose.mean(axis=0)
    spread = (pose - there).T @ (rest - middle)
    left, _, right = np.linalg.svd(spread)
    proper = np.diag([1.0, 1.0, np.linalg.det(left @ right)])
    rotation = Rotation.from_matrix(left @ proper @ right)
    found = RigidMotion(rotation, there - rotation.apply(middle))
    far = lengths(found.back(pose) - rest).max()
    return found if far <= rounding * diagonal(rest) else None


def _straight_way(
    path: FloatArray, turns: list[Rotation], extent: float, options: SlideOptions
) -> FloatArray | None:
    """Return how far (T,) a path (T, 3) has gone along its axis, None where it has none."""
    if len(path) == 0:
        return None
    far = lengths(path)
    longest = float(far.max())
    if longest < options.least * extent:
        return None
    axis = path[far.argmax()] / longest
    along: FloatArray = path @ axis
    astray = lengths(path - along[:, None] * axis).max()
    tilted = max(float(np.linalg.norm(turn.apply(axis) - axis)) for turn in turns)
    if astray > options.straight * longest or tilted > options.tilt:
        return None
    return along
