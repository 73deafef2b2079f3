"""Evaluated meshes of objects, frame by frame; the scene is left as it was."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..host.exchange import SampledMesh

# Modifiers that only refine the surface: the cage below them is what is looked at.
REFINING = ("SUBSURF", "MULTIRES")
# What results are called; they are no part of a rest pose.
PREFIX = "dtrepair"


class SceneError(Exception):
    """The scene cannot be used; the message names the object and the cure."""


@contextmanager
def kept_frame(scene: Any) -> Iterator[None]:
    """Go back to the current frame at the end."""
    frame, rest = scene.frame_current, scene.frame_subframe
    try:
        yield
    finally:
        scene.frame_set(frame, subframe=rest)


def cage_only(objects: Sequence[Any]) -> AbstractContextManager[None]:
    """Hide refining modifiers while the meshes are read."""
    shown = [m for o in objects for m in o.modifiers if m.type in REFINING and m.show_viewport]
    return _changed([(modifier, "show_viewport", False) for modifier in shown])


def rest_position(objects: Sequence[Any]) -> AbstractContextManager[None]:
    """Put the armatures of objects into their rest position, and leave earlier repairs out."""
    rigs = {rig.data for each in objects if (rig := each.find_armature()) is not None}
    own = [m for o in objects for m in o.modifiers if m.name.startswith(PREFIX)]
    shapes = [data for o in objects if (data := o.data.shape_keys) is not None]
    keys = [key for data in shapes for key in data.key_blocks if key.name.startswith(PREFIX)]
    return _changed(
        [
            *((data, "pose_position", "REST") for data in rigs),
            *((modifier, "show_viewport", False) for modifier in own),
            *((key, "mute", True) for key in keys),
        ]
    )


@contextmanager
def _changed(values: Sequence[tuple[Any, str, Any]]) -> Iterator[None]:
    """Set (owner, name, value), and put back what was there."""
    before = [getattr(owner, name) for owner, name, _ in values]
    try:
        for owner, name, value in values:
            setattr(owner, name, value)
        bpy.context.view_layer.update()
        yield
    finally:
        for (owner, name, _), value in zip(values, before, strict=True):
            setattr(owner, name, value)
        bpy.context.view_layer.update()


def points_of(mesh: Any) -> NDArray[np.float32]:
    """Return the points (V, 3) of a mesh, bit for bit."""
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3)


def evaluated(target: Any) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return local points (V, 3) and the matrix to world (4, 4) of an object as it is now."""
    shown = target.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return points_of(shown.data), np.array(shown.matrix_world, dtype=np.float64)


def sample(objects: Sequence[Any], frames: Sequence[int]) -> list[SampledMesh]:
    """Return the evaluated meshes of objects at frames.

    The rest pose is that with armatures in rest position, else, for what no armature moves, the
    mesh before its modifiers.

    Raises:
        SceneError: an object has no polygons, or not the same vertices in all frames.
    """
    scene = bpy.context.scene
    with cage_only(objects), kept_frame(scene):
        with rest_position(objects):
            rests = [_rest(each) for each in objects]
        poses: list[list[Any]] = [[] for _ in objects]
        for frame in frames:
            scene.frame_set(frame)
            for each, found in zip(objects, poses, strict=True):
                found.append(evaluated(each))
        faces = [_topology(each) for each in objects]
    return [
        _sampled(each, rest, found, topology)
        for each, rest, found, topology in zip(objects, rests, poses, faces, strict=True)
    ]


def _rest(target: Any) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    points, matrix = evaluated(target)
    if target.find_armature() is None and len(target.data.vertices) == len(points):
        points = points_of(target.data)
    return points, matrix


def _topology(target: Any) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    mesh = target.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    if not len(mesh.polygons):
        raise SceneError(f"{target.name} has no polygons; leave it out of the selection")
    counts = np.empty(len(mesh.polygons), np.int32)
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.polygons.foreach_get("loop_total", counts)
    mesh.loops.foreach_get("vertex_index", corners)
    return counts, corners


def _sampled(target: Any, rest: Any, found: Any, topology: Any) -> SampledMesh:
    points = [pose for pose, _ in found]
    if len({len(pose) for pose in (rest[0], *points)}) > 1:
        raise SceneError(
            f"{target.name} has not the same vertices in all frames; apply or switch off the "
            "modifiers that change them"
        )
    return SampledMesh(
        name=target.name,
        counts=topology[0],
        corners=topology[1],
        points=np.stack(points),
        matrices=np.stack([matrix for _, matrix in found]),
        rest=rest[0],
        rest_matrix=rest[1],
    )
