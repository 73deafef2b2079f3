"""Single poses of clothed bodies: the body by itself, with room for its clothes, which go along.

Pushed together, an arm in its sleeve may leave the chest in its shirt by the far side, as layers
get in each other's way; by itself it leaves by the short one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.frame.lending import LendingOptions, solved_from
from dtrepair.repair.full.steering import Steering
from dtrepair.repair.relief.opening import OpeningOptions, opened_frames
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.sub_scene import room_over
from dtrepair.repair.scene.welded_mesh import WeldedMeshes

# Returns the repaired pose (V, 3) of a pose of a scene.
Solve = Callable[[WeldedMeshes, OpenedPose], FloatArray]


@dataclass(frozen=True, kw_only=True)
class BodiesFirstOptions:
    """How bodies are repaired before what they wear.

    Args:
        room: How the body makes room for what it wears.
        lending: What cleans and relaxes the whole from where the body has led it.
    """

    room: OpeningOptions = field(default_factory=OpeningOptions)
    lending: LendingOptions = field(default_factory=LendingOptions)


def with_bodies_first(
    meshes: WeldedMeshes,
    pose: OpenedPose,
    solve: Solve,
    *,
    options: BodiesFirstOptions = BodiesFirstOptions(),
) -> FloatArray | None:
    """Return a pose (V, 3) to which garments came along with what they lie over.

    None where nothing is worn, or something of it is held, or what it lies over has no contacts of
    its own or keeps some.
    """
    scene = meshes.scene
    if (scene.mobility[scene.garments.vertices] < 1.0).any():
        return None
    inner, dressed = meshes.inner, meshes.dressed
    if inner is None or dressed is None or (room := room_over(inner.parts)) is None:
        return None
    roomy = inner.meshes.with_options(f"room {room}", clearance=room)
    opened = inner.parts.opened(pose)
    if not opened.wrong:
        return None
    solved = Judged(solve(inner.meshes, opened))
    (found,) = opened_frames(
        roomy.scene, roomy([opened.sewn]), [opened], [solved], np.zeros(1), options=options.room
    )
    if len(inner.parts.scene.pairs(found.points, opened.weld)):
        return None
    moved = inner.parts.placed(pose.centred, found.points) - pose.centred
    start = pose.centred + _carried_along(scene, moved)
    mesh = dressed([pose.sewn])
    before = mesh.reduced(pose.centred)
    led, _ = solved_from(
        mesh.surface,
        before,
        mesh.reduced(start),
        scale=1.0,
        alone=None,
        steering=Steering(mesh.surface),
        effort=scene.options.effort,
        options=options.lending,
    )
    return mesh.expanded(pose.centred, before, led)


def _carried_along(scene: Scene, moved: FloatArray) -> FloatArray:
    """Return displacements (V, 3) in which garments take theirs from what they lie over."""
    ties, covering, result = scene.garments, scene.covering, moved.copy()
    corners = scene.enclosures.faces[ties.triangles]
    for _ in range(0 if covering is None else int(covering.depth.max())):
        result[ties.vertices] = np.einsum("nk,nkj->nj", ties.weights, result[corners])
    return result[scene.rest_weld]
