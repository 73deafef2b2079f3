"""No harm: of a correction that strains a shape, the share within the bounds is kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.strain.bounds import Excess
from dtrepair.repair.strain.shares import ShareOptions, ShareSearch

# Finds the intersecting pairs (K, 2) of a pose (V, 3).
PairsOf = Callable[[FloatArray], IntArray]
# Strains of what is attached.
LOOSE = (StrainKind.DRIFT, StrainKind.SLIDE)


class Judged(NamedTuple):
    """A pose (V, 3) that was judged.

    excess: what is strained, or would be without the bounds. lowered: whether only a share of the
    correction is left, for the bounds of this frame or of its neighbours. turned: whether joints
    that turned out of where they meet at rest were left alone.
    """

    points: FloatArray
    excess: tuple[Excess, ...] = ()
    lowered: bool = False
    turned: bool = False


# What is kept of a pose, with its pairs (K, 2).
Bounded = tuple[Judged, IntArray]


def strain_of(
    scene: Scene,
    before: FloatArray,
    after: FloatArray,
    *,
    strict: bool = False,
    loosely: bool = False,
) -> tuple[Excess, ...]:
    """Return what a correction strains beyond the bounds; the published method has none.

    strict, loosely: see `StrainMeter`.
    """
    if scene.options.method != "full":
        return ()
    return tuple(scene.strain_meter(before, after, strict=strict, loosely=loosely))


def came_off(scene: Scene, frame: OpenedPose, points: FloatArray) -> bool:
    """Return whether something came off what it goes round in a correction (V, 3) of a frame."""
    excess = strain_of(scene, frame.centred, points)
    return any(own.kind == StrainKind.WORN for own in excess)


def wrong_of_groups(
    scene: Scene, frame: OpenedPose, points: FloatArray, group: IntArray
) -> IntArray:
    """Return how much is wrong with each group of parts (G,) in a pose (V, 3) of a frame.

    How many of their triangles intersect, counted by pairs, and parts lie inside others, or have
    others inside. group: of each part of `enclosures`.
    """
    pairs = scene.pairs(points, frame.weld)
    enclosed = scene.enclosed_parts(points, pairs)
    parts = np.concatenate([scene.enclosures.part_of_face[pairs].ravel(), enclosed.ravel()])
    count = int(group.max(initial=-1)) + 1
    return np.bincount(group[parts], minlength=count).astype(np.int32)


def came_loose(excess: Sequence[Excess]) -> bool:
    """Return whether something attached came off, for which there are looser bounds."""
    return any(own.kind in LOOSE for own in excess)


def badness(excess: Sequence[Excess]) -> float:
    """Return how far beyond its bounds a pose is, 0 where it is within them."""
    return float(sum(own.value / max(own.bound, 1e-12) for own in excess))


def bounded_pose(
    scene: Scene,
    pose: OpenedPose,
    judged: Judged,
    pairs: IntArray,
    pairs_of: PairsOf,
    *,
    options: ShareOptions = ShareOptions(),
) -> tuple[Judged, IntArray]:
    """Return the best pose within the bounds, with its pairs (K, 2): that which has fewest.

    judged: what was found, with `pairs` (K, 2); kept as it is where it is within the bounds, or
    the options take it at any cost. Where a share leaves more, looser bounds hold.
    """
    loosely = scene.options.at_any_cost
    excess = strain_of(scene, pose.centred, judged.points, loosely=loosely)
    if not excess or scene.options.at_any_cost:
        return judged._replace(excess=(*judged.excess, *excess)), pairs
    wrong = _wrong(scene, pose, judged.points, pairs)
    if 0 < wrong >= pose.wrong:
        return judged, pairs  # no better than the input, which is kept
    best: list[tuple[int, FloatArray, IntArray]] = []
    for loosely in (False, True) if came_loose(excess) else (False,):
        if not strain_of(scene, pose.centred, judged.points, loosely=loosely):
            return judged, pairs
        search = share_search(scene, pose.centred, judged.points, options, loosely=loosely)
        for share in search.shares():
            points = search.blend(share)
            found = pairs_of(points)
            left = _wrong(scene, pose, points, found)
            if left <= wrong:
                return Judged(points), found  # nothing is lost, and there is nothing to tell
            if not best or left < best[0][0]:
                best = [(left, points, found)]
    _, points, found = best[0]
    return Judged(points, (*judged.excess, *excess), lowered=True), found


def wrong_in(scene: Scene, frames: Sequence[OpenedPose], poses: Sequence[FloatArray]) -> list[int]:
    """Return how much is wrong with each of some poses (V, 3)."""
    both = zip(frames, poses, strict=True)
    return [wrong_of(scene, own, points) for own, points in both]


def wrong_of(scene: Scene, frame: OpenedPose, points: FloatArray) -> int:
    """Return how much is wrong with a pose (V, 3) whose pairs are not known."""
    return _wrong(scene, frame, points, scene.pairs(points, frame.weld))


def rank_of(scene: Scene, pose: OpenedPose, judged: Judged) -> tuple[int, float]:
    """Return what is wrong with what is kept of a pose, and how far it is, or was, strained."""
    return wrong_of(scene, pose, judged.points), badness(judged.excess)


def _wrong(scene: Scene, pose: OpenedPose, points: FloatArray, pairs: IntArray) -> int:
    """Return how many `pairs` (K, 2), and parts inside others, a correction (V, 3) has."""
    enclosed = scene.enclosed_parts(points, pairs) if len(pose.enclosed) else ()
    return pose.wrong_with(pairs, len(enclosed))


def faults_left(scene: Scene, frames: Sequence[OpenedPose], judged: Sequence[Judged]) -> list[int]:
    """Return how many pairs, and parts wholly inside others, are left in each pose."""
    both = zip(frames, judged, strict=True)
    return [sum(pairs_and_enclosed(scene, frame, found.points)) for frame, found in both]


def pairs_and_enclosed(scene: Scene, pose: OpenedPose, points: FloatArray) -> tuple[int, int]:
    """Return how many pairs a correction (V, 3) of a pose has, and parts inside others."""
    pairs = scene.pairs(points, pose.weld)
    return len(pairs), len(scene.enclosed_parts(points, pairs))


def share_search(
    scene: Scene,
    before: FloatArray,
    after: FloatArray,
    options: ShareOptions,
    *,
    loosely: bool = False,
) -> ShareSearch:
    """Return the search for shares of a correction of the scene, poses (V, 3).

    loosely: see `StrainMeter`.
    """

    def blend(share: FloatArray) -> FloatArray:
        return blended(scene, before, after, share)

    return ShareSearch(scene.strain_meter, before, after, blend, loosely=loosely, options=options)


def blended(scene: Scene, before: FloatArray, after: FloatArray, share: FloatArray) -> FloatArray:
    """Return a pose (V, 3) with a share (V,) of a correction; rigid bodies take their least.

    Vertices with all of it keep every bit of `after`, those with nothing those of `before`.
    """
    own = share[scene.rest_sewn]
    for body in scene.rigid.slices:
        own[body] = own[body].min()
    mixed = before + own[:, None] * (after - before)
    mixed = np.where(own[:, None] < 1.0, mixed, after)
    return scene.rigid.fitted(before, np.where(own[:, None] > 0.0, mixed, before))
