"""Other ways through strained frames of a clip: props rigid, joints that turned left alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dtrepair.numerics.geometry import diagonal, lengths
from dtrepair.numerics.temporal import runs_of
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.opened_pose import OpenedPose, Pose, detected
from dtrepair.repair.scene.props import bent_bodies
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes

# Solves frames by the meshes of a way, within the bounds.
Judge = Callable[[WeldedMeshes, list[Pose]], list[Judged]]


@dataclass(frozen=True, kw_only=True)
class OtherWayOptions:
    """Which other ways are taken.

    Args:
        farther, near: Those on which nothing moves farther than so many times what it did on the
            first, and this fraction of the diagonal.
        most: Of attached parts, whose frames are solved each for itself, at most this share of a
            window is solved again: where most frames fail, another way costs much and gains little.
    """

    farther: float = 2.0
    near: float = 0.01
    most: float = 0.5


def on_other_ways(
    meshes: WeldedMeshes,
    frames: Sequence[Pose],
    judged: list[Judged],
    judge: Judge[Pose],
    *,
    options: OtherWayOptions = OtherWayOptions(),
) -> tuple[list[Judged], WeldedMeshes]:
    """Return better poses of a window where another way strains less, and the meshes of its way.

    Strained frames of attached parts, which are solved each for itself, go another way alone: a
    prop that bends within the bounds elsewhere is left at that.
    """
    scene, taken, result = meshes.scene, meshes, list(judged)
    runs = [slice(0, len(frames))]
    if tied := scene.strain_meter.parts.ties is not None:
        lowered = np.array([found.lowered for found in judged])
        runs = runs_of(lowered) if lowered.mean() <= options.most else []
    bent = [bent_bodies(scene, found) for found in judged]
    for way in meshes.otherwise(bent, [frame.centred for frame in frames]):
        for run in runs:
            own, first = list(frames[run]), result[run]
            other = judge(way, own)
            fewer = sum(_left(scene, own, other)) < sum(_left(scene, own, first))
            if fewer and not _much_farther(own, other, first, options):
                result[run] = other
                taken = taken if tied else way
    return result, taken


def with_turns(
    meshes: WeldedMeshes, frames: Sequence[Pose], judged: list[Judged], judge: Judge[Pose]
) -> list[Judged]:
    """Return better poses where strained ones are less so if joints that turned are left alone.

    What such joints have in contact counts all the same in what is handed back.
    """
    turning = meshes.turning
    if turning is None:
        return judged
    scene, result = turning.scene, list(judged)
    for run in runs_of(np.array([found.lowered for found in judged])):
        own = [detected(scene, replace(frame, detected=False)) for frame in frames[run]]
        other, first = judge(turning, own), result[run]
        left = zip(_left(scene, own, other), _left(scene, own, first), strict=True)
        for index, (less, more) in enumerate(left):
            if (less, other[index].lowered) < (more, first[index].lowered):
                result[run.start + index] = other[index]._replace(turned=True)
    return result


def _left(scene: Scene, frames: Sequence[OpenedPose], judged: Sequence[Judged]) -> list[int]:
    """Return how many pairs are left in each pose."""
    both = zip(frames, judged, strict=True)
    return [len(scene.pairs(found.points, frame.weld)) for frame, found in both]


def _much_farther(
    frames: Sequence[OpenedPose],
    other: Sequence[Judged],
    than: Sequence[Judged],
    options: OtherWayOptions,
) -> bool:
    """Return whether poses move much farther: a rigid cuff comes off its arm, and is clean."""
    most, usual = (
        max(
            float(lengths(found.points - frame.centred).max())
            for frame, found in zip(frames, judged, strict=True)
        )
        for judged in (other, than)
    )
    return most > options.farther * usual + options.near * diagonal(frames[0].centred)
