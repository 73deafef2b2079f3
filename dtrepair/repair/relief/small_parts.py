"""Small parts go along with what they are attached to: rivets, knuckles, pins, buttons.

Ties are judged by the size of the character, which leaves what is smaller than that bound free to
leave what it sits on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, extent, extents, lengths
from dtrepair.repair.scene.bounds import badness, pairs_and_enclosed, strain_of
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.strain.turning import best_rotation

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class SmallPartOptions:
    """Which parts are small, and when they are led back.

    Args:
        small: At most so large, units of the scene's size.
        smaller: And so much smaller than what they are attached to.
        off: Those are led back that are farther off than this, units of their own size.
        rings: What they are attached to is what is near their ties, by so many edge rings.
        alone: Where not all can be led back at once, so many are tried alone, the farthest first.
    """

    small: float = 0.06
    smaller: float = 0.8
    off: float = 0.1
    rings: int = 2
    alone: int = 8


@dataclass(frozen=True)
class _Part:
    """A small part: its number, which vertices (V,) are of it, and which are beside its ties."""

    number: int
    own: BoolArray
    hosts: BoolArray
    size: float


def with_small_parts(
    scene: Scene,
    pose: OpenedPose,
    points: FloatArray,
    *,
    options: SmallPartOptions = SmallPartOptions(),
) -> FloatArray:
    """Return what was found (V, 3) for a pose, small parts as what they are attached to has them.

    Where that is not more strained, brings no contact back, and leads nothing farther than what
    was found does: all at once, or else some.
    """
    before = pose.centred
    off = _led_back(before, points, list(_small_parts(scene, before, points, options)), options)
    if not off:
        return points
    farthest = float(lengths(points - before).max())
    least = badness(strain_of(scene, before, points)), *pairs_and_enclosed(scene, pose, points)

    def better(trial: FloatArray) -> bool:
        """Return whether a pose (V, 3) is as good as what was found."""
        if lengths(trial - before).max() > farthest:
            return False
        if badness(strain_of(scene, before, trial)) > least[0]:
            return False
        left = pairs_and_enclosed(scene, pose, trial)
        return left[0] <= least[1] and left[1] <= least[2]

    every = points.copy()
    for part, target, _ in off:
        every[part.own] = target
    if better(every):
        return every
    for part, _, _ in sorted(off, key=lambda each: -each[2])[: options.alone]:
        trial = points.copy()
        trial[part.own] = _target(before, points, part)
        if better(trial):
            points = trial
    return points


def _small_parts(
    scene: Scene, before: FloatArray, points: FloatArray, options: SmallPartOptions
) -> Iterator[_Part]:
    """Yield the small parts of a pose (V, 3) that may move, and moved, the largest first."""
    parts = scene.strain_meter.parts
    if parts.ties is None or not (points != before).any():
        return
    of_vertex = parts.of_vertex[scene.rest_sewn]
    sizes = extents(before[of_vertex >= 0], of_vertex[of_vertex >= 0])
    tops, corners = parts.ties.vertices, parts.corners[parts.ties.triangles]
    of_top, of_host = parts.of_vertex[tops], parts.of_vertex[corners[:, 0]]
    for number in np.argsort(-sizes, kind="stable").tolist():
        largest = options.smaller * sizes
        if sizes[number] > options.small * extent(before):
            continue
        near = np.zeros(len(before), dtype=bool)
        near[corners[(of_top == number) & (sizes[number] <= largest[of_host])]] = True
        near[tops[(of_host == number) & (sizes[number] <= largest[of_top])]] = True
        if not near.any():
            continue
        own = of_vertex == number
        around = parts.grown(near, options.rings) & np.isin(parts.of_vertex, parts.of_vertex[near])
        moved = (points[own | around] != before[own | around]).any()
        if moved and (scene.mobility[own] > 0.0).all():
            yield _Part(number, own, around, float(sizes[number]))


def _led_back(
    before: FloatArray, points: FloatArray, small: list[_Part], options: SmallPartOptions
) -> list[tuple[_Part, FloatArray, float]]:
    """Return the parts that are off, where (N, 3) they belong, and how far off, of their size.

    What hangs on another one of them follows it.
    """
    found, points = [], points.copy()
    for part in small:
        target = _target(before, points, part)
        off = float(lengths(points[part.own] - target).max()) / part.size
        if off > options.off:
            points[part.own] = target
            found.append((part, target, off))
    return found


def _target(before: FloatArray, points: FloatArray, part: _Part) -> FloatArray:
    """Return a small part (N, 3), moved from one pose (V, 3) to another as what it is tied to."""
    old, new = (
        np.vstack([near.mean(axis=0), near]) for near in (before[part.hosts], points[part.hosts])
    )
    spokes = np.stack([np.zeros(len(old) - 1), np.arange(1, len(old))], axis=1).astype(np.int32)
    turn = best_rotation(old, new, spokes)
    return np.asarray((before[part.own] - old[0]) @ turn.T + new[0])
