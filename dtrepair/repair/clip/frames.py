"""Frames of an animation as they come in: gathered, counted, and marked where a shot starts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray, extent
from dtrepair.numerics.temporal import is_cut, motion_between
from dtrepair.repair.scene.bodies import about_centre
from dtrepair.repair.scene.welded_mesh import System
from dtrepair.repair.surface.rigid_bodies import RigidBodies

if TYPE_CHECKING:
    from dtrepair.repair.repairer import SceneRepairer


class Frame(NamedTuple):
    """A pose on its way: time, poses as given, points (V, 3) of all bodies, centred.

    starts: whether the frame starts a shot; pairs, and the parts that are caught inside
    others: once they were `detected`, in `seconds`.
    """

    time: float
    given: Sequence[Any]
    original: FloatArray
    centred: FloatArray
    centre: FloatArray | float
    weld: IntArray
    starts: bool = False
    detected: bool = False
    pairs: IntArray = np.zeros((0, 2), dtype=np.int32)
    caught: IntArray = np.zeros((0, 2), dtype=np.int32)
    seconds: float = 0.0


def read_frames(
    scene: SceneRepairer, frames: Iterable[tuple[float, Sequence[Any]]]
) -> Iterator[Frame]:
    """Frames in order; those that start a new shot are marked."""
    last: Frame | None = None
    before = jump = motion = 0.0
    starts = True
    for frame in _gathered(scene, frames):
        if last is not None:
            size = extent(last.original) or 1.0
            following = motion_between(last.original, frame.original, size)
            speed = following / (frame.time - last.time)
            # Whether `last` starts a shot is known once the motion after it is.
            starts = starts or is_cut(before, jump, speed, motion)
            yield last._replace(starts=starts)
            before, jump, motion, starts = jump, speed, following, False
        last = frame
    if last is not None:
        yield last._replace(starts=starts or is_cut(before, jump, 0.0, motion))


def _gathered(
    scene: SceneRepairer, frames: Iterable[tuple[float, Sequence[Any]]]
) -> Iterator[Frame]:
    last: float | None = None
    for time, poses in frames:
        # The default time of a stage is not a number: fine for the only pose.
        if last is not None and not time > last:
            raise ValueError(f"times should increase, got {time} after {last}")
        last = time
        original = scene._gather(poses)
        centred, centre = about_centre(original)
        yield Frame(time, poses, original, centred, centre, scene._weld(centred))


def system_of(scene: SceneRepairer, welds: Sequence[IntArray]) -> System:
    """The solved mesh of poses: seam duplicates that coincide in the rest and all poses are one."""
    rest_weld = scene.rest_weld
    joined = np.ones(len(rest_weld), dtype=bool)
    for weld in welds:
        joined &= weld[rest_weld] == weld
    together = np.where(joined, rest_weld, np.arange(len(rest_weld)))
    key = together.tobytes()
    if key not in scene._systems:
        scene._systems[key] = System(scene, together)
    return scene._systems[key]


def reduced(system: System, points: FloatArray) -> FloatArray:
    """Points (V, 3) as those of the solved mesh, in units of its size."""
    return points[system.kept] / system.surface.size


def expanded(
    system: System, centred: FloatArray, before: FloatArray, after: FloatArray
) -> FloatArray:
    """A solved pose as points (V, 3); vertices that stayed where they were keep every bit."""
    after = system.surface.rigid.fitted(before, after)
    stayed = (after == before).all(axis=1)[system.place]
    return np.where(stayed[:, None], centred, (after * system.surface.size)[system.place])


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
