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


@dataclass(frozen=True)
class Keys:
    """Shape keys of a run of frames: offsets (K, V, 3), and weights (T, K) at the frames."""

    run: list[int]
    shapes: NDArray[np.float64]
    weights: NDArray[np.float64]


def fewest(
    frames: Sequence[int], offsets: NDArray[np.float64], tolerance: float = 0.0
) -> list[Keys]:
    """Return the shape keys of offsets (T, V, 3) at frames, for each run of those that change.

    As few of them as leave no vertex farther off than the tolerance; with 0 each frame has its own.
    """
    changed = [f for f, offset in zip(frames, offsets, strict=True) if offset.any()]
    places = [[frames.index(frame) for frame in run] for run in runs(changed)]
    return [
        Keys(run, *few_shapes(offsets[own], tolerance))
        for run, own in zip(runs(changed), places, strict=True)
    ]


def add_keys(copy: Any, found: Sequence[Keys]) -> list[str]:
    """Give an object shape keys, keyed on their run and off beside it; return their names."""
    basis = _basis(copy)
    names = []
    for each in found:
        for number, shape in enumerate(each.shapes):
            suffix = "" if len(each.shapes) == 1 else f" {number + 1}"
            name = f"{PREFIX} {run_name(each.run)}{suffix}"
            made = copy.shape_key_add(name=name, from_mix=False)
            _set_points(copy, made, basis + shape)
            _key_values(made, weight_keys(each.run, each.weights[:, number]))
            names.append(made.name)
    return names


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


def fitted(
    copy: Any, frame: int, before: NDArray[np.float32], wanted: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Return the offsets (V, 3) of a shape key that leads to the wanted points (V, 3) at a frame.

    They hold before the modifiers; what a modifier makes of an offset is measured on the evaluated
    mesh.
    """
    offset = np.zeros(wanted.shape)
    moving = moved(before[None], wanted[None])
    if not len(moving):
        return offset
    basis = _basis(copy)
    probe = copy.shape_key_add(name=f"{PREFIX} probe", from_mix=False)
    probe.slider_max = probe.value = 1.0
    step = 0.1 * float(np.ptp(basis, axis=0).max()) or 1.0

    def posed(offset: NDArray[np.float64]) -> NDArray[np.float64]:
        _set_points(copy, probe, basis + offset)
        return evaluated(copy)[0].astype(np.float64)[moving]

    with cage_only([copy]), kept_frame(bpy.context.scene):
        bpy.context.scene.frame_set(frame)
        here = posed(offset)
        columns = []
        for axis in range(3):
            shifted = np.zeros_like(offset)
            shifted[moving, axis] = step
            columns.append((posed(shifted) - here) / step)
        # Where an offset is lost on the way, the least one is taken.
        inverse = np.linalg.pinv(np.stack(columns, axis=2), rcond=1e-4)
        for _ in range(ROUNDS):
            offset[moving] += np.einsum("mij,mj->mi", inverse, wanted[moving] - here)
            here = posed(offset)
    copy.shape_key_remove(probe)
    return offset


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
