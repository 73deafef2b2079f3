"""Poses that are solved, opened until their contacts keep the clearance that is asked for.

Last of all, for whatever relaxes would close it again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.temporal import apply_in_time, gaussian_kernel
from dtrepair.repair.full.acceptance import without_still
from dtrepair.repair.full.clearance import ClearanceOptions, open_contacts
from dtrepair.repair.parallel.worker_pool import WorkerPool, with_workers, worthwhile_jobs
from dtrepair.repair.scene.bounds import Judged, badness, strain_of
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh
from dtrepair.repair.surface.rigid_bodies import allowed
from dtrepair.repair.surface.surface import Surface

# A pose this near to its rest, units of the size, is its own rest.
AT_REST = 1e-7


@dataclass(frozen=True, kw_only=True)
class OpeningOptions:
    """How poses are opened.

    Args:
        widths: Each pose is opened for itself, and what opens it smoothed over so many frames, a
            standard deviation; then what is still too close again, smoothed less.
        tries: Of what a pose does not bear half is tried, so many times; then none.
        clearance: How the contacts of a pose are opened.
    """

    widths: tuple[float, ...] = (1.0, 0.5, 0.0)
    tries: int = 3
    clearance: ClearanceOptions = field(default_factory=ClearanceOptions)


def opened_frames(
    scene: Scene,
    mesh: WeldedMesh,
    frames: Sequence[OpenedPose],
    judged: Sequence[Judged],
    times: FloatArray,
    *,
    jobs: int | None = 1,
    options: OpeningOptions = OpeningOptions(),
) -> list[Judged]:
    """Return judged poses of a window with their contacts apart by the clearance of the scene.

    As far as they bear it: none gets more pairs for it, or more strained. times: in frame units
    (T,); jobs: workers; None: one a processor. Raises WorkerLost.
    """
    both = list(zip(frames, judged, strict=True))
    # What is held is one pose, or it would swim; the frames after it move up in time.
    first = np.array([k == 0 or not _same(both[k], both[k - 1]) for k in range(len(both))])
    held = np.cumsum(np.where(first, 0.0, np.diff(times, prepend=times[0])))
    moments = (times - held)[first]

    def opened_by(pool: WorkerPool) -> list[Judged]:
        single = [both[k] for k in np.flatnonzero(first).tolist()]
        state = _Opening(scene, mesh, single, pool, options)
        pool.start(state)
        for width in options.widths:
            moved = np.stack(pool.map("opening", range(len(single))))
            if not moved.any():
                break
            if width > 0.0:
                moved = apply_in_time(gaussian_kernel(moments, width), moved)
            for index, own in enumerate(moved):
                state.move(index, own)
        return state.judged

    jobs = worthwhile_jobs(jobs, len(moments), len(mesh.surface.faces))
    found = with_workers(mesh.surface, jobs, opened_by)
    return [found[index] for index in np.cumsum(first) - 1]


def too_close(mesh: WeldedMesh, points: FloatArray, *, facing: bool = False) -> int:
    """Return how many pairs of a pose (V, 3) are closer than the clearance.

    facing: whether that excuses nothing that is as close at rest, see `own_rest`.
    """
    unit = mesh.reduced(points)
    return len(mesh.surface.contacts.close_pairs(unit, mesh.clearance, facing=facing))


def own_rest(mesh: WeldedMesh, frames: Sequence[OpenedPose]) -> bool:
    """Return whether frames are all their own rest, which would excuse all that is close in it.

    Where others are not, what is close at rest is excused in these, and must be in all.
    """
    rest = mesh.surface.rest
    units = (mesh.reduced(frame.centred) for frame in frames)
    return all(np.allclose(unit, rest, rtol=0.0, atol=AT_REST) for unit in units)


class _Opening:
    """Frames that are opened; a pool calls the method that takes a surface and a frame."""

    def __init__(
        self,
        scene: Scene,
        mesh: WeldedMesh,
        poses: list[tuple[OpenedPose, Judged]],
        pool: WorkerPool,
        options: OpeningOptions,
    ) -> None:
        self.scene, self.mesh, self.surface, self.options = scene, mesh, mesh.surface, options
        self.frames, self.judged = [pose for pose, _ in poses], [own for _, own in poses]
        self.poses = pool.array((len(poses), len(scene.rest), 3))
        self.poses[:] = [own.points for own in self.judged]
        self.facing = own_rest(mesh, self.frames)

    def opening(self, surface: Surface, index: int) -> FloatArray:
        """Return how far (V, 3) the pose of a frame moves that is opened."""
        mesh, points = self.mesh, self.poses[index]
        unit = mesh.reduced(points)
        opened, _ = open_contacts(
            surface,
            unit,
            mesh.clearance,
            limit=partial(self._within_limits, index),
            facing=self.facing,
            options=self.options.clearance,
        )
        return np.asarray(mesh.expanded(points, unit, without_still(unit, opened)) - points)

    def move(self, index: int, moved: FloatArray) -> None:
        """Move the pose of a frame (V, 3) as far as it has no more pairs or strain for it."""
        scene, mesh, frame = self.scene, self.mesh, self.frames[index]
        judged, points = self.judged[index], self.judged[index].points
        if not moved.any():
            return
        left, unit = len(scene.pairs(points, frame.weld)), mesh.reduced(points)
        strain = badness(strain_of(scene, frame.centred, points))
        for attempt in range(self.options.tries):
            trial = mesh.reduced(points + 0.5**attempt * moved)
            # What is smoothed over frames may go where none of them may.
            found = mesh.expanded(points, unit, self._within_limits(index, trial))
            fits = badness(strain_of(scene, frame.centred, found)) <= strain
            if (fits or scene.options.at_any_cost) and len(scene.pairs(found, frame.weld)) <= left:
                self.judged[index], self.poses[index] = judged._replace(points=found), found
                return

    def _within_limits(self, index: int, unit: FloatArray) -> FloatArray:
        """Return a pose of the surface with rigid bodies in shape, and nothing too far off."""
        before = self.mesh.reduced(self.frames[index].centred)
        return allowed(self.surface.rigid, before, unit, self.mesh.farthest)


def _same(first: tuple[OpenedPose, Judged], second: tuple[OpenedPose, Judged]) -> bool:
    """Return whether two frames, and what was found for them, are the same."""
    poses = (first[0].centred, second[0].centred), (first[1].points, second[1].points)
    return all(np.array_equal(*both) for both in poses)
