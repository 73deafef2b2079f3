"""Changes of keys that may clean the poses between them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dtrepair.keyposes.tracks import Pose, Track
from dtrepair.numerics.geometry import diagonal, lengths


@dataclass(frozen=True, kw_only=True)
class ChangeOptions:
    """Numbers of the changes that are tried.

    Args:
        scales: A repaired in-between is tried with its displacement times these, in turn: the poses
            beside it profit.
        farthest: Fraction of the diagonal. A given key is moved, instead of adding one, only if no
            vertex moves farther: an animator would see more.
    """

    scales: tuple[float, ...] = (1.0, 1.3, 1.7)
    farthest: float = 0.02


class Change(NamedTuple):
    """Keys (mesh, time, pose) to set; `added` are times that had none."""

    keys: list[tuple[int, float, Pose]]
    added: tuple[float, ...]


def changes(
    tracks: Sequence[Track],
    time: float,
    poses: Sequence[Pose],
    found: Sequence[Pose],
    *,
    added: Sequence[float],
    keep_keys: bool,
    full: bool,
    options: ChangeOptions = ChangeOptions(),
) -> Iterator[Change]:
    """Return changes worth a try, given poses at an in-between and what repair made of them.

    First the neighbouring keys moved: keys at the times `added` freely, others a little, unless
    `keep_keys`; then a key added, unless `full`.
    """
    for only_added in (True,) if keep_keys else (False, True):
        for scale in options.scales if only_added else options.scales[:1]:
            aims = [scaled(old, new, scale) for old, new in zip(poses, found, strict=True)]
            moved = neighbours_moved(
                tracks,
                time,
                poses,
                aims,
                added,
                only_added=only_added,
                farthest=options.farthest,
            )
            if moved is not None:
                yield moved
    for scale in () if full else options.scales:
        keys = [
            (index, time, scaled(old, new, scale))
            for index, (old, new) in enumerate(zip(poses, found, strict=True))
            if (old != new).any()
        ]
        yield Change(keys, (time,))


def neighbours_moved(
    tracks: Sequence[Track],
    time: float,
    poses: Sequence[Pose],
    found: Sequence[Pose],
    added: Sequence[float] = (),
    *,
    only_added: bool = False,
    farthest: float = ChangeOptions.farthest,
) -> Change | None:
    """Return the two keys around a time, moved least such that the pose between them is `found`.

    Least squares over the keys that may move: with weights w of the keys in the pose (1 - p and p
    for part p of the span) the displacement times w / sum w^2. None where no key may move, or a
    vertex of a given key would move farther than `farthest` diagonals.
    """
    keys: list[tuple[int, float, Pose]] = []
    for index, (track, old, new) in enumerate(zip(tracks, poses, found, strict=True)):
        if not (old != new).any():
            continue
        ends = track.around(time)
        if ends is None:
            return None
        part = (time - ends[0]) / (ends[1] - ends[0])
        weights = dict(zip(ends, (1.0 - part, part), strict=True))
        if only_added:
            weights = {end: weight for end, weight in weights.items() if end in added}
        norm = sum(weight**2 for weight in weights.values())
        if norm == 0.0:
            return None
        moved = new.astype(np.float64) - old
        limit = farthest * diagonal(old.astype(np.float64))
        for end, weight in weights.items():
            step = weight / norm * moved
            if end not in added and np.linalg.norm(step, axis=1).max() > limit:
                return None
            pose = track.poses[track.times.index(end)]
            keys.append((index, end, (pose + step).astype(np.float32)))
    return Change(keys, ())


def usual_move(
    tracks: Sequence[Track],
    given: Sequence[Track],
    interpolation: str,
    part: tuple[float, float],
    added: Sequence[float],
    time: float,
    found: Sequence[Pose] | None,
) -> float:
    """Return how far the given keys at the ends of a part went, and what was found at a time.

    In diagonals of the meshes. found: what repair made of the pose at `time`; None: nothing.
    """
    usual = 0.0
    for index, (track, own) in enumerate(zip(tracks, given, strict=True)):
        moves = [_moved(own.at(end), track.at(end)) for end in part if end not in added]
        if found is not None:
            moves.append(_moved(own.at(time, interpolation=interpolation), found[index]))
        usual = max([usual, *moves])
    return usual


def moved_farther(
    tracks: Sequence[Track], given: Sequence[Track], interpolation: str, change: Change
) -> float:
    """Return how far from what was given a change leads keys, diagonals, that go farther by it."""
    farthest = 0.0
    for index, time, pose in change.keys:
        was = given[index].at(time, interpolation=interpolation)
        moved = _moved(was, pose)
        if moved > _moved(was, tracks[index].at(time, interpolation=interpolation)):
            farthest = max(farthest, moved)
    return farthest


def _moved(before: Pose, after: Pose) -> float:
    """Return how far a vertex moves at most between poses (V, 3), in diagonals."""
    points = before.astype(np.float64)
    return float(lengths(after - points).max(initial=0.0)) / (diagonal(points) or 1.0)


def scaled(old: Pose, new: Pose, scale: float) -> Pose:
    """Return a pose displaced by `scale` times as much; vertices that stayed keep every bit."""
    if scale == 1.0:
        return new
    moved = (old != new).any(axis=1)
    farther = old + scale * (new.astype(np.float64) - old)
    return np.where(moved[:, None], farther.astype(np.float32), old)


def reach_of(
    change: Change, before: Sequence[Track], after: Sequence[Track], *, interpolation: str
) -> tuple[float, float]:
    """Return the times between which a change of the keys of tracks has an effect."""
    low, high = np.inf, -np.inf
    for index, time, _ in change.keys:
        first, last = after[index].reach(time, interpolation=interpolation)
        # Interpolated keys differ everywhere from what a mesh was before its first change.
        if before[index].original is not None and not before[index].changed:
            first, last = -np.inf, np.inf
        low, high = min(low, first), max(high, last)
    return low, high
