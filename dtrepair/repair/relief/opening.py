"""Where a clearance strains what comes clean without one: solved so, and opened afterwards."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.temporal import apply_in_time, gaussian_kernel
from dtrepair.repair.full.acceptance import without_still
from dtrepair.repair.full.clearance import ClearanceOptions, open_contacts
from dtrepair.repair.relief.other_ways import frames_off
from dtrepair.repair.scene.bounds import Judged, strain_of, wrong_in
from dtrepair.repair.scene.opened_pose import Pose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh, WeldedMeshes
from dtrepair.repair.surface.rigid_bodies import allowed

# Solves some frames by other meshes.
Solve = Callable[[WeldedMeshes], list[Judged]]


@dataclass(frozen=True, kw_only=True)
class OpeningOptions:
    """How poses that were solved without a clearance are opened.

    Args:
        width: What opens them is smoothed over so many frames, a standard deviation: each pose is
            opened for itself.
        tries: Of what a pose does not bear half is tried, so many times; then none.
        clearance: How the contacts of a pose are opened.
    """

    width: float = 1.0
    tries: int = 3
    clearance: ClearanceOptions = field(default_factory=ClearanceOptions)


def opened_later(
    meshes: WeldedMeshes,
    frames: Sequence[Pose],
    judged: list[Judged],
    times: FloatArray,
    solve: Solve,
    *,
    options: OpeningOptions = OpeningOptions(),
) -> list[Judged]:
    """Return poses of a window, solved without the clearance where that leaves less, and opened.

    Those that are judged, the same list, where nothing is wrong with them or no clearance is asked
    for. times: in frame units (T,).
    """
    closely, scene = meshes.without_clearance, meshes.scene
    if closely is None or not (left := _wanting(scene, frames, judged))[0]:
        return judged
    others = solve(closely)
    if _wanting(scene, frames, others) >= left:
        return judged
    of_frame = [meshes([frame.sewn]) for frame in frames]
    each = zip(of_frame, frames, others, strict=True)
    moved = np.stack([_opening(*own, options.clearance) for own in each])
    moved = apply_in_time(gaussian_kernel(times, options.width), moved)
    opened = zip(of_frame, frames, others, moved, strict=True)
    return [_with_share(scene, *own, tries=options.tries) for own in opened]


def too_close(mesh: WeldedMesh, pose: FloatArray) -> int:
    """Return how many pairs of a pose (V, 3) of the scene are closer than the clearance."""
    return len(mesh.surface.contacts.close_pairs(mesh.reduced(pose), mesh.clearance))


def _wanting(
    scene: Scene, frames: Sequence[Pose], judged: Sequence[Judged]
) -> tuple[int, int, int]:
    """Return how many poses are not clean or strained, what is left, and how many came off."""
    poses = [own.points for own in judged]
    wrong = wrong_in(scene, frames, poses)
    wanting = sum(left > 0 or bool(own.excess) for left, own in zip(wrong, judged, strict=True))
    return wanting, sum(wrong), frames_off(scene, frames, poses)


def _opening(mesh: WeldedMesh, frame: Pose, own: Judged, options: ClearanceOptions) -> FloatArray:
    """Return how far (V, 3) a pose moves that is opened."""
    unit = mesh.reduced(own.points)
    limit = partial(_within_limits, mesh, frame)
    opened, _ = open_contacts(mesh.surface, unit, mesh.clearance, limit=limit, options=options)
    return np.asarray(mesh.expanded(own.points, unit, without_still(unit, opened)) - own.points)


def _within_limits(mesh: WeldedMesh, frame: Pose, unit: FloatArray) -> FloatArray:
    """Return a pose of the surface with rigid bodies in shape, and nothing too far off."""
    before = mesh.reduced(frame.centred)
    return allowed(mesh.surface.rigid, before, unit, mesh.farthest)


def _with_share(
    scene: Scene, mesh: WeldedMesh, frame: Pose, own: Judged, moved: FloatArray, *, tries: int
) -> Judged:
    """Return a pose moved (V, 3) as far as it has no more pairs for it, and no strain."""
    left, unit = len(scene.pairs(own.points, frame.weld)), mesh.reduced(own.points)
    for attempt in range(tries if moved.any() else 0):
        trial = mesh.reduced(own.points + 0.5**attempt * moved)
        # What is smoothed over frames may go where none of them may.
        points = mesh.expanded(own.points, unit, _within_limits(mesh, frame, trial))
        strained = strain_of(scene, frame.centred, points)
        if len(scene.pairs(points, frame.weld)) <= left and (own.excess or not strained):
            return own._replace(points=points)
    return own
