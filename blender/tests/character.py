"""A skinned character, made in code, whose hand goes through its hip."""

from __future__ import annotations

from typing import Any

import bmesh
import bpy
import numpy as np
from mathutils import Matrix

from blender.dtrepair_addon.scene.sampling import points_of

# A clip of the middle, where the hand is in the hip, and what leads there.
FRAMES = 6


def empty_scene() -> None:
    """Start with nothing in the scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)


def character(frames: int = 12, name: str = "Hero") -> Any:
    """A torso and an arm of one mesh on two bones; the hand is in the hip in the middle frames."""
    empty_scene()
    mesh = bpy.data.meshes.new(name)
    build = bmesh.new()
    _capsule(build, (0.0, 0.0, 1.0), (0.3, 0.3, 1.0), 0)
    _capsule(build, (0.75, 0.0, 1.0), (0.1, 0.1, 0.7), 1)
    build.to_mesh(mesh)
    build.free()
    body = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(body)
    rig = _rig(name)
    side = np.array([v.co.x for v in mesh.vertices]) > 0.45
    for bone, own in (("spine", ~side), ("arm", side)):
        body.vertex_groups.new(name=bone).add(np.flatnonzero(own).tolist(), 1.0, "REPLACE")
    body.modifiers.new("Armature", "ARMATURE").object = rig
    body.parent = rig
    _swing(rig, frames)
    return body


def _capsule(build: Any, centre: Any, size: Any, kind: int) -> None:
    place = Matrix.Translation(centre) @ Matrix.Diagonal((*size, 1.0))
    bmesh.ops.create_uvsphere(build, u_segments=16, v_segments=20, radius=1.0, matrix=place)


def _rig(name: str) -> Any:
    data = bpy.data.armatures.new(f"{name} rig")
    rig = bpy.data.objects.new(f"{name} rig", data)
    bpy.context.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    for bone, across, bottom, top in (("spine", 0.0, 0.0, 2.0), ("arm", 0.75, 1.7, 0.3)):
        made = data.edit_bones.new(bone)
        made.head, made.tail = (across, 0.0, bottom), (across, 0.0, top)
    bpy.ops.object.mode_set(mode="OBJECT")
    return rig


def _swing(rig: Any, frames: int) -> None:
    """Swing the hand into the hip and out again."""
    arm = rig.pose.bones["arm"]
    arm.rotation_mode = "XYZ"
    for frame, angle in ((1, 0.0), ((1 + frames) // 2, 0.5), (frames, 0.0)):
        arm.rotation_euler = (0.0, 0.0, angle)
        arm.keyframe_insert("rotation_euler", frame=frame)


def state(body: Any) -> Any:
    """All of a scene that a cancelled job could have changed."""
    scene = bpy.context.scene
    return (
        [(o.name, o.hide_get(), o.hide_render, len(o.modifiers)) for o in scene.objects],
        points_of(body.data).tobytes(),
        body.data.shape_keys,
        [group.name for group in body.vertex_groups],
        [attribute.name for attribute in body.data.attributes],
        scene.frame_current,
        [rig.pose_position for rig in bpy.data.armatures],
        len(bpy.data.meshes),
    )
