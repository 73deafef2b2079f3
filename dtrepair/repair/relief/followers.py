"""Small loose parts go along with what they follow in the input: a collar with its neck.

Nothing holds them, and nothing touches them, so that solving leaves them where they are: a head
that is pushed aside would leave its glasses behind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.attached.riders import RiderOptions, riders
from dtrepair.numerics.attachments import NO_TIES, Ties
from dtrepair.numerics.geometry import FloatArray, IntArray, diagonal, lengths, triangle_areas
from dtrepair.numerics.temporal import eased_in_time
from dtrepair.repair.relief.wholes import rigid_motion_of
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class FollowerOptions:
    """How loose parts go along.

    Args:
        riders: What counts as following.
        stirs: Parts move by so many of their own extents in the clip: what stands still tells
            nothing.
        looks: So many frames tell what follows what, at most.
        faint: Motions below this are left, units of the size; up to twice this they fade in.
        width: Standard deviation, in frames, over which what does not may come and go.
        tries: What would bring contacts stays behind: so often that is looked for.
    """

    riders: RiderOptions = field(default_factory=lambda: RiderOptions(near=1.0))
    stirs: float = 0.02
    looks: int = 9
    faint: float = 1e-4
    width: float = 2.0
    tries: int = 4


def with_followers(
    scene: Scene,
    frames: Sequence[OpenedPose],
    judged: list[Judged],
    times: FloatArray,
    *,
    options: FollowerOptions = FollowerOptions(),
) -> list[Judged]:
    """Return what was found for frames, with loose parts where those that they follow lead them.

    Only what meets nothing in these frames, and where no contact comes of it; smoothly in time.

    Args:
        scene: The bodies.
        frames: The input.
        judged: What was found for it.
        times: Of the frames (T,), in frame units.
        options: The numbers.
    """
    before = np.stack([own.centred for own in frames])
    found = np.stack([own.points for own in judged])
    loose = [] if np.array_equal(before, found) else _loose_parts(scene, frames)
    ties = _ties(scene, loose, before, options)
    parts = [own for own in loose if own in scene.enclosures.part[ties.vertices]]
    if not parts:
        return judged
    following = _Following(scene, ties, parts, before, found, options)
    left, needed = None, np.zeros((len(frames), len(parts)))
    for _ in range(options.tries):
        poses = following(eased_in_time(needed, times, options.width))
        changed = np.flatnonzero((poses != found).any(axis=(1, 2))).tolist()
        if left is None:
            left = {k: following.met(frames[k], found[k]) for k in changed}
        more = {k: following.met(frames[k], poses[k]) > left[k] for k in changed}
        if not any(own.any() for own in more.values()):
            return [own._replace(points=pose) for own, pose in zip(judged, poses, strict=True)]
        for k, own in more.items():
            needed[k, own] = 1.0
    return judged


def _loose_parts(scene: Scene, frames: Sequence[OpenedPose]) -> list[int]:
    """Return the parts that may follow others, the largest first.

    They meet nothing in any of the frames, nothing holds them, they do not lie over others as cloth
    does, may move freely, and are not some of several parts that move as one.
    """
    own = scene.enclosures
    # What is limited or keeps a clearance could do so no longer.
    limited = scene.options.maximum_displacement is not None or scene.options.clearance > 0.0
    if own.count < 2 or limited or scene.options.method != "full":
        return []
    used, free = own.part >= 0, np.ones(own.count, dtype=bool)
    free[own.part[used & (scene.mobility < 1.0)]] = False
    alone = np.bincount(scene.body_of_part, minlength=len(scene.bodies)) == 1
    stiff = np.array([scene.is_stiff(body) for body in range(len(scene.bodies))])
    free[(stiff & ~alone)[scene.body_of_part]] = False
    for frame in frames:
        free[own.part_of_face[frame.pairs]] = False
        free[frame.enclosed] = False
    if (known := scene.attachments) is not None:
        free[own.part_of_face[known.triangles]] = False
        free[own.part[known.every_tie.vertices]] = False
    if scene.covering is not None:
        over: BoolArray = np.asarray(scene.covering.over.any(axis=1))
        free[own.part[used & over[scene.covering.part][: len(used)]]] = False
    areas = np.bincount(own.part_of_face, triangle_areas(scene.centred_rest, own.faces), own.count)
    largest: list[int] = [k for k in np.argsort(-areas, kind="stable").tolist() if free[k]]
    return largest


def _ties(scene: Scene, loose: Sequence[int], before: FloatArray, options: FollowerOptions) -> Ties:
    """Return what loose parts follow from the rest on, in poses (T, V, 3) of the input.

    Not of those that stand still, as they tell nothing.
    """
    own = scene.enclosures
    some = np.linspace(0, len(before) - 1, min(options.looks, len(before))).astype(int)
    poses = [scene.centred_rest, *before[some]]
    hosts, free = np.zeros((2, own.count), dtype=bool)
    hosts[own.part[(own.part >= 0) & (scene.mobility > 0.0)]] = True
    for part in loose:
        points = np.stack([pose[own.part == part] for pose in poses])
        far = np.linalg.norm(points - points[0], axis=2).max()
        free[part] = far > options.stirs * diagonal(points[0])
    if not free.any():
        return NO_TIES
    return riders(poses, own.faces, own.part_of_face, free, hosts, options=options.riders)


class _Following:
    """Poses in which loose parts go along with what they follow.

    Args:
        scene: The bodies.
        ties: What the parts follow.
        parts: Their numbers, hosts before what follows them.
        before, found: The poses (T, V, 3) of the input, and what was found for them.
        options: The numbers.
    """

    def __init__(
        self,
        scene: Scene,
        ties: Ties,
        parts: list[int],
        before: FloatArray,
        found: FloatArray,
        options: FollowerOptions,
    ) -> None:
        self.scene, self.parts, self.before, self.found = scene, parts, before, found
        self._faint = options.faint * scene.scale.extent(before[0])
        part = scene.enclosures.part
        self._vertices = [np.flatnonzero(part == own) for own in parts]
        tied = part[ties.vertices]
        self._feet = [ties.among(tied == own) for own in parts]

    def __call__(self, kept: FloatArray) -> FloatArray:
        """Return poses (T, V, 3) in which each part keeps a share (T, P) of where it was found."""
        result = self.found.copy()
        for column, (own, feet) in enumerate(zip(self._vertices, self._feet, strict=True)):
            corners = self.scene.enclosures.faces[feet.triangles]
            for k, (before, pose) in enumerate(zip(self.before, result, strict=True)):
                old, new = (
                    np.einsum("nk,nkj->nj", feet.weights, points[corners])
                    for points in (before, pose)
                )
                if np.array_equal(old, new):
                    continue
                turn, shift = rigid_motion_of(old, new)
                move = before[own] @ turn.T + shift - pose[own]
                far = float(lengths(move).max())
                share = min(max(far / self._faint - 1.0, 0.0), 1.0) * (1.0 - kept[k, column])
                if share > 0.0:
                    result[k, own] += share * move
        return result

    def met(self, frame: OpenedPose, points: FloatArray) -> IntArray:
        """Return how many pairs each part (P,) has in a pose (V, 3) of a frame."""
        own = self.scene.enclosures
        pairs = self.scene.pairs(points, frame.weld)
        counts = np.bincount(own.part_of_face[pairs].ravel(), minlength=own.count)
        return counts[self.parts].astype(np.int32)
