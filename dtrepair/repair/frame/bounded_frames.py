"""No harm in clips: of what strains a frame the share within the bounds is kept, eased in time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.numerics.temporal import eased_in_time, frame_units
from dtrepair.repair.scene.bounds import (
    Judged,
    blended,
    came_loose,
    share_search,
    strain_of,
    wrong_in,
    wrong_of,
)
from dtrepair.repair.scene.holding import Holding
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.strain.bounds import Excess
from dtrepair.repair.strain.shares import ShareOptions, eased_shares, followed_shares

# Lower regions, put back those that it did not help, then whole frames.
ATTEMPTS = 3


def bounded_frames(
    scene: Scene,
    frames: Sequence[OpenedPose],
    poses: list[FloatArray],
    times: FloatArray,
    *,
    options: ShareOptions = ShareOptions(),
) -> list[Judged]:
    """Return poses (V, 3) of frames within the bounds; their shares are smooth in time.

    times: of the frames (T,). No frame gets more pairs than its input has. Where one would keep
    some within the bounds, looser ones hold.
    """
    if scene.options.at_any_cost:
        return [Judged(points) for points in poses]
    excess = [
        strain_of(scene, frame.centred, points) for frame, points in zip(frames, poses, strict=True)
    ]
    if not any(excess):
        return [Judged(points) for points in poses]
    judged = _judged(scene, frames, poses, times, excess, options)
    lowered = zip(judged, excess, strict=True)
    loose = frozenset(
        index for index, (own, off) in enumerate(lowered) if own.lowered and came_loose(off)
    )
    if not loose:
        return judged
    again = [
        strain_of(scene, frames[index].centred, poses[index], loosely=True)
        if index in loose
        else own
        for index, own in enumerate(excess)
    ]
    looser = _judged(scene, frames, poses, times, again, options, loose)
    left = [wrong_in(scene, frames, [own.points for own in way]) for way in (judged, looser)]
    return looser if sum(left[1]) < sum(left[0]) else judged


def _judged(
    scene: Scene,
    frames: Sequence[OpenedPose],
    poses: list[FloatArray],
    times: FloatArray,
    excess: Sequence[tuple[Excess, ...]],
    options: ShareOptions,
    loose: frozenset[int] = frozenset(),
) -> list[Judged]:
    """Return poses (V, 3) within the bounds.

    excess: what is strained of each frame by the bounds that hold for it; loose: the frames for
    which the looser ones do.
    """
    if not any(excess):
        return [Judged(points) for points in poses]
    best = _lowered(scene, frames, poses, times, options, excess, loose)
    held = _held(scene, frames, poses, times, excess, options)
    if held is not None:
        off = [
            strain_of(scene, own.centred, points, loosely=index in loose)
            for index, (own, points) in enumerate(zip(frames, held, strict=True))
        ]
        ways = [best, _lowered(scene, frames, held, times, options, off, loose)]
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
    excess: Sequence[Sequence[Excess]],
    loose: frozenset[int],
) -> list[FloatArray]:
    """Return the shares of poses (V, 3) that are within the bounds.

    A frame within them on its own stays as it is where easing would spoil it. None gets more pairs
    than its input has.
    """
    both = list(zip(frames, poses, strict=True))
    strained = [bool(own) for own in excess]
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
            share = _share(
                scene, frames[index], bounded[index], attempt, options, loosely=index in loose
            )
            needed[index] = eased[index] * share
        eased = eased_shares(needed, units, motions, options=options)
        eased = followed_shares(eased, units, motions, faulty, options=options)
        eased[firm] = 1.0
        failing = []
        for index in np.flatnonzero((eased < 1.0).any(axis=1)).tolist():
            bounded[index] = blended(scene, frames[index].centred, poses[index], eased[index])
            if _fails(scene, frames[index], bounded[index], most[index], index in loose):
                (failing if strained[index] else firm).append(index)
        for index in firm:
            bounded[index] = poses[index]
        if not failing:
            break
    return bounded


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
    off = np.array([came_loose(found) for found in excess])
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
    scene: Scene,
    frame: OpenedPose,
    after: FloatArray,
    attempt: int,
    options: ShareOptions,
    *,
    loosely: bool,
) -> FloatArray:
    """Return the share (V,) of a correction that an attempt keeps.

    The first attempt keeps that with which least is wrong.
    """
    if attempt == ATTEMPTS - 1:
        return np.zeros(len(after))
    search = share_search(scene, frame.centred, after, options, loosely=loosely)
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


def _fails(scene: Scene, frame: OpenedPose, points: FloatArray, most: int, loosely: bool) -> bool:
    """Return whether a pose (V, 3) is strained, or more than `most` is wrong with it."""
    strained = bool(strain_of(scene, frame.centred, points, loosely=loosely))
    return strained or wrong_of(scene, frame, points) > most


def _loses(scene: Scene, frame: OpenedPose, whole: FloatArray, points: FloatArray) -> bool:
    """Return whether more is wrong with a pose (V, 3) than with the whole correction."""
    return wrong_of(scene, frame, points) > wrong_of(scene, frame, whole)
