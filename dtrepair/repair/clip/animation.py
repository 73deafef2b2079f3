"""Animations: overlapping windows of frames in, verified frames out, whatever their number."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.temporal import frame_units
from dtrepair.repair.clip.frames import (
    Frame,
    cross_fade,
    expanded,
    read_frames,
    reduced,
    system_of,
)
from dtrepair.repair.clip.window_method import ShotMethod
from dtrepair.repair.full.mend import mend
from dtrepair.repair.full.method import FullMethod
from dtrepair.repair.independent import in_batches
from dtrepair.repair.options import RepairResult, Solved, Stage
from dtrepair.repair.parallel.process_pool import forked_map
from dtrepair.repair.parallel.worker_pool import available_processors, make_crew, worthwhile_jobs
from dtrepair.repair.separation.release import caught_parts, released_frames
from dtrepair.repair.separation.separation import parted_frames
from dtrepair.repair.separation.untangling import contact_counts, hooked_contacts
from dtrepair.repair.surface.rigid_bodies import allowed
from dtrepair.repair.surface.surface import Surface

if TYPE_CHECKING:
    from dtrepair.repair.repairer import SceneRepairer
    from dtrepair.repair.scene.welded_mesh import System

Item = TypeVar("Item")
Answer = TypeVar("Answer")

# Frames that are solved together, and how many of them two windows have in common.
WINDOW, OVERLAP = 60, 12
# Cycles of tightening, if the options do not ask for fewer.
TIGHTEN = 3
# A frame whose correction misses only by rounding is mended with this step (units of the size).
MEND_STEP = 0.002


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

    def __init__(
        self, scene: SceneRepairer, *, window: int = WINDOW, overlap: int = OVERLAP
    ) -> None:
        """Use the detector, systems and options of `scene`; ValueError for a bad window."""
        if not 0 < 2 * overlap <= window:
            raise ValueError(f"window should be at least 2 x {overlap} frames, got {window}")
        self.scene = scene
        self.window, self.overlap = window, overlap
        # Called now and then with how many frames' worth of the present window is done.
        self.progress: Callable[[float], None] | None = None
        self._methods: dict[int, ShotMethod] = {}

    def stream(
        self,
        frames: Iterable[tuple[float, Sequence[Any]]],
        *,
        jobs: int | None = None,
    ) -> Iterator[Repaired]:
        """Repair (time, poses (V, 3) of each body) in order, with `jobs` workers (None: all).

        At most `window` frames are held. ValueError where times do not increase, and for poses
        that cannot be used.
        """
        if self.scene.options.method != "full":
            yield from self._each(frames, jobs)
            return
        yield from _Stream(self, jobs).run(frames)

    def _each(
        self, frames: Iterable[tuple[float, Sequence[Any]]], jobs: int | None
    ) -> Iterator[Repaired]:
        """Frames each for itself: batches of them on a GPU, else side by side."""
        scene, iterator = self.scene, iter(frames)
        size = scene.poses_at_once
        # What is built for the first frame, all processes inherit.
        for time, poses in islice(iterator, 1 if size == 1 else 0):
            yield Repaired(time, scene(poses))

        def solved(batch: list[tuple[float, Sequence[Any]]]) -> list[Repaired]:
            results = scene.batch([poses for _, poses in batch])
            return [Repaired(time, found) for (time, _), found in zip(batch, results, strict=True)]

        workers = (jobs or available_processors()) if size == 1 else 1
        for found in forked_map(solved, in_batches(iterator, size), jobs=workers):
            yield from found

    def method(self, system: System) -> ShotMethod:
        """The shot method of a system, made once."""
        options, size = self.scene.options, system.surface.size
        if id(system) not in self._methods:
            limit = options.maximum_displacement
            self._methods[id(system)] = ShotMethod(
                system.surface,
                _alone,
                tighten=min(options.tighten, TIGHTEN),
                farthest=None if limit is None else limit / size,
                clearance=options.clearance / size,
            )
        return self._methods[id(system)]


def animate(
    scene: SceneRepairer, points: Any, times: ArrayLike | None, jobs: int | None
) -> list[RepairResult]:
    """Results of the frames (T, V, 3) of a scene of one body."""
    count = len(points)
    stamps = np.arange(count) if times is None else np.asarray(times, dtype=np.float64)
    if stamps.shape != (count,):
        raise ValueError(
            f"times should hold one time for each of {count} frames, got {stamps.shape}"
        )
    frames = ((float(stamp), [points[index]]) for index, stamp in enumerate(stamps))
    return [frame.results[0] for frame in scene.animator.stream(frames, jobs=jobs)]


class _Stream:
    """Frames on their way through one stream of windows."""

    def __init__(self, animator: AnimationRepairer, jobs: int | None) -> None:
        self.animator, self.scene, self.jobs = animator, animator.scene, jobs

    def run(self, frames: Iterable[tuple[float, Sequence[Any]]]) -> Iterator[Repaired]:
        """Results in order; windows end at cuts and overlap elsewhere."""
        waiting: list[Frame] = []
        tail: list[FloatArray] = []
        overlap = self.animator.overlap
        for frame in read_frames(self.scene, frames):
            if frame.starts and waiting:
                yield from self._window(waiting, tail, keep=0)[0]
                waiting, tail = [], []
            waiting.append(frame)
            if len(waiting) == self.animator.window:
                done, tail = self._window(waiting, tail, keep=overlap)
                yield from done
                del done  # before the next window needs memory
                waiting = waiting[-overlap:]
        if waiting:
            yield from self._window(waiting, tail, keep=0)[0]

    def _window(
        self, frames: list[Frame], tail: list[FloatArray], *, keep: int
    ) -> tuple[list[Repaired], list[FloatArray]]:
        """Results of all but the last `keep` frames, and the poses found for those.

        tail: poses found for the first frames by the window before.
        """
        start = clock.perf_counter()
        frames[:] = self._detected(frames)
        poses = [frame.centred for frame in frames]
        if len(tail) == len(frames):
            poses = tail
        elif self.scene.options.clearance > 0.0 or any(
            len(frame.pairs) + len(frame.caught) for frame in frames
        ):
            system = system_of(self.scene, [frame.weld for frame in frames])
            poses = self._solve(system, frames)
        if len(tail) < len(frames):
            cross_fade(frames, tail, poses, self.scene.rigid)
        kept = len(frames) - keep
        left = self._verified(frames[:kept], poses[:kept])
        seconds = (clock.perf_counter() - start) / len(frames)
        done = [
            self._finish(frame, pose, pairs, frames, seconds)
            for frame, pose, pairs in zip(frames[:kept], poses[:kept], left, strict=True)
        ]
        return done, poses[kept:]

    def _detected(self, frames: list[Frame]) -> list[Frame]:
        """The frames with their pairs; those that the window before had have them already."""

        def detected(frame: Frame) -> Frame:
            if frame.detected:
                return frame
            start = clock.perf_counter()
            pairs = self.scene._pairs(frame.centred, frame.weld)
            caught = caught_parts(self.scene, frame.centred, pairs)
            seconds = clock.perf_counter() - start
            return frame._replace(detected=True, pairs=pairs, caught=caught, seconds=seconds)

        return self._side_by_side(detected, frames)

    def _verified(self, frames: list[Frame], poses: list[FloatArray]) -> list[IntArray]:
        """Pairs of the poses, exactly, on the float32 coordinates that are handed back."""

        def pairs(job: tuple[Frame, FloatArray]) -> IntArray:
            frame, pose = job
            moved = (pose != frame.centred).any()
            return self.scene._pairs(pose, frame.weld) if moved else frame.pairs

        return self._side_by_side(pairs, list(zip(frames, poses, strict=True)))

    def _side_by_side(self, function: Callable[[Item], Answer], items: list[Item]) -> list[Answer]:
        """Answers in order, on threads: detection releases the interpreter."""
        if (jobs := self.jobs or available_processors()) == 1:
            return [function(item) for item in items]
        with ThreadPoolExecutor(jobs) as pool:
            return list(pool.map(function, items))

    def _solve(self, system: System, frames: list[Frame]) -> list[FloatArray]:
        """Poses (V, 3) of a window by the space-time scheme."""
        times = frame_units(np.array([frame.time for frame in frames]))
        starts = [frame.centred for frame in frames]
        if any(len(frame.caught) for frame in frames):
            caught = [frame.caught for frame in frames]
            starts = list(released_frames(self.scene, np.stack(starts), caught, times))
        pairs = [frame.pairs for frame in frames]
        part = partial(parted_frames, self.scene, system, np.stack(starts), pairs, times)
        led, otherwise = part(), []

        def unless(left: list[IntArray]) -> bool:
            """Whether sheets, and what pushing left as it was, can be led apart instead."""
            met = [contact_counts(self.scene._body_of, found) for found in pairs]
            still = [contact_counts(system.surface.body_of, found) for found in left]
            hooked = hooked_contacts(met, still)
            otherwise.append(part(sheets=range(len(self.scene.bodies)), hooked=hooked))
            return not np.array_equal(otherwise[0], led)

        found = self._shot(system, led, times, unless=unless)
        if found is None:
            found = self._shot(system, otherwise[0], times)
        assert found is not None
        return found

    def _shot(
        self,
        system: System,
        starts: FloatArray,
        times: FloatArray,
        unless: Callable[[list[IntArray]], bool] | None = None,
    ) -> list[FloatArray] | None:
        """Repaired poses (V, 3) of starts (T, V, 3); None where `unless` ended it."""
        unit = np.stack([reduced(system, start) for start in starts])
        jobs = worthwhile_jobs(self.jobs, len(starts), len(system.surface.faces))
        with make_crew(system.surface, jobs) as crew:
            crew.progress = self.animator.progress
            found = self.animator.method(system)(unit, times, crew, unless=unless)
        if found is None:
            return None
        return [
            expanded(system, start, before, after)
            for start, before, after in zip(starts, unit, found, strict=True)
        ]

    def _finish(
        self, frame: Frame, pose: FloatArray, left: IntArray, window: list[Frame], seconds: float
    ) -> Repaired:
        """The results of a pose; what is not clean falls back to single-frame solvers."""
        scene, start = self.scene, clock.perf_counter()
        if len(left):
            pose, left = self._fallback(frame, pose, left, window)
        caught = caught_parts(scene, pose, left) if len(frame.caught) else frame.caught
        if 0 < len(left) + len(caught) >= len(frame.pairs) + len(frame.caught):
            pose, left, caught = frame.centred, frame.pairs, frame.caught
        moved = (pose != frame.centred).any(axis=1)
        rounded = pose.astype(np.float32) + frame.centre
        repaired = np.where(moved[:, None], rounded, frame.original)
        spent = seconds + clock.perf_counter() - start
        stage = Stage("space-time", len(left), 0, 0.0, 0, spent)
        close = self._too_close(frame, pose, window)
        solved = Solved(pose, [stage] if moved.any() else [], close)
        results = [
            scene._result(
                index,
                frame.given[index],
                frame.original,
                repaired,
                frame.pairs,
                left,
                solved,
                {"detect": frame.seconds, "solve": spent},
                caught,
            )
            for index in range(len(scene.bodies))
        ]
        return Repaired(frame.time, results)

    def _too_close(self, frame: Frame, pose: FloatArray, window: list[Frame]) -> int:
        """How many pairs are closer than the clearance."""
        clearance = self.scene.options.clearance
        if clearance == 0.0:
            return 0
        system = system_of(self.scene, [other.weld for other in window])
        unit = reduced(system, pose)
        return len(system.surface.close_pairs(unit, clearance / system.surface.size))

    def _fallback(
        self, frame: Frame, pose: FloatArray, left: IntArray, window: list[Frame]
    ) -> tuple[FloatArray, IntArray]:
        """The pose with the fewest pairs: mended from here, or repaired alone."""
        scene = self.scene
        system = system_of(scene, [other.weld for other in window])
        unit = reduced(system, frame.centred)
        near = mend(system.surface, unit, [reduced(system, pose)], step=MEND_STEP, alone=_alone)
        near = allowed(system.surface.rigid, unit, near, self.animator.method(system).farthest)
        mended = expanded(system, frame.centred, unit, near)
        found = scene._pairs(mended, frame.weld)
        return (mended, found) if len(found) < len(left) else (pose, left)


def _alone(surface: Surface, original: FloatArray) -> FloatArray:
    """The single-frame solver, untightened: its result is blended with its neighbours'."""
    return FullMethod(surface, rounds=0)(original).points
