"""Small parts go along with what they are attached to: rivets, knuckles, pins, buttons.

Ties are judged by the size of the character, which leaves what is smaller than that bound free to
leave what it sits on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.numerics.geometry import FloatArray, extent, extents, lengths
from dtrepair.repair.relief.swelling import ROUNDING
from dtrepair.repair.scene.bounds import badness, pairs_and_enclosed, strain_of
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.strain.turning import best_rotation

Places = NDArray[np.integer]


@dataclass(frozen=True, kw_only=True)
class SmallPartOptions:
    """Which parts are small, and when they are led back.

    Args:
        small: At most so large at rest, units of the scene's size.
        smaller: And so much smaller than what they are attached to.
        off: Those are led back that are farther off than this, units of their own size.
        rings: What they are attached to is what is near their ties, by so many edge rings.
        alone: Where not all can be led back at once, so many are tried alone, the largest first.
    """

    small: float = 0.06
    smaller: float = 0.8
    off: float = 0.1
    rings: int = 2
    alone: int = 8


class _Part(NamedTuple):
    """The vertices (N,) of a small part, and those (K,) beside its ties on what it is tied to."""

    own: Places
    hosts: Places

    def target(self, before: FloatArray, points: FloatArray) -> FloatArray:
        """Return it (N, 3) moved from one pose (V, 3) to another as what it is tied to."""
        old, new = (
            np.vstack([near.mean(axis=0), near])
            for near in (before[self.hosts], points[self.hosts])
        )
        spokes = np.stack([np.zeros(len(old) - 1), np.arange(1, len(old))], axis=1)
        turn = best_rotation(old, new, spokes.astype(np.int32))
        return np.asarray((before[self.own] - old[0]) @ turn.T + new[0])

    def is_off(self, before: FloatArray, points: FloatArray, share: float) -> bool:
        """Return whether it is farther off than a share of its own size."""
        off = lengths(points[self.own] - self.target(before, points)).max()
        # A prop may be hidden in a point.
        return bool(off > share * extent(before[self.own]) > 0.0)


class SmallParts:
    """The small parts of a scene that may move, the largest first."""

    def __init__(self, scene: Scene, *, options: SmallPartOptions = SmallPartOptions()) -> None:
        self.scene, self.options = scene, options
        self.parts = list(_small_parts(scene, options))

    def __call__(self, pose: OpenedPose, points: FloatArray) -> FloatArray:
        """Return what was found (V, 3) for a pose, small parts as what they are attached to.

        Where that is not more strained, brings no contact back, and leads nothing farther than
        what was found does: all at once, or else some. What hangs on one of them follows it.
        """
        before, share = pose.centred, self.options.off
        every = points.copy()
        for part in self.parts:
            if part.is_off(before, every, share):
                every[part.own] = part.target(before, every)
        if (every == points).all():
            return points
        judge = _Judge(self.scene, pose, points)
        if judge.takes(every):
            return every
        tried = 0
        for part in self.parts:
            if tried < self.options.alone and part.is_off(before, points, share):
                trial = points.copy()
                trial[part.own] = part.target(before, points)
                tried += 1
                points = trial if judge.takes(trial) else points
        return points


class _Judge:
    """Tells whether a pose is as good as the best one before it."""

    def __init__(self, scene: Scene, pose: OpenedPose, points: FloatArray) -> None:
        self.scene, self.pose = scene, pose
        self.farthest = float(lengths(points - pose.centred).max())
        self.strain = badness(strain_of(scene, pose.centred, points))
        self.wrong = pairs_and_enclosed(scene, pose, points)

    def takes(self, trial: FloatArray) -> bool:
        """Return whether a pose (V, 3) is no worse; the next one must be no worse than it."""
        before = self.pose.centred
        if lengths(trial - before).max() > self.farthest * (1.0 + ROUNDING):
            return False
        strain = badness(strain_of(self.scene, before, trial))
        if strain > self.strain * (1.0 + ROUNDING):
            return False
        wrong = pairs_and_enclosed(self.scene, self.pose, trial)
        if wrong[0] > self.wrong[0] or wrong[1] > self.wrong[1]:
            return False
        self.strain, self.wrong = strain, wrong
        return True


def _small_parts(scene: Scene, options: SmallPartOptions) -> Iterator[_Part]:
    """Yield the small parts that may move, the largest first."""
    parts = scene.strain_meter.parts
    if parts.ties is None:
        return
    of_vertex = parts.of_vertex[scene.rest_sewn]
    known = of_vertex >= 0
    sizes = extents(scene.rest[known], of_vertex[known])
    tops, corners = parts.ties.vertices, parts.corners[parts.ties.triangles]
    of_top, of_host = parts.of_vertex[tops], parts.of_vertex[corners[:, 0]]
    ends = np.concatenate([parts.edges, parts.edges[:, ::-1]])
    beside = sparse.csr_matrix(
        (np.ones(len(ends), dtype=bool), ends.T), shape=(len(of_vertex),) * 2
    )
    small = np.flatnonzero(
        (sizes <= options.small * scene.scale.extent(scene.rest)) & (sizes > 0.0)
    )
    for number in small[np.argsort(-sizes[small], kind="stable")].tolist():
        larger = options.smaller * sizes >= sizes[number]
        rows = corners[(of_top == number) & larger[of_host]].ravel()
        near = np.union1d(rows, tops[(of_host == number) & larger[of_top]])
        own = np.flatnonzero(of_vertex == number)
        stays = scene.is_stiff(int(scene.body_of_vertex[own[0]])) or scene.direction[own].any()
        if len(near) == 0 or stays or (scene.mobility[own] == 0.0).any():
            continue
        for _ in range(options.rings):
            near = np.union1d(near, beside[near].indices)
        yield _Part(own, near)
