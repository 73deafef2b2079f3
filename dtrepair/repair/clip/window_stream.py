"""Frames of a clip on their way through overlapping windows: solved, faded, verified."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import Any, NamedTuple, TypeVar

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.temporal import frame_units
from dtrepair.numerics.threads import one_thread
from dtrepair.repair.clip.borrow_frames import started_again
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.clip.frames import Frame, faded, read_frames, without_holds
from dtrepair.repair.clip.inside_out import inside_out
from dtrepair.repair.clip.steady_frames import agreed
from dtrepair.repair.clip.window_method import MakeMethod
from dtrepair.repair.full.method import solve_alone
from dtrepair.repair.independent import solved_pose
from dtrepair.repair.parallel.worker_pool import (
    WorkerPool,
    available_processors,
    with_workers,
    worthwhile_jobs,
)
from dtrepair.repair.relief.other_ways import on_other_ways, with_turns
from dtrepair.repair.relief.relief import relieved_poses
from dtrepair.repair.result import RepairResult, Solved, Stage
from dtrepair.repair.scene.bounds import Judged, bounded_frames, bounded_pose, strain_of
from dtrepair.repair.scene.mending import mended
from dtrepair.repair.scene.opened_pose import detected
from dtrepair.repair.scene.results import kept, results_of
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh, WeldedMeshes
from dtrepair.repair.separation.starts import Starts

Item = TypeVar("Item")
Answer = TypeVar("Answer")
Progress = Callable[[float], None]


class Repaired(NamedTuple):
    """A frame's time and a result for each body."""

    time: float
    results: list[RepairResult]


class WindowStream:
    """Frames on their way through one stream of windows.

    Args:
        scene: The bodies and options.
        meshes: The welded meshes of the scene.
        options: Numbers of this stage.
        make_method: Makes the solver of windows of a mesh.
        jobs: Workers; None: all processors.
        progress: Called now and then with how many frames' worth of the present window is done.
    """

    def __init__(
        self,
        scene: Scene,
        meshes: WeldedMeshes,
        *,
        options: ClipOptions,
        make_method: MakeMethod,
        jobs: int | None = None,
        progress: Progress | None = None,
    ) -> None:
        self.scene, self.meshes, self.options = scene, meshes, options
        self.make_method, self.jobs, self.progress = make_method, jobs, progress
        # Frames that one of the present window stands for, in the mean.
        self._worth = 1.0

    def run(self, frames: Iterable[tuple[float, Sequence[Any]]]) -> Iterator[Repaired]:
        """Yield results in order; windows end at cuts and overlap elsewhere."""
        waiting: list[Frame] = []
        tail: list[Judged] = []
        overlap = self.options.overlap
        for frame in read_frames(self.scene, frames, cuts=self.options.cuts):
            if frame.starts and waiting:
                yield from self._window(waiting, tail, keep=0)[0]
                waiting, tail = [], []
            waiting.append(frame)
            if len(waiting) == self.options.window:
                done, tail = self._window(waiting, tail, keep=overlap)
                yield from done
                del done  # before the next window needs memory
                waiting = waiting[-overlap:]
        if waiting:
            yield from self._window(waiting, tail, keep=0)[0]

    @one_thread()
    def _window(
        self, frames: list[Frame], tail: list[Judged], *, keep: int
    ) -> tuple[list[Repaired], list[Judged]]:
        """Return the results of all but the last `keep` frames, and the poses found for those.

        tail: poses found for the first frames by the window before.
        """
        start = clock.perf_counter()
        # Those that the window before had are detected already.
        frames[:] = self._side_by_side(partial(detected, self.scene), frames)
        judged, meshes = [Judged(frame.centred) for frame in frames], self.meshes
        if len(tail) == len(frames):
            judged = tail
        elif self.scene.options.clearance > 0.0 or any(frame.wrong for frame in frames):
            # With a clearance a pose without pairs may have to move as well.
            longest = len(frames) if self.scene.options.clearance else self.options.longest_hold
            solved, place = without_holds(frames, longest=longest)
            self._worth = len(frames) / len(solved)
            judged, ways = self._judged(self.meshes, solved), self.options.ways
            judged, meshes = on_other_ways(meshes, solved, judged, self._judged, options=ways)
            judged = with_turns(meshes, solved, judged, self._judged, options=ways)
            judged = [judged[index] for index in place]
        # Clean windows need none.
        mesh = cache(partial(meshes, [frame.sewn for frame in frames]))
        if len(tail) < len(frames):
            judged = faded(frames, tail, judged, meshes.scene.rigid)
        done = len(frames) - keep
        left = self._verified(frames[:done], [found.points for found in judged[:done]])
        seconds = (clock.perf_counter() - start) / len(frames)
        results = [
            self._finish(mesh, frame, found, pairs, seconds)
            for frame, found, pairs in zip(frames[:done], judged[:done], left, strict=True)
        ]
        return results, judged[done:]

    def _judged(self, meshes: WeldedMeshes, frames: list[Frame]) -> list[Judged]:
        """Return the repaired poses of a window within the bounds."""
        scene, numbers = meshes.scene, self.options.independent
        mesh = meshes([frame.sewn for frame in frames])
        ways = self.options.inside_out
        own, opened = inside_out(meshes, frames, self._solve, self._side_by_side, options=ways)
        poses = self._solve(own.scene, own([frame.sewn for frame in frames]), opened)
        solving, rest = self.options.solving, 1.0 - self.options.solving
        self._tell(solving, len(frames))
        poses = relieved_poses(scene, mesh, frames, poses, jobs=self.jobs, options=numbers.relief)
        self._tell(solving + rest / 3, len(frames))
        alone = partial(solved_pose, scene, meshes, options=numbers)
        again = started_again(
            scene,
            mesh,
            frames,
            poses,
            # Frames of attached parts were solved alone already.
            alone=alone if mesh.surface.ties is None else None,
            jobs=self.jobs,
            options=self.options.borrow,
        )
        times = np.array([frame.time for frame in frames])
        self._tell(solving + 2 * rest / 3, len(frames))
        options = self.options.agree
        again = agreed(scene, mesh, frames, poses, again, times, jobs=self.jobs, options=options)
        return bounded_frames(scene, frames, again, times, options=numbers.share)

    def _tell(self, share: float, frames: float) -> None:
        """Tell that this share of the work on so many frames is done."""
        if self.progress is not None:
            self.progress(share * frames * self._worth)

    def _verified(self, frames: list[Frame], poses: list[FloatArray]) -> list[IntArray]:
        """Return the pairs of the poses, exactly, on the float32 coordinates of the results."""

        def pairs(job: tuple[Frame, FloatArray]) -> IntArray:
            frame, pose = job
            moved = (pose != frame.centred).any()
            return self.scene.pairs(pose, frame.weld) if moved else frame.pairs

        return self._side_by_side(pairs, list(zip(frames, poses, strict=True)))

    def _side_by_side(self, function: Callable[[Item], Answer], items: list[Item]) -> list[Answer]:
        """Return the answers in order, on threads: detection releases the interpreter."""
        if (jobs := self.jobs or available_processors()) == 1:
            return [function(item) for item in items]
        with ThreadPoolExecutor(jobs) as pool:
            return list(pool.map(function, items))

    def _solve(self, scene: Scene, mesh: WeldedMesh, frames: list[Frame]) -> list[FloatArray]:
        """Return repaired poses (V, 3) of a window."""
        options = self.options.independent
        times = frame_units(np.array([frame.time for frame in frames]))
        starts = Starts(
            scene,
            mesh,
            frames,
            times,
            release=options.release,
            lift=options.lift,
            sunken=options.sunken,
            separation=options.separation,
        )
        if mesh.surface.ties is not None:
            return self._solve_tied(mesh, starts)
        otherwise: list[FloatArray] = []

        def unless(left: list[IntArray]) -> bool:
            """Return whether sheets, and what pushing left as it was, can be led apart instead."""
            poses = starts.otherwise(left)
            otherwise.extend([] if poses is None else [poses])
            return poses is not None

        found = self._solve_from(
            mesh, starts.led, times, starts.unlifted(starts.led), unless=unless
        )
        if found is None:
            found = self._solve_from(mesh, otherwise[0], times, starts.unlifted(otherwise[0]))
        assert found is not None
        return found

    def _solve_tied(self, mesh: WeldedMesh, starts: Starts) -> list[FloatArray]:
        """Return repaired poses (V, 3) of attached parts, those that stay dirty solved again.

        Each frame is solved for itself, so that the others need not be solved along.
        """
        found = self._solve_from(mesh, starts.led, starts.times, starts.unlifted(starts.led))
        assert found is not None
        left = self._left_of(mesh, found)
        numbers = list(map(len, left))
        dirty = np.array(numbers) > 0
        runs = self.options.ways.again(dirty, numbers, len(mesh.surface.faces))
        otherwise = starts.otherwise(left) if runs else None
        if otherwise is None:
            return found
        unlifted = starts.unlifted(otherwise)
        for run in runs:
            own = starts.times[run], unlifted[run]
            again = self._solve_from(mesh, otherwise[run], *own)
            assert again is not None
            both = zip(again, self._left_of(mesh, again), strict=True)
            for index, (pose, other) in enumerate(both, start=run.start):
                if len(other) < len(left[index]):
                    found[index] = pose
        return found

    def _left_of(self, mesh: WeldedMesh, poses: list[FloatArray]) -> list[IntArray]:
        """Return the pairs that solving left of poses (V, 3)."""
        return self._side_by_side(mesh.surface.contacts.pairs, list(map(mesh.reduced, poses)))

    def _solve_from(
        self,
        mesh: WeldedMesh,
        starts: FloatArray,
        times: FloatArray,
        inputs: FloatArray,
        unless: Callable[[list[IntArray]], bool] | None = None,
    ) -> list[FloatArray] | None:
        """Return repaired poses (V, 3) of starts (T, V, 3); None where `unless` ended it.

        inputs: the starts (T, V, 3) without the lifts of layers.
        """
        led = base = np.stack(list(map(mesh.reduced, starts)))
        if moved := not np.array_equal(starts, inputs):
            base = np.stack(list(map(mesh.reduced, inputs)))
        jobs = worthwhile_jobs(self.jobs, len(starts), len(mesh.surface.faces))

        def solved(pool: WorkerPool) -> FloatArray | None:
            pool.progress = lambda done: self._tell(self.options.solving, done)
            return self.make_method(mesh)(led, times, pool, base if moved else None, unless=unless)

        found = with_workers(mesh.surface, jobs, solved)
        if found is None:
            return None
        return [mesh.expanded(*each) for each in zip(inputs, base, found, strict=True)]

    def _finish(
        self,
        mesh: Callable[[], WeldedMesh],
        frame: Frame,
        judged: Judged,
        left: IntArray,
        seconds: float,
    ) -> Repaired:
        """Return the results of a pose; what is not clean falls back to single-frame solvers."""
        start = clock.perf_counter()
        scene = self.scene
        if judged.turned and self.meshes.turning is not None:
            scene, mesh = self.meshes.turning.scene, partial(self.meshes.turning, [frame.sewn])
        pairs_of, left = partial(scene.pairs, weld=frame.weld), scene.unmodelled(left)
        options, window = self.options, (judged, left)
        if len(left):
            alone = partial(solve_alone, effort=self.scene.options.effort, options=options.alone)
            judged, left = mended(
                scene,
                mesh(),
                frame.centred,
                judged,
                left,
                pairs_of,
                step=options.mend_step,
                farthest=options.mend_share,
                # Frames of attached parts were solved alone already.
                alone=alone if mesh().surface.ties is None else None,
                options=options.mend,
            )
        judged, left = bounded_pose(
            scene, frame, judged, left, pairs_of, options=options.independent.share
        )
        if len(left) > len(window[1]) and not strain_of(scene, frame.centred, window[0].points):
            judged, left = window  # what was mended is strained, and its share leaves more
        if scene is not self.scene:
            left = self.scene.pairs(judged.points, frame.weld)
        found = kept(self.scene, frame, judged.points, left)
        spent = seconds + clock.perf_counter() - start
        moved = bool((found.points != frame.centred).any())
        stages = [Stage("window", len(found.pairs), 0, 0.0, 0, spent)] if moved else []
        close = self._too_close(mesh(), found.points) if self.scene.options.clearance else 0
        solved = Solved(found.points, stages, close)
        times = {"detect": frame.seconds, "solve": spent}
        return Repaired(frame.time, results_of(self.scene, frame, found, solved, times, judged))

    def _too_close(self, mesh: WeldedMesh, pose: FloatArray) -> int:
        """Return how many pairs are closer than the clearance."""
        return len(mesh.surface.contacts.close_pairs(mesh.reduced(pose), mesh.clearance))
