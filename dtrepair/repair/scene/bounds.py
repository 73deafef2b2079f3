"""No harm: of a correction that strains a shape, the share within the bounds is kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import FloatArray, IntArray, lengths
from dtrepair.numerics.temporal import eased_in_time, frame_units
from dtrepair.repair.scene.holding import Holding
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.strain.meter import Excess
from dtrepair.repair.strain.shares import ShareOptions, ShareSearch, eased_shares, followed_shares

# Finds the intersecting pairs (K, 2) of a pose (V, 3).
PairsOf = Callable[[FloatArray], IntArray]
# Clips: lower regions, put back those that it did not help, then whole frames.
ATTEMPTS = 3
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


def strain_of(
    scene: Scene, before: FloatArray, after: FloatArray, *, strict: bool = False
) -> tuple[Excess, ...]:
    """Return what a correction strains beyond the bounds; the published method has none.

    strict: see `StrainMeter`.
    """
    if scene.options.method != "full":
        return ()
    return tuple(scene.strain_meter(before, after, strict=strict))


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
    the options take it at any cost.
    """
    excess = strain_of(scene, pose.centred, judged.points)
    if not excess or scene.options.at_any_cost:
        return judged._replace(excess=(*judged.excess, *excess)), pairs
    wrong = _wrong(scene, pose, judged.points, pairs)
    if 0 < wrong >= pose.wrong:
        return judged, pairs  # no better than the input, which is kept
    search = share_search(scene, pose.centred, judged.points, options)
    best: list[tuple[int, FloatArray, IntArray]] = []
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


def bounded_frames(
    scene: Scene,
    frames: Sequence[OpenedPose],
    poses: list[FloatArray],
    times: FloatArray,
    *,
    options: ShareOptions = ShareOptions(),
) -> list[Judged]:
    """Return poses (V, 3) of frames within the bounds; their shares are smooth in time.

    times: of the frames (T,). No frame gets more pairs than its input has.
    """
    if scene.options.at_any_cost:
        return [Judged(points) for points in poses]
    excess = [
        strain_of(scene, frame.centred, points) for frame, points in zip(frames, poses, strict=True)
    ]
    if not any(excess):
        return [Judged(points) for points in poses]
    best = _lowered(scene, frames, poses, times, options)
    held = _held(scene, frames, poses, times, excess, options)
    if held is not None:
        ways = [best, _lowered(scene, frames, held, times, options)]
        best = min(ways, key=lambda way: sum(wrong_in(scene, frames, way)))
    judged = []
    for index, points in enumerate(best):
        changed = not np.array_equal(points, poses[index])
        lost = changed and _loses(scene, frames[index], poses[index], points)
        judged.append(Judged(points, excess[index] if lost else (), lost))
    return judged


def _lowered(
    scene: Scene,
    frames: Sequence[OpenedPose],
    poses: list[FloatArray],
    times: FloatArray,
    options: ShareOptions,
) -> list[FloatArray]:
    """Return the shares of poses (V, 3) that are within the bounds.

    A frame within them on its own stays as it is where easing would spoil it. None gets more pairs
    than its input has.
    """
    both = list(zip(frames, poses, strict=True))
    strained = [bool(strain_of(scene, frame.centred, points)) for frame, points in both]
    most = _most(scene, frames, poses, strained, options)
    motions = np.stack(
        [
            lengths(points - own.centred) / (scene.scale.diagonal(own.centred) or 1.0)
            for own, points in both
        ]
    )
    units, faulty = frame_units(times), np.array([frame.wrong > 0 for frame in frames])
    failing: list[int] = np.flatnonzero(strained).tolist()
    firm: list[int] = []
    needed = np.ones((len(frames), len(scene.rest)))
    eased, bounded = needed, list(poses)
    for attempt in range(ATTEMPTS):
        for index in failing:
            share = _share(scene, frames[index], bounded[index], attempt, options)
            needed[index] = eased[index] * share
        eased = eased_shares(needed, units, motions, options=options)
        eased = followed_shares(eased, units, motions, faulty, options=options)
        eased[firm] = 1.0
        failing = []
        for index in np.flatnonzero((eased < 1.0).any(axis=1)).tolist():
            bounded[index] = blended(scene, frames[index].centred, poses[index], eased[index])
            if _fails(scene, frames[index], bounded[index], most[index]):
                (failing if strained[index] else firm).append(index)
        for index in firm:
            bounded[index] = poses[index]
        if not failing:
            break
    return bounded


def wrong_in(scene: Scene, frames: Sequence[OpenedPose], poses: Sequence[FloatArray]) -> list[int]:
    """Return how much is wrong with each of some poses (V, 3)."""
    both = zip(frames, poses, strict=True)
    return [wrong_of(scene, own, points) for own, points in both]


def _held(
    scene: Scene,
    frames: Sequence[OpenedPose],
    poses: list[FloatArray],
    times: FloatArray,
    excess: Sequence[Sequence[Excess]],
    options: ShareOptions,
) -> list[FloatArray] | None:
    """Return poses (V, 3) with attached parts brought back where they came off, eased in time.

    None where they did not; none gets more pairs than its input has, and those within the bounds
    hardly more than they have.
    """
    off = np.array([any(own.kind in LOOSE for own in found) for found in excess])
    if not off.any():
        return None
    holding = Holding(scene)
    shares = eased_in_time(off * 1.0, frame_units(times), holding.options.time)
    result = [
        scene.rigid.fitted(own.centred, points + share * holding(own.centred, points))
        for own, points, share in zip(frames, poses, shares, strict=True)
    ]
    most = _most(scene, frames, poses, [bool(found) for found in excess], options)
    whole = zip(poses, result, wrong_in(scene, frames, result), most, strict=True)
    return [held if left <= enough else points for points, held, left, enough in whole]


def _most(
    scene: Scene,
    frames: Sequence[OpenedPose],
    poses: Sequence[FloatArray],
    strained: Sequence[bool],
    options: ShareOptions,
) -> list[int]:
    """Return how much may be wrong with each frame: as with its input, if it is strained.

    A frame within the bounds on its own is hardly spoilt by what its neighbours need.
    """
    return [
        frame.wrong if own else min(frame.wrong, options.spoilt + wrong_of(scene, frame, points))
        for own, frame, points in zip(strained, frames, poses, strict=True)
    ]


def _share(
    scene: Scene, frame: OpenedPose, after: FloatArray, attempt: int, options: ShareOptions
) -> FloatArray:
    """Return the share (V,) of a correction that an attempt keeps.

    The first attempt keeps that with which least is wrong.
    """
    if attempt == ATTEMPTS - 1:
        return np.zeros(len(after))
    search = share_search(scene, frame.centred, after, options)
    if attempt:
        return search.put_back()
    enough, best = wrong_of(scene, frame, after), (np.inf, np.zeros(len(after)))
    for share in search.shares():
        wrong = wrong_of(scene, frame, search.blend(share))
        if wrong < best[0]:
            best = (wrong, share)
        if wrong <= enough:
            break
    return best[1]


def _fails(scene: Scene, frame: OpenedPose, points: FloatArray, most: int) -> bool:
    """Return whether a pose (V, 3) is strained, or more than `most` is wrong with it."""
    return bool(strain_of(scene, frame.centred, points)) or wrong_of(scene, frame, points) > most


def wrong_of(scene: Scene, frame: OpenedPose, points: FloatArray) -> int:
    """Return how much is wrong with a pose (V, 3) whose pairs are not known."""
    return _wrong(scene, frame, points, scene.pairs(points, frame.weld))


def _loses(scene: Scene, frame: OpenedPose, whole: FloatArray, points: FloatArray) -> bool:
    """Return whether more is wrong with a pose (V, 3) than with the whole correction."""
    return wrong_of(scene, frame, points) > wrong_of(scene, frame, whole)


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
    scene: Scene, before: FloatArray, after: FloatArray, options: ShareOptions
) -> ShareSearch:
    """Return the search for shares of a correction of the scene, poses (V, 3)."""

    def blend(share: FloatArray) -> FloatArray:
        return blended(scene, before, after, share)

    return ShareSearch(scene.strain_meter, before, after, blend, options=options)


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
