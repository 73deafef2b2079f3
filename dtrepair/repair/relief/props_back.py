"""Props that were led out of something come back in the frames around, where nothing meets them.

Shifts of rigid bodies are smooth over many frames, and no other stage takes them back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.temporal import eased_in_time
from dtrepair.repair.scene.bounds import Judged, wrong_of_groups
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene


@dataclass(frozen=True, kw_only=True)
class PropsBackOptions:
    """How props come back.

    Args:
        halvings: The least share of its correction that a prop needs is found by so many.
        width: Standard deviation, in frames, over which shares come and go.
        tries: Eased in time, all of it may have to come back in some frames: so many tries.
    """

    halvings: int = 3
    width: float = 1.0
    tries: int = 4


def props_back(
    scene: Scene,
    frames: Sequence[OpenedPose],
    judged: list[Judged],
    times: FloatArray,
    *,
    options: PropsBackOptions = PropsBackOptions(),
) -> list[Judged]:
    """Return what was found for frames with props no farther out than they have to be.

    Args:
        scene: The bodies; props among them may be rigid.
        frames: The input.
        judged: What was found for it.
        times: Of the frames (T,), in frame units.
        options: The numbers.
    """
    props = [k for k, body in enumerate(scene.bodies) if body.prop and body.rigid]
    own = [scene.vertices_of(k) for k in props]
    both = list(zip(frames, judged, strict=True))
    moved = np.array([[(f.centred[v] != j.points[v]).any() for v in own] for f, j in both], bool)
    if not moved.any():
        return judged

    def wrong(frame: OpenedPose, points: FloatArray) -> IntArray:
        """Return how much is wrong with each prop (P,) in a pose (V, 3) of a frame."""
        return wrong_of_groups(scene, frame, points, scene.body_of_part)[props]

    left = [wrong(frame, found.points) for frame, found in both]

    def placed(kept: FloatArray) -> list[FloatArray]:
        """Return the poses (V, 3) with shares (T, P) of what moves the props."""
        return [_placed(scene, own, *each) for each in zip(frames, judged, kept, strict=True)]

    def closed(kept: FloatArray) -> IntArray:
        """Return in which frames which props (T, P) then meet more than they did."""
        asked = zip(frames, placed(kept), left, strict=True)
        return np.array([wrong(f, points) > was for f, points, was in asked])

    low, needed = np.zeros((2, *moved.shape))
    needed[moved & closed(low)] = 1.0
    for _ in range(options.halvings if needed.any() else 0):
        middle = 0.5 * (low + needed)
        bad = closed(middle)
        low, needed = np.where(bad, middle, low), np.where(bad, needed, middle)
    for _ in range(options.tries):
        kept = eased_in_time(needed, times, options.width)
        if not (bad := closed(kept)).any():
            poses = placed(kept)
            return [own._replace(points=pose) for own, pose in zip(judged, poses, strict=True)]
        needed[bad] = 1.0
    return judged


def _placed(
    scene: Scene, own: Sequence[slice], frame: OpenedPose, judged: Judged, kept: FloatArray
) -> FloatArray:
    """Return a pose (V, 3) with shares (P,) of what moves some props, each of them rigid."""
    before, result = frame.centred, judged.points.copy()
    for vertices, share in zip(own, kept.tolist(), strict=True):
        if share < 1.0:
            result[vertices] = before[vertices] + share * (result[vertices] - before[vertices])
    fitted: FloatArray = scene.rigid.fitted(before, result)
    return fitted
