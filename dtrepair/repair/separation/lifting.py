"""What is worn is lifted off what came through it, before contacts are pushed.

A push moves both sides of a contact the short way, which for a sleeve deep in its arm may be
inwards. Where one part is known to lie over another, each of its vertices that went under is led
back to the surface whose normal agrees with its own, and the layer follows smoothly.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.worn.around import still_around
from dtrepair.numerics.worn.sides import WornLayer
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.separation.layer_lift import LayerLift, LiftOptions
from dtrepair.repair.separation.steady_lift import lifted_steadily


def lifted_frames(
    scene: Scene,
    poses: FloatArray,
    met: Sequence[IntArray],
    frames: FloatArray,
    *,
    options: LiftOptions = LiftOptions(),
) -> FloatArray:
    """Return poses (T, V, 3) with all layers lifted off the parts that they lie over.

    With a largest displacement all is left to the repair of contacts, which keeps to it.

    Args:
        scene: The bodies.
        poses: Poses (T, V, 3).
        met: Of each frame the parts (K, 2) that meet, or of which one is inside the other.
        frames: Times (T,) in frame units.
        options: Numbers of this stage.
    """
    if not _lifts(scene):
        return poses
    keys = [{tuple(sorted(both)) for both in found.tolist()} for found in met]
    every = sorted(set().union(*keys))
    found = [scene.layers.between(first, second) for first, second in every]
    layers = [layer for layer in found if layer is not None and _may_move(scene, layer)]
    if not layers:
        return poses
    result = poses.copy()
    for layer in _from_inside(layers):
        both = tuple(sorted((layer.top, layer.under)))
        meets = np.array([both in own for own in keys])
        if layer.around:
            meets &= [still_around(scene.layers.parts, layer, pose) for pose in result]
        result = lifted_steadily(LayerLift(scene, layer, options), result, frames, meets)
    return result


def parts_that_meet(scene: Scene, pairs: IntArray, enclosed: IntArray) -> IntArray:
    """Return the parts (K, 2) of a pose that meet by pairs (P, 2), or lie inside each other."""
    parts = np.unique(np.sort(scene.enclosures.part_of_face[pairs], axis=1), axis=0)
    meeting: IntArray = np.concatenate([parts[parts[:, 0] != parts[:, 1]], enclosed])
    return meeting


def not_worn(scene: Scene, enclosed: IntArray) -> IntArray:
    """Return which parts (K, 2) inside others are no layers of these, which are lifted instead."""
    if not _lifts(scene):
        return enclosed
    layers = (scene.layers.between(inner, outer) for inner, outer in enclosed.tolist())
    loose = [own is None or own.around or not _may_move(scene, own) for own in layers]
    parts: IntArray = enclosed[np.array(loose, dtype=bool)]
    return parts


def layered_bodies(scene: Scene, pairs: Sequence[IntArray]) -> set[tuple[int, int]]:
    """Return bodies (first < second) of which one is a layer over the other where they meet.

    pairs: of each frame the pairs (K, 2) of triangles that intersect. Lifts lead such bodies.
    """
    if not _lifts(scene):
        return set()
    none = np.zeros((0, 2), dtype=np.int32)
    met = np.unique(np.concatenate([parts_that_meet(scene, own, none) for own in pairs]), axis=0)
    bodies = np.sort(scene.body_of_part[met], axis=1)
    layers = (scene.layers.between(first, second) for first, second in met.tolist())
    led = [own is not None and not own.around and _may_move(scene, own) for own in layers]
    return {(int(a), int(b)) for a, b in bodies[np.array(led, dtype=bool)] if a != b}


def _lifts(scene: Scene) -> bool:
    """Return whether layers are lifted at all: by the full method, and without a limit."""
    return scene.options.method == "full" and scene.options.maximum_displacement is None


def _may_move(scene: Scene, layer: WornLayer) -> bool:
    """Return whether a layer may be moved freely: neither stiff nor directed."""
    own = scene.enclosures.vertices(layer.top)
    body = int(scene.body_of_vertex[own[0]])
    free = not scene.is_stiff(body) and bool((scene.mobility[own] > 0.0).any())
    return free and not scene.direction[own].any()


def _from_inside(layers: list[WornLayer]) -> list[WornLayer]:
    """Return layers such that what lies beneath comes first; circles are cut anywhere."""
    height = {part: 0 for layer in layers for part in (layer.top, layer.under)}
    for _ in layers:
        for layer in layers:
            height[layer.top] = min(max(height[layer.top], height[layer.under] + 1), len(layers))
    return sorted(layers, key=lambda layer: (height[layer.top], layer.top, layer.under))
