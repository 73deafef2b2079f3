"""Clips: frames in, verified frames out, whatever their number."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from itertools import islice
from typing import Any

from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.clip.window_method import MakeMethod, WindowMethod, WindowSolver
from dtrepair.repair.clip.window_repairer import Progress, WindowRepairer
from dtrepair.repair.clip.window_stream import Repaired, WindowStream
from dtrepair.repair.full.method import solve_alone
from dtrepair.repair.independent import repair_poses
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.parallel.process_pool import in_batches, map_in_processes
from dtrepair.repair.parallel.worker_pool import available_processors
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh, WeldedMeshes


class ClipRepairer:
    """Repairs the frames of a scene together: clean, close to the input, and steady.

    Displacements are smooth in time by construction within windows of frames; windows overlap and
    are cross-faded; a cut ends a run. Every frame is verified exactly on the float32 coordinates
    of its result. Memory does not grow with the number of frames.

    Args:
        scene: The bodies and options.
        meshes: The welded meshes of the scene.
        options: Sizes of windows, and steps.
        make_method: Makes the solver of windows of a mesh; default: `window_method`.
        poses_at_once: How many frames that are repaired each for itself are solved at once.
    """

    def __init__(
        self,
        scene: Scene,
        meshes: WeldedMeshes,
        *,
        options: ClipOptions = ClipOptions(),
        make_method: MakeMethod | None = None,
        poses_at_once: int = 1,
    ) -> None:
        self.scene, self.meshes, self.options = scene, meshes, options
        self.make_method = make_method or partial(window_method, scene.options, options)
        self.poses_at_once = poses_at_once

    def stream(
        self,
        frames: Iterable[tuple[float, Sequence[Any]]],
        *,
        jobs: int | None = None,
        progress: Progress | None = None,
    ) -> Iterator[Repaired]:
        """Repair (time, poses (V, 3) of each body) in order, with `jobs` workers (None: all).

        At most a window of frames is held. `progress` is called now and then with how many
        frames' worth of the present window is done. ValueError where times do not increase, and
        for poses that cannot be used.
        """
        if self.scene.options.method != "full":
            yield from self._each(frames, jobs)
            return
        repairer = WindowRepairer(
            self.meshes,
            options=self.options,
            make_method=self.make_method,
            jobs=jobs,
            progress=progress,
        )
        yield from WindowStream(repairer).run(frames)

    def _each(
        self, frames: Iterable[tuple[float, Sequence[Any]]], jobs: int | None
    ) -> Iterator[Repaired]:
        """Yield frames, each repaired for itself: in batches on a GPU, else side by side."""
        iterator, size = iter(frames), self.poses_at_once

        def solved(batch: list[tuple[float, Sequence[Any]]]) -> list[Repaired]:
            poses = [poses for _, poses in batch]
            options = self.options.independent
            results = repair_poses(self.scene, self.meshes, poses, options=options)
            return [Repaired(time, found) for (time, _), found in zip(batch, results, strict=True)]

        # What is built for the first frame, all processes inherit.
        for first in islice(iterator, 1 if size == 1 else 0):
            yield from solved([first])
        workers = (jobs or available_processors()) if size == 1 else 1
        for found in map_in_processes(solved, in_batches(iterator, size), jobs=workers):
            yield from found


def window_method(choices: RepairOptions, options: ClipOptions, mesh: WeldedMesh) -> WindowSolver:
    """Return the solver of the windows of a mesh."""
    # Frames with attached parts start from these poses.
    rounds = choices.tighten if mesh.surface.ties is not None else 0
    return WindowMethod(
        mesh.surface,
        partial(solve_alone, rounds=rounds, effort=choices.effort, options=options.alone),
        tighten=min(choices.tighten, options.tighten),
        farthest=mesh.farthest,
        effort=choices.effort,
        options=options.windows,
    )
