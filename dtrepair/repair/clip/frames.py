"""Frames of a clip as they come in: gathered, marked where they start after a cut, holds as one."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.clip.layout import CutOptions, cuts_along, motion_between
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.opened_pose import OpenedPose, gathered
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.surface.rigid_bodies import RigidBodies


@dataclass(frozen=True, eq=False, kw_only=True)
class Frame(OpenedPose):
    """A pose at a time.

    Args:
        time: When it is, in the unit of the clip.
        starts: Whether it is the first one, or the first after a cut.
    """

    time: float
    starts: bool = False

    @property
    def seen(self) -> FloatArray:
        """The points (V, 3) as they came, not a number where a body is not there."""
        if self.absent is None:
            return self.original
        return np.where(self.absent[:, None], np.nan, self.original)


def read_frames(
    scene: Scene,
    frames: Iterable[tuple[float, Sequence[Any]]],
    *,
    cuts: CutOptions = CutOptions(),
) -> Iterator[Frame]:
    """Yield frames in order, those after a cut marked; ValueError where times do not increase."""
    waiting: deque[Frame] = deque()
    steps = _steps(_gathered(scene, frames), waiting)
    for cut in cuts_along(steps, options=cuts):
        yield replace(waiting.popleft(), starts=cut)


def _steps(frames: Iterable[Frame], waiting: deque[Frame]) -> Iterator[tuple[float, float]]:
    """Yield how fast and far each frame is from the last one, the first endlessly; keep it."""
    last: Frame | None = None
    for frame in frames:
        waiting.append(frame)
        if last is None:
            yield 0.0, math.inf
        else:
            motion = motion_between(last.seen, frame.seen)
            yield motion / (frame.time - last.time), motion
        last = frame


def _gathered(scene: Scene, frames: Iterable[tuple[float, Sequence[Any]]]) -> Iterator[Frame]:
    last: float | None = None
    for time, poses in frames:
        # The default time of a stage is not a number: fine for the only pose.
        if last is not None and not time > last:
            raise ValueError(f"times should increase, got {time} after {last}")
        last = time
        yield Frame(time=time, **vars(gathered(scene, poses)))


def holds_of(frames: Sequence[Frame]) -> list[slice]:
    """Return the runs of frames that hold one pose, to the bit; most are of one frame."""
    moves = [
        not np.array_equal(before.original, after.original) for before, after in pairwise(frames)
    ]
    starts = [0, *(index for index, move in enumerate(moves, start=1) if move)]
    return [slice(*ends) for ends in pairwise([*starts, len(frames)])]


def without_holds(frames: Sequence[Frame], *, longest: int) -> tuple[list[Frame], list[int]]:
    """Return frames of which those that hold a pose are one, and the place (T,) of each in them.

    What is corrected in a hold must not swim; the frames after it move up in time.

    longest: A pose without a fault is one frame for at most so many: corrections only ease into a
        hold, and shall not move all of a long one.
    """
    kept: list[Frame] = []
    place: list[int] = []
    gone = 0.0
    for hold in holds_of(frames):
        own = frames[hold]
        one = own[0].wrong > 0 or len(own) <= longest
        for index, frame in enumerate(own):
            if index and one:
                gone += frame.time - own[index - 1].time
            else:
                kept.append(replace(frame, time=frame.time - gone))
            place.append(len(kept) - 1)
    return kept, place


def fade_weights(frames: Sequence[Frame], count: int) -> FloatArray:
    """Return the weights (count,) of a window in its first frames, which the one before has, too.

    They go from 0 to 1 smoothly in time, and are the same throughout a hold; one that goes on in
    later frames has 1, one that the window before began 0.
    """
    times = np.array([frame.time for frame in frames[: count + 1]])
    part = (times - times[0]) / (times[count] - times[0])
    weights: FloatArray = part * part * (3.0 - 2.0 * part)
    for hold in holds_of(frames[: count + 1]):
        if hold.stop > count and hold.start > 0:
            weights[hold] = 1.0
        elif hold.start > 0:
            weights[hold] = weights[hold].mean()
        elif hold.stop <= count:
            weights[hold] = 0.0
    return weights[:count]


def cross_fade(
    frames: list[Frame], tail: list[FloatArray], poses: list[FloatArray], rigid: RigidBodies
) -> None:
    """Fade from the poses of the window before (`tail`) to those of this one, smoothly in time.

    What both leave alone keeps every bit.
    """
    weights = fade_weights(frames, len(tail)).tolist() if tail else []
    for index, (before, weight) in enumerate(zip(tail, weights, strict=True)):
        original = frames[index].centred
        moved = (1.0 - weight) * (before - original) + weight * (poses[index] - original)
        poses[index] = rigid.fitted(original, original + moved)


def faded(
    frames: list[Frame], tail: list[Judged], judged: list[Judged], rigid: RigidBodies
) -> list[Judged]:
    """Return the poses of a window, those of the window before fading into its first ones."""
    poses = [found.points for found in judged]
    cross_fade(frames, [found.points for found in tail], poses, rigid)
    both = [
        found._replace(
            points=pose,
            excess=found.excess or before.excess,
            lowered=found.lowered or before.lowered,
            turned=found.turned or before.turned,
        )
        for before, found, pose in zip(tail, judged, poses, strict=False)
    ]
    return [*both, *judged[len(tail) :]]
