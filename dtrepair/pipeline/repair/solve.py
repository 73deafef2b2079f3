"""Frames in, repaired and verified frames out."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from copy import copy
from dataclasses import dataclass, replace
from itertools import chain, islice
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.errors import Cancelled
from dtrepair.pipeline.modelled.parts import ModelledParts
from dtrepair.pipeline.repair.records import FrameRecorder
from dtrepair.pipeline.stages.frames import Frame, count_frame, frame_time, unusable
from dtrepair.pipeline.stages.sources import Source
from dtrepair.report.record import FrameRecord

if TYPE_CHECKING:
    from dtrepair.intersect.scene_counts import SceneCount, SceneCounter
    from dtrepair.repair.repairer import SceneRepairer
    from dtrepair.repair.result import RepairResult
    from dtrepair.repair.scene.bodies import Body
    from dtrepair.repair.solution_cache import Memory

    Solution = list[RepairResult] | Exception
    Pose = tuple[float, Sequence[Any]]

# Rounding to the float32 points of a local space may close the tiny gaps of a result again.
_ROUNDS = 3


@dataclass(frozen=True)
class Repaired:
    """A frame's outcome: local points (V, 3) float32 of each mesh, None where nothing changed.

    spaces: the written points in the space of `Frame.spaces`.
    """

    frame: Frame
    points: tuple[NDArray[np.float32] | None, ...]
    spaces: tuple[NDArray[Any], ...]
    record: FrameRecord
    seconds: dict[str, float]
    error: Exception | None = None


class FrameRepairer:
    """Repairs the frames of one input; built once, one factor however many frames."""

    def __init__(
        self,
        source: Source,
        repairer: SceneRepairer,
        counter: SceneCounter,
        *,
        jobs: int | None = None,
        alone: bool = False,
        memory: Memory | None = None,
    ) -> None:
        """Take the solver of all meshes together, and the counter that verifies its results.

        Frames are solved together, steady in time, by `jobs` workers; `alone`: each for itself.
        memory: where solutions of an earlier run are looked up, and new ones kept.
        """
        from dtrepair.numerics.attachments import telling
        from dtrepair.repair.parallel.worker_pool import available_processors

        self.source = source
        self.repairer = repairer
        self.counter = counter
        self.jobs = jobs
        # Frames worked on side by side; what was started on a GPU cannot be shared by processes.
        self.workers = (jobs or available_processors()) if repairer.device == "cpu" else 1
        self.alone = alone
        self.memory = memory
        scene = repairer.scene
        auto = scene.options.rest_contacts == "auto"
        shown = telling(scene.references, auto=auto, turns=True)
        self.modelled = ModelledParts(source, scene.attachments, shown)
        self.record = FrameRecorder(source, repairer.bodies, self.modelled)
        self.free = [_free(body) for body in repairer.bodies]
        self.warnings: list[str] = []
        self.error: Exception | None = None  # why frames could not be repaired together ...
        self.alone_from: float | None = None  # ... and the first of them
        # Called with how many frames' worth of work is done beyond the frames handed out.
        self.progress: Callable[[float], None] | None = None
        self._again = Lock()

    def by(self, repairer: SceneRepairer) -> FrameRepairer:
        """Return the same with another solver of the same bodies."""
        other = copy(self)
        other.repairer, other.warnings = repairer, []
        return other

    def solve(self, poses: Iterable[Pose]) -> Iterator[Solution]:
        """Solve (time, points of each mesh) in order; an error may take a frame's place."""
        from dtrepair.repair.parallel.process_pool import WorkerLost

        iterator = iter(poses)
        first = list(islice(iterator, 2))
        iterator = chain(first, iterator)
        if not self.alone and len(first) == 2:  # there is no time in a single frame
            fed: deque[Pose] = deque()

            def feed() -> Iterator[Pose]:
                for pose in iterator:
                    fed.append(pose)
                    yield pose

            animator = self.repairer.make_animator(self.memory)
            try:
                for repaired in animator.stream(feed(), jobs=self.jobs, progress=self.progress):
                    fed.popleft()
                    yield repaired.results
                return
            except (Cancelled, WorkerLost):
                raise
            except Exception as error:
                # One window that cannot be solved together must not lose a long run.
                self.alone_from = (fed or first)[0][0]
                reason = f"{type(error).__name__}: {error}"
                frames = f"frames from {fed[0][0]:g}" if fed else "the frames"
                self.warnings.append(f"{frames} are repaired alone: {reason}")
                self.error = error
            iterator = chain(list(fed), iterator)
        from dtrepair.repair.solution_cache import repair_each

        self.alone = True
        points = (points for _, points in iterator)
        jobs = self.workers if len(first) == 2 else 1
        solve, at_once = self.repairer.batch, self.repairer.poses_at_once
        yield from repair_each(solve, points, self.memory, jobs=jobs, at_once=at_once)

    def finish(
        self, frame: Frame, solution: Solution | None, before: SceneCount | None = None
    ) -> Repaired:
        """Verify a solution on the points that would be written; unchanged where there is none.

        before: the count of the frame as it came, if that is known.
        """
        unchanged: tuple[None, ...] = (None,) * len(self.source.meshes)
        if solution is None:
            return Repaired(frame, unchanged, frame.spaces, unusable(frame), {})
        try:
            if isinstance(solution, Exception):
                raise solution
            before = before or self.counter(frame.spaces, hidden=frame.hidden)
            return self._verified(frame, solution, before)
        except Exception as error:
            # What usd_io says is meant for users; the rest is told with its kind.
            told = hasattr(error, "exit_code")
            message = str(error) if told else f"{type(error).__name__}: {error}"
            record = FrameRecord(time=frame_time(frame), status="failed", message=message)
            return Repaired(frame, unchanged, frame.spaces, record, {}, error)

    def _verified(self, frame: Frame, results: list[RepairResult], before: SceneCount) -> Repaired:
        after = before
        points: tuple[NDArray[np.float32] | None, ...] = (None,) * len(frame.points)
        spaces, iterations = frame.spaces, 0
        seconds = {"detect": 0.0, "solve": 0.0}
        strained: list[RepairResult] = []
        for repetition in range(_ROUNDS):
            if repetition:
                # What is only rounded again is judged by what it was: strained at any cost.
                strained += [result for result in results if result.diagnosis.strains]
                with self._again:
                    results = self.repairer(replace(frame, spaces=spaces).poses)
            iterations += results[0].iterations
            for name in seconds:
                seconds[name] += results[0].seconds.get(name, 0.0)
            written = self.written(frame, [result.points for result in results])
            placed = self._placed(frame, written)
            count = self.counter(placed, hidden=frame.hidden)
            # A clean frame may be moved, to go along with its neighbours, if it stays clean.
            if count.total.pairs >= max(after.total.pairs, 1):
                break
            points, spaces, after = written, placed, count
            if after.total.pairs == 0 or any(result.after.pairs for result in results):
                break
        record = self.record(frame, spaces, before, after, [*results, *strained], seconds)
        record = replace(record, iterations=iterations)
        return Repaired(frame, points, spaces, record, seconds)

    def written(
        self, frame: Frame, results: Sequence[Any]
    ) -> tuple[NDArray[np.float32] | None, ...]:
        """Local float32 points of the meshes that changed; unmoved vertices keep every bit."""
        written: list[NDArray[np.float32] | None] = []
        for index, mesh in enumerate(self.source.meshes):
            # A fixed vertex keeps its place whatever the solver says; the count tells the rest.
            moved = (np.asarray(results[index]) != frame.spaces[index]).any(axis=1)
            moved &= self.free[index]
            if not moved.any():
                written.append(None)
                continue
            local = results[index]
            if len(self.source.meshes) > 1:
                local = self.source.to_local(mesh, frame.time, local)
            rounded = np.where(moved[:, None], local.astype(np.float32), frame.points[index])
            written.append(rounded)
        return tuple(written)

    def _placed(
        self, frame: Frame, written: Sequence[NDArray[np.float32] | None]
    ) -> tuple[NDArray[Any], ...]:
        """The written points in the space of counting."""
        placed: list[NDArray[Any]] = []
        for index, (mesh, points) in enumerate(zip(self.source.meshes, written, strict=True)):
            if points is None:
                placed.append(frame.spaces[index])
            elif len(self.source.meshes) > 1:
                placed.append(self.source.to_world(mesh, frame.time, points))
            else:
                placed.append(points)
        return tuple(placed)


def repair_frames(
    frames: Iterable[Frame],
    repairer: FrameRepairer,
    *,
    see: Callable[[float, SceneCount | None], None] = lambda time, before: None,
) -> Generator[Repaired]:
    """Repair an iterator of frames, in order; the solver sees one iterator of usable poses.

    The solver may look ahead as far as it likes: frames wait here until their solution comes.
    see: called with the time of each frame and its count as it came, None of an unusable one.
    """
    waiting: deque[tuple[Frame, SceneCount | None]] = deque()
    finishing: deque[Future[Repaired]] = deque()

    def poses() -> Iterator[Pose]:
        for frame in frames:
            wait(finishing)  # the solver goes on, and may fork: no thread must be at work then
            frame, before = count_frame(repairer.counter, frame)
            see(frame.time, before)
            waiting.append((frame, before))
            if frame.usable:
                yield frame.time, frame.poses
        wait(finishing)

    ahead = 2 * repairer.workers
    with ThreadPoolExecutor(repairer.workers) as pool:
        for solution in repairer.solve(poses()):
            while not waiting[0][0].usable:
                finishing.append(pool.submit(repairer.finish, waiting.popleft()[0], None))
            frame, before = waiting.popleft()
            finishing.append(pool.submit(repairer.finish, frame, solution, before))
            if repairer.alone:
                wait(finishing)
            while finishing and (finishing[0].done() or len(finishing) > ahead):
                yield finishing.popleft().result()
        while finishing:
            yield finishing.popleft().result()
        while waiting:
            yield repairer.finish(waiting.popleft()[0], None)


def _free(body: Body) -> NDArray[np.bool_]:
    """Which vertices (V,) of a body may move at all."""
    free = np.full(len(np.asarray(body.rest)), body.mobility > 0.0)
    return free if body.pin is None else free & (np.asarray(body.pin) < 1.0)
