"""Repaired points as keyed relative shape keys of a copy of the object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..host.exchange import SampledMesh
from ..host.runs import few_shapes, moved, run_name, runs, weight_keys
from .sampling import PREFIX, SceneError, cage_only, evaluated, kept_frame

# Corrections until the modifiers put each vertex where it should be; one does where they are
# linear, as an armature is.
ROUNDS = 3


@dataclass(frozen=True)
class Applied:
    """The names of the shape keys, and how far a vertex is from where it should be (T,)."""

    keys: tuple[str, ...]
    off: NDArray[np.float64]


def refuse_added_vertices(objects: Sequence[Any], meshes: Sequence[SampledMesh]) -> None:
    """Raise SceneError where shape keys cannot hold what a repair may find."""
    for each, mesh in zip(objects, meshes, strict=True):
        if len(each.data.vertices) != mesh.points.shape[1]:
            raise SceneError(
                f"{each.name}: its modifiers add or remove vertices, so that no shape key can hold "
                "the result; choose a mesh cache, or apply them (subdivision may stay)"
            )
        keys = each.data.shape_keys
        if keys is not None and not keys.use_relative:
            raise SceneError(f"{each.name}: its shape keys are absolute; make them relative")


def apply(
    copy: Any,
    frames: Sequence[int],
    mesh: SampledMesh,
    points: NDArray[np.float32],
    tolerance: float = 0.0,
) -> Applied:
    """Give an object shape keys that lead to the points (T, V, 3) at the frames.

    The keys hold offsets before the modifiers; what a modifier makes of an offset is measured on
    the evaluated mesh. Each run of frames has as few keys as leave no vertex farther off than the
    tolerance, a part of the size of the mesh; with 0 each frame has its own.
    """
    basis = _basis(copy)
    with cage_only([copy]), kept_frame(bpy.context.scene):
        offsets, off = _offsets(copy, basis, frames, mesh.points, points)
        names = _keyed(copy, basis, list(frames), offsets, tolerance * size_of(basis))
    return Applied(tuple(names), off)


def _basis(target: Any) -> NDArray[np.float32]:
    """Return the points (V, 3) that new shape keys are relative to."""
    if target.data.shape_keys is None:
        target.shape_key_add(name="Basis", from_mix=False)
    return points_of_key(target.data.shape_keys.reference_key)


def points_of_key(key: Any) -> NDArray[np.float32]:
    """Return the points (V, 3) of a shape key."""
    points = np.empty(3 * len(key.data), np.float32)
    key.data.foreach_get("co", points)
    return points.reshape(-1, 3)


def _offsets(
    copy: Any,
    basis: NDArray[np.float32],
    frames: Sequence[int],
    before: NDArray[np.float32],
    wanted: NDArray[np.float32],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return offsets before the modifiers (T, V, 3), and what is left at each frame (T,)."""
    probe = copy.shape_key_add(name=f"{PREFIX} probe", from_mix=False)
    probe.slider_max = probe.value = 1.0
    offsets = np.zeros(wanted.shape)
    off = np.zeros(len(frames))
    step = 0.1 * float(np.ptp(basis, axis=0).max()) or 1.0

    def posed(offset: NDArray[np.float64]) -> NDArray[np.float64]:
        _set_points(copy, probe, basis + offset)
        return evaluated(copy)[0].astype(np.float64)

    for index, frame in enumerate(frames):
        moving = moved(before[index : index + 1], wanted[index : index + 1])
        if not len(moving):
            continue
        bpy.context.scene.frame_set(frame)
        own = offsets[index]
        here = posed(own)
        columns = []
        for axis in range(3):
            shifted = np.zeros_like(own)
            shifted[moving, axis] = step
            columns.append((posed(shifted) - here)[moving] / step)
        jacobian = np.stack(columns, axis=2)
        for _ in range(ROUNDS):
            left = wanted[index, moving] - here[moving]
            own[moving] += _solved(jacobian, left)
            here = posed(own)
        off[index] = np.abs(wanted[index, moving] - here[moving]).max()
    copy.shape_key_remove(probe)
    return offsets, off


def _solved(jacobian: NDArray[np.float64], left: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the offsets (M, 3) that move vertices by what is left, least where some are lost."""
    inverse = np.linalg.pinv(jacobian, rcond=1e-4)
    return np.asarray(np.einsum("mij,mj->mi", inverse, left))


def _keyed(
    copy: Any,
    basis: NDArray[np.float32],
    frames: list[int],
    offsets: NDArray[np.float64],
    tolerance: float,
) -> list[str]:
    """Add shape keys for each run of changed frames, and key their values."""
    changed = [f for f, offset in zip(frames, offsets, strict=True) if offset.any()]
    names = []
    for run in runs(changed):
        shapes, weights = few_shapes(offsets[[frames.index(f) for f in run]], tolerance)
        for number, shape in enumerate(shapes):
            name = run_name(run) if len(shapes) == 1 else f"{run_name(run)} {number + 1}"
            key = copy.shape_key_add(name=f"{PREFIX} {name}", from_mix=False)
            _set_points(copy, key, basis + shape)
            _key_values(key, weight_keys(run, weights[:, number]))
            names.append(key.name)
    return names


def size_of(points: NDArray[np.floating]) -> float:
    """Return the diagonal of the box around points (V, 3)."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def _set_points(target: Any, key: Any, points: NDArray[np.floating]) -> None:
    key.data.foreach_set("co", np.ascontiguousarray(points, dtype=np.float32).ravel())
    target.data.update_tag()
    target.data.shape_keys.update_tag()
    bpy.context.view_layer.update()


def _key_values(key: Any, keys: list[tuple[int, float]]) -> None:
    low, high = min(w for _, w in keys), max(w for _, w in keys)
    key.slider_min, key.slider_max = min(low, 0.0), max(high, 1.0)
    for frame, weight in keys:
        key.value = weight
        key.keyframe_insert("value", frame=frame)
    for curve in _curves(key):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"


def _curves(key: Any) -> list[Any]:
    """Return the curves of a shape key's value."""
    animation = key.id_data.animation_data
    bag = animation.action.layers[0].strips[0].channelbag(animation.action_slot)
    path = key.path_from_id("value")
    return [curve for curve in bag.fcurves if curve.data_path == path]
