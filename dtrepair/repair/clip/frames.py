"""Frames of a clip as they come in: gathered, and marked where they start after a cut."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from dtrepair.numerics.geometry import FloatArray, extent
from dtrepair.repair.clip.layout import CutOptions, is_cut, motion_between
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


def read_frames(
    scene: Scene,
    frames: Iterable[tuple[float, Sequence[Any]]],
    *,
    cuts: CutOptions = CutOptions(),
) -> Iterator[Frame]:
    """Yield frames in order, those after a cut marked; ValueError where times do not increase."""
    last: Frame | None = None
    before = jump = motion = 0.0
    starts = True
    for frame in _gathered(scene, frames):
        if last is not None:
            size = extent(last.original) or 1.0
            following = motion_between(last.original, frame.original, size)
            speed = following / (frame.time - last.time)
            # Whether `last` follows a cut is known once the motion after it is.
            starts = starts or is_cut(before, jump, speed, motion, options=cuts)
            yield replace(last, starts=starts)
            before, jump, motion, starts = jump, speed, following, False
        last = frame
    if last is not None:
        yield replace(last, starts=starts or is_cut(before, jump, 0.0, motion, options=cuts))


def _gathered(scene: Scene, frames: Iterable[tuple[float, Sequence[Any]]]) -> Iterator[Frame]:
    last: float | None = None
    for time, poses in frames:
        # The default time of a stage is not a number: fine for the only pose.
        if last is not None and not time > last:
            raise ValueError(f"times should increase, got {time} after {last}")
        last = time
        yield Frame(time=time, **vars(gathered(scene, poses)))


def cross_fade(
    frames: list[Frame], tail: list[FloatArray], poses: list[FloatArray], rigid: RigidBodies
) -> None:
    """Fade from the poses of the window before (`tail`) to those of this one, smoothly in time.

    What both leave alone keeps every bit.
    """
    for index, before in enumerate(tail):
        part = (frames[index].time - frames[0].time) / (frames[len(tail)].time - frames[0].time)
        weight = part * part * (3.0 - 2.0 * part)
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
