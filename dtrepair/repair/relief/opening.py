"""Where a clearance strains what comes clean without one: solved so, and opened afterwards."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

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

    As they are without a clearance, and where nothing is wrong. times: in frame units (T,).
    """
    closely, scene = meshes.without_clearance, meshes.scene
    if closely is None or not (left := _wanting(scene, frames, judged))[0]:
        return judged
    others = solve(closely)
    if _wanting(scene, frames, others) >= left:
        return judged
    moved = np.stack(
        [
            _opening(meshes([frame.sewn]), frame, own, options)
            for frame, own in zip(frames, others, strict=True)
        ]
    )
    moved = apply_in_time(gaussian_kernel(times, options.width), moved)
    each = zip(frames, others, moved, strict=True)
    return [_with_share(scene, *own, tries=options.tries) for own in each]


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


def _opening(mesh: WeldedMesh, frame: Pose, own: Judged, options: OpeningOptions) -> FloatArray:
    """Return how far (V, 3) a pose moves that is opened."""
    surface, unit, before = mesh.surface, mesh.reduced(own.points), mesh.reduced(frame.centred)
    opened, _ = open_contacts(
        surface,
        unit,
        mesh.clearance,
        limit=lambda pose: allowed(surface.rigid, before, pose, mesh.farthest),
        options=options.clearance,
    )
    return np.asarray(mesh.expanded(own.points, unit, without_still(unit, opened)) - own.points)


def _with_share(scene: Scene, frame: Pose, own: Judged, moved: FloatArray, *, tries: int) -> Judged:
    """Return a pose moved (V, 3) as far as it has no more pairs for it, and no strain."""
    left = len(scene.pairs(own.points, frame.weld))
    for attempt in range(tries if moved.any() else 0):
        points = own.points + 0.5**attempt * moved
        strained = strain_of(scene, frame.centred, points)
        if len(scene.pairs(points, frame.weld)) <= left and (own.excess or not strained):
            return own._replace(points=points)
    return own
