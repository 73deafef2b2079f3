"""Frames of a clip on their way through overlapping windows: solved, faded, verified."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache, partial
from typing import Any, NamedTuple

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.threads import one_thread
from dtrepair.repair.clip.frames import Frame, faded, read_frames
from dtrepair.repair.clip.window_repairer import WindowRepairer
from dtrepair.repair.full.method import solve_alone
from dtrepair.repair.parallel.worker_pool import side_by_side
from dtrepair.repair.relief.opening import too_close
from dtrepair.repair.result import RepairResult, Solved, Stage
from dtrepair.repair.scene.bounds import Judged, bounded_pose, strain_of
from dtrepair.repair.scene.mending import mended
from dtrepair.repair.scene.opened_pose import detected
from dtrepair.repair.scene.results import kept, results_of
from dtrepair.repair.scene.welded_mesh import WeldedMesh


class Repaired(NamedTuple):
    """A frame's time and a result for each body."""

    time: float
    results: list[RepairResult]


class WindowStream:
    """Frames on their way through one stream of windows.

    Args:
        repairer: Repairs each window; its meshes, options and workers are those of the stream.
    """

    def __init__(self, repairer: WindowRepairer) -> None:
        self.repairer, self.meshes, self.scene = repairer, repairer.meshes, repairer.meshes.scene
        self.options, self.jobs = repairer.options, repairer.jobs

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
        frames[:] = side_by_side(partial(detected, self.scene), frames, jobs=self.jobs)
        judged, meshes = tail, self.meshes
        if len(tail) < len(frames):
            judged, meshes = self.repairer(frames)
            judged = faded(frames, tail, judged, meshes.scene.rigid)
        # Clean windows need none.
        mesh = cache(partial(meshes, [frame.sewn for frame in frames]))
        done = len(frames) - keep
        left = self._verified(frames[:done], [found.points for found in judged[:done]])
        seconds = (clock.perf_counter() - start) / len(frames)
        results = [
            self._finish(mesh, frame, found, pairs, seconds)
            for frame, found, pairs in zip(frames[:done], judged[:done], left, strict=True)
        ]
        return results, judged[done:]

    def _verified(self, frames: list[Frame], poses: list[FloatArray]) -> list[IntArray]:
        """Return the pairs of the poses, exactly, on the float32 coordinates of the results."""

        def pairs(job: tuple[Frame, FloatArray]) -> IntArray:
            frame, pose = job
            moved = (pose != frame.centred).any()
            return self.scene.pairs(pose, frame.weld) if moved else frame.pairs

        return side_by_side(pairs, list(zip(frames, poses, strict=True)), jobs=self.jobs)

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
        known = strain_of(scene, frame.centred, window[0].points, loosely=True)
        if len(left) > len(window[1]) and not known:
            judged, left = window  # what was mended is strained, and its share leaves more
        if scene is not self.scene:
            left = self.scene.pairs(judged.points, frame.weld)
        found = kept(self.scene, frame, judged.points, left)
        spent = seconds + clock.perf_counter() - start
        moved = bool((found.points != frame.centred).any())
        stages = [Stage("window", len(found.pairs), 0, 0.0, 0, spent)] if moved else []
        close = too_close(mesh(), found.points) if self.scene.options.clearance else 0
        solved = Solved(found.points, stages, close)
        times = {"detect": frame.seconds, "solve": spent}
        return Repaired(frame.time, results_of(self.scene, frame, found, solved, times, judged))
