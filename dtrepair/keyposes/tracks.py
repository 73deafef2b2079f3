"""Keys of meshes over time, and the poses between them."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.keyposes.options import INTERPOLATIONS

Pose = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Track:
    """The keys of one mesh; changes give a new track.

    Args:
        times: Key times, increasing; empty for a mesh that does not move.
        poses: Points (V, 3) float32 at each key; one pose for a mesh that does not move.
        original: Points of the input at any time; None: interpolated keys. They are the points as
            long as no key was changed.
        changed: Times of the keys that were changed or added.
        frames: Times, increasing, that are written as well where a key was changed: points of the
            input, displaced as the keys around them. Needs `original`.
        held: Those of the frames that stay as in the input: nobody looks at them.
    """

    times: tuple[float, ...]
    poses: tuple[Pose, ...]
    original: Callable[[float], Pose] | None = None
    changed: frozenset[float] = frozenset()
    frames: tuple[float, ...] = ()
    held: frozenset[float] = frozenset()

    def __post_init__(self) -> None:
        """Check that keys and times fit together."""
        if len(self.poses) != max(len(self.times), 1):
            raise ValueError(
                f"poses should hold one pose for each of {len(self.times)} times (one for a still "
                f"mesh), got {len(self.poses)}"
            )
        if any(not a < b for a, b in zip(self.times, self.times[1:], strict=False)):
            raise ValueError("times should increase; sort the keys and leave out doubles")

    def at(self, time: float, *, interpolation: str = "linear") -> Pose:
        """Return points (V, 3) float32 at a time; first and last pose are held beyond the ends."""
        if self.original is not None and not self.changed and interpolation == "linear":
            return self.original(time)
        if not self.times:
            return self.poses[0]
        if not self.frames:
            return between(self.times, self.poses, time, interpolation=interpolation)
        after = bisect_left(self.written, time)
        if after < len(self.written) and self.written[after] == time:
            return self._at_frame(time)
        # A cubic depends on the two samples before a time and the two after it.
        reach = 1 if interpolation == "linear" else 2
        near = self.written[max(after - reach, 0) : after + reach]
        poses = [self._at_frame(other) for other in near]
        return between(near, poses, time, interpolation=interpolation)

    @cached_property
    def written(self) -> tuple[float, ...]:
        """The times of all samples: keys and frames, increasing."""
        return tuple(sorted({*self.times, *self.frames}))

    def moved_at(self, time: float) -> bool:
        """Return whether a sample is not that of the input: at a key, or between two of them."""
        if time in self.held:
            return False
        return not self.changed.isdisjoint(self.around(time) or (time,))

    def _at_frame(self, time: float) -> Pose:
        """Return the sample (V, 3) at one of the `written` times."""
        if time in self.times:
            return self.poses[self.times.index(time)]
        assert self.original is not None
        given, around = self.original(time), self.around(time)
        if around is None or not self.moved_at(time):
            return given
        start, end = around
        part = (time - start) / (end - start)
        moved = (1.0 - part) * self._moved(start) + part * self._moved(end)
        return (given + moved).astype(np.float32)

    def _moved(self, key: float) -> NDArray[np.float64] | float:
        """Return how far a key was moved from the input (V, 3)."""
        if key not in self.changed or self.original is None:
            return 0.0
        pose = self.poses[self.times.index(key)].astype(np.float64)
        return np.asarray(pose - self.original(key))

    def with_key(self, time: float, pose: Pose, *, all_times: Sequence[float] = ()) -> Track:
        """Return the track with a key changed or added.

        all_times: a still mesh gets keys at these times first, so that it changes nowhere else.
        """
        track = self
        if not self.times:
            times = tuple(sorted({*all_times, time}))
            track = replace(self, times=times, poses=self.poses * len(times))
        index = bisect_left(track.times, time)
        old = index < len(track.times) and track.times[index] == time
        after = index + 1 if old else index
        return replace(
            track,
            times=(*track.times[:index], time, *track.times[after:]),
            poses=(*track.poses[:index], pose, *track.poses[after:]),
            changed=track.changed | {time},
        )

    def without_key(self, time: float) -> Track:
        """Return the track without the key at `time`, if it has one."""
        if time not in self.times:
            return self
        index = self.times.index(time)
        return replace(
            self,
            times=self.times[:index] + self.times[index + 1 :],
            poses=self.poses[:index] + self.poses[index + 1 :],
            changed=self.changed - {time},
        )

    def around(self, time: float) -> tuple[float, float] | None:
        """Return the keys before and after a time; None at a key, beyond the ends, or if still."""
        index = bisect_left(self.times, time)
        if index in (0, len(self.times)) or self.times[index] == time:
            return None
        return self.times[index - 1], self.times[index]

    def reach(self, time: float, *, interpolation: str = "linear") -> tuple[float, float]:
        """Return the times between which the pose depends on a key at `time`."""
        keys = 1 if interpolation == "linear" else 2
        first = bisect_left(self.times, time) - keys
        last = bisect_right(self.times, time) + keys - 1
        low = self.times[first] if first >= 0 else -np.inf
        return low, self.times[last] if last < len(self.times) else np.inf


def between(
    times: Sequence[float], poses: Sequence[Any], time: float, *, interpolation: str = "linear"
) -> Pose:
    """Return points (V, 3) float32 at a time between keys (T,), poses T x (V, 3) float32.

    "linear" rounds as USD does, bit for bit: weights in double precision, each product rounded to
    float32, then their sum. "cubic" is the Catmull-Rom spline (Catmull and Rom 1974) for uneven
    times: tangents are central differences, one-sided at the ends. ValueError for another name.
    """
    if interpolation not in INTERPOLATIONS:
        raise ValueError(
            f"interpolation should be one of {', '.join(INTERPOLATIONS)}, got {interpolation!r}"
        )
    after = bisect_left(times, time)
    if after == len(times):
        return np.asarray(poses[-1])
    if after == 0 or times[after] == time:
        return np.asarray(poses[after])
    start, end = times[after - 1], times[after]
    part = (time - start) / (end - start)
    if interpolation == "linear":
        first = (np.asarray(poses[after - 1], np.float64) * (1.0 - part)).astype(np.float32)
        return first + (np.asarray(poses[after], np.float64) * part).astype(np.float32)
    rise, fall = _slope(times, poses, after - 1), _slope(times, poses, after)
    one, two = (np.asarray(poses[k], np.float64) for k in (after - 1, after))
    square, cube, span = part * part, part**3, end - start
    points = (2 * cube - 3 * square + 1) * one + (3 * square - 2 * cube) * two
    points += span * ((cube - 2 * square + part) * rise + (cube - square) * fall)
    return points.astype(np.float32)


def _slope(times: Sequence[float], poses: Sequence[Any], index: int) -> NDArray[np.float64]:
    """Return the difference quotient over the neighbours of a key."""
    before, after = max(index - 1, 0), min(index + 1, len(times) - 1)
    change = np.asarray(poses[after], np.float64) - np.asarray(poses[before], np.float64)
    return change / (times[after] - times[before])
