"""Animations: overlapping windows of frames in, verified frames out, whatever their number."""

from __future__ import annotations

import time as clock
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dtrepair.geometry import FloatArray, IntArray, extent
from dtrepair.repair.crew import Crew
from dtrepair.repair.full import FullMethod
from dtrepair.repair.mend import mend
from dtrepair.repair.options import RepairResult, Solved, Stage
from dtrepair.repair.shot import ShotMethod
from dtrepair.repair.surface import Surface
from dtrepair.repair.tighten import distortion
from dtrepair.repair.timeline import frame_units, is_cut, motion_between

if TYPE_CHECKING:
    from dtrepair.repair.repairer import SceneRepairer, _System

# Frames that are solved together, and how many of them two windows have in common.
WINDOW, OVERLAP = 64, 12
# A frame whose correction misses only by rounding is mended with this step (units of the size).
MEND_STEP = 0.002


class Frame(NamedTuple):
    """A pose on its way: time, poses as given, points (V, 3) of all bodies, centred, its pairs."""

    time: float
    given: Sequence[Any]
    original: FloatArray
    centred: FloatArray
    centre: FloatArray | float
    weld: IntArray
    pairs: IntArray
    starts: bool = False


class Repaired(NamedTuple):
    """A frame's time and a result for each body."""

    time: float
    results: list[RepairResult]


class AnimationRepairer:
    """Repairs the frames of a scene together: clean, close to the input, and steady.

    Displacements are smooth in time by construction within windows of frames; windows overlap and
    are cross-faded; a cut ends a run. Every frame is verified exactly on the float32 coordinates
    of its result. Memory does not grow with the number of frames.
    """

    def __init__(self, scene: SceneRepairer, *, window: int = WINDOW, overlap: int = OVERLAP) -> None:
        """Use the detector, systems and options of `scene`; ValueError for a bad window."""
        if not 0 < 2 * overlap <= window:
            raise ValueError(f"window should be at least 2 x {overlap} frames, got {window}")
        self.scene = scene
        self.window, self.overlap = window, overlap
        self._methods: dict[int, ShotMethod] = {}

    def stream(
        self,
        frames: Iterable[tuple[float, Sequence[Any]]],
        *,
        jobs: int | None = None,
    ) -> Iterator[Repaired]:
        """Repair (time, poses (V, 3) of each body) in order, on `jobs` threads (None: all).

        At most `window` frames are held. ValueError where times do not increase, and for poses
        that cannot be used.
        """
        if self.scene.options.method != "full":
            for time, poses in frames:
                yield Repaired(time, self.scene(poses))
            return
        stream = _Stream(self, jobs)
        try:
            yield from stream.run(frames)
        finally:
            stream.close()

    def method(self, system: _System) -> ShotMethod:
        """The shot method of a system, made once."""
        if id(system) not in self._methods:
            rounds = self.scene.options.tighten
            self._methods[id(system)] = ShotMethod(
                system.surface, _alone, tighten=min(rounds, 3) if rounds else 0
            )
        return self._methods[id(system)]


def animate(
    scene: SceneRepairer, points: Any, times: ArrayLike | None, jobs: int | None
) -> list[RepairResult]:
    """Results of the frames (T, V, 3) of a scene of one body."""
    count = len(points)
    stamps = np.arange(count) if times is None else np.asarray(times, dtype=np.float64)
    if stamps.shape != (count,):
        raise ValueError(f"times should hold one time for each of {count} frames, got {stamps.shape}")
    frames = ((float(stamp), [points[index]]) for index, stamp in enumerate(stamps))
    return [frame.results[0] for frame in scene.animator.stream(frames, jobs=jobs)]


class _Stream:
    """Frames on their way through one stream of windows."""

    def __init__(self, animator: AnimationRepairer, jobs: int | None) -> None:
        self.animator, self.scene, self.jobs = animator, animator.scene, jobs
        self._crews: dict[int, Crew] = {}

    def close(self) -> None:
        """End all threads."""
        for crew in self._crews.values():
            crew.close()

    def run(self, frames: Iterable[tuple[float, Sequence[Any]]]) -> Iterator[Repaired]:
        """Results in order; windows end at cuts and overlap elsewhere."""
        waiting: list[Frame] = []
        tail: list[FloatArray] = []
        overlap = self.animator.overlap
        for frame in self._read(frames):
            if frame.starts and waiting:
                yield from self._window(waiting, tail, keep=0)[0]
                waiting, tail = [], []
            waiting.append(frame)
            if len(waiting) == self.animator.window:
                done, tail = self._window(waiting, tail, keep=overlap)
                yield from done
                waiting = waiting[-overlap:]
        if waiting:
            yield from self._window(waiting, tail, keep=0)[0]

    def _read(self, frames: Iterable[tuple[float, Sequence[Any]]]) -> Iterator[Frame]:
        """Frames with their pairs; those that start a new shot are marked."""
        last: Frame | None = None
        before = jump = motion = 0.0
        starts = True
        for frame in self._detected(frames):
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

    def _detected(self, frames: Iterable[tuple[float, Sequence[Any]]]) -> Iterator[Frame]:
        from dtrepair.repair.repairer import _centred

        last = -np.inf
        for time, poses in frames:
            if not time > last:
                raise ValueError(f"times should increase, got {time} after {last}")
            last = time
            original = self.scene._gather(poses)
            centred, centre = _centred(original)
            weld = self.scene._weld(centred)
            pairs = self.scene._pairs(centred, weld)
            yield Frame(time, poses, original, centred, centre, weld, pairs)

    def _window(
        self, frames: list[Frame], tail: list[FloatArray], *, keep: int
    ) -> tuple[list[Repaired], list[FloatArray]]:
        """Results of all but the last `keep` frames, and the poses found for those.

        tail: poses found for the first frames by the window before.
        """
        start = clock.perf_counter()
        poses = [frame.centred for frame in frames]
        solved = Solved(poses[0])
        if len(tail) == len(frames):
            poses = tail
        elif any(len(frame.pairs) for frame in frames):
            system = system_of(self.scene, [frame.weld for frame in frames])
            poses = self._solve(system, frames)
            for index, before in enumerate(tail):
                weight = _smoothstep((index + 1) / (len(tail) + 1))
                poses[index] = _blend(frames[index].centred, before, poses[index], weight)
        seconds = (clock.perf_counter() - start) / len(frames)
        kept = len(frames) - keep
        done = [
            self._finish(frame, pose, seconds)
            for frame, pose in zip(frames[:kept], poses[:kept], strict=True)
        ]
        return done, poses[kept:]

    def _solve(self, system: _System, frames: list[Frame]) -> list[FloatArray]:
        """Poses (V, 3) of a window by the space-time scheme."""
        crew = self._crew(system)
        unit = np.stack([_reduced(system, frame.centred) for frame in frames])
        times = frame_units(np.array([frame.time for frame in frames]))
        found = self.animator.method(system)(unit, times, crew)
        return [
            _expanded(system, frame.centred, before, after)
            for frame, before, after in zip(frames, unit, found, strict=True)
        ]

    def _crew(self, system: _System) -> Crew:
        if id(system) not in self._crews:
            self._crews[id(system)] = Crew(system.surface, self.jobs)
        return self._crews[id(system)]

    def _finish(self, frame: Frame, pose: FloatArray, seconds: float) -> Repaired:
        """Verify a pose exactly; what is not clean falls back to single-frame solvers."""
        scene, start = self.scene, clock.perf_counter()
        moved = (pose != frame.centred).any(axis=1)
        left = scene._pairs(pose, frame.weld) if moved.any() else frame.pairs
        if len(left):
            pose, left = self._fallback(frame, pose, left)
        if len(left) and len(left) >= len(frame.pairs):
            pose, left = frame.centred, frame.pairs
        moved = (pose != frame.centred).any(axis=1)
        rounded = pose.astype(np.float32) + frame.centre
        repaired = np.where(moved[:, None], rounded, frame.original)
        spent = seconds + clock.perf_counter() - start
        stage = Stage("space-time", len(left), 0, 0.0, 0, spent)
        solved = Solved(pose, [stage] if moved.any() else [])
        results = [
            scene._result(
                index,
                frame.given[index],
                frame.original,
                repaired,
                frame.pairs,
                left,
                solved,
                {"solve": spent},
            )
            for index in range(len(scene.bodies))
        ]
        return Repaired(frame.time, results)

    def _fallback(
        self, frame: Frame, pose: FloatArray, left: IntArray
    ) -> tuple[FloatArray, IntArray]:
        """The pose with the fewest pairs: mended from here, or repaired alone."""
        scene = self.scene
        system = system_of(scene, [frame.weld])
        unit = _reduced(system, frame.centred)
        near = mend(
            system.surface, unit, _reduced(system, pose), warm=None, step=MEND_STEP, alone=_alone
        )
        mended = _expanded(system, frame.centred, unit, near)
        found = scene._pairs(mended, frame.weld)
        return (mended, found) if len(found) < len(left) else (pose, left)


def system_of(scene: SceneRepairer, welds: Sequence[IntArray]) -> _System:
    """The solved mesh of poses: seam duplicates of the rest that coincide in all of them are one."""
    from dtrepair.repair.repairer import _centred, _System

    rest_weld = scene._weld(_centred(scene._rest)[0])
    joined = np.ones(len(rest_weld), dtype=bool)
    for weld in welds:
        joined &= weld[rest_weld] == weld
    together = np.where(joined, rest_weld, np.arange(len(rest_weld)))
    key = together.tobytes()
    if key not in scene._systems:
        scene._systems[key] = _System(scene, together)
    return scene._systems[key]


def _reduced(system: _System, points: FloatArray) -> FloatArray:
    """Points (V, 3) as those of the solved mesh, in units of its size."""
    return points[system.kept] / system.surface.size


def _expanded(
    system: _System, centred: FloatArray, before: FloatArray, after: FloatArray
) -> FloatArray:
    """A solved pose as points (V, 3); vertices that stayed where they were keep every bit."""
    stayed = (after == before).all(axis=1)[system.place]
    return np.where(stayed[:, None], centred, (after * system.surface.size)[system.place])


def _alone(surface: Surface, original: FloatArray) -> FloatArray:
    """The single-frame solver, untightened: its result is blended with its neighbours'."""
    return FullMethod(surface, rounds=0)(original).points


def _smoothstep(part: float) -> float:
    return part * part * (3.0 - 2.0 * part)


def _blend(
    original: FloatArray, before: FloatArray, after: FloatArray, weight: float
) -> FloatArray:
    """Cross-fade of two poses; what both leave alone keeps every bit."""
    return original + ((1.0 - weight) * (before - original) + weight * (after - original))
