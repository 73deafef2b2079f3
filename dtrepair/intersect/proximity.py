"""Pairs of triangles closer than a distance: what a clearance forbids."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtrepair.device import start_warp
from dtrepair.intersect.detector import Detector
from dtrepair.intersect.ignored import collapsed
from dtrepair.numerics.geometry import FloatArray, IntArray, dots, vector_areas


def close_pairs(
    detector: Detector,
    points: NDArray[np.float32],
    distance: float,
    *,
    active: NDArray[np.bool_] | None = None,
) -> IntArray:
    """Return the pairs (K, 2), i < j, sorted, of triangles closer than `distance`.

    Pairs with a common vertex are left out.

    Distances are those of the boundaries: of a pair that intersects only where an edge pierces a
    face the distance may be positive, so unite the result with the detector's pairs. Points (V, 3)
    and distance have the same length unit; `active` (F,) as in `Detector`. Raises
    CollapsedPoseError where there are more pairs than can be kept.
    """
    tree = detector.tree
    if tree is None or distance <= 0.0:
        return np.zeros((0, 2), dtype=np.int32)
    from dtrepair.intersect.proximity_kernels import find_close_pairs

    warp, mesh, device = start_warp(), detector.mesh, detector.mesh.device
    searching = np.ones(len(tree.order), dtype=bool) if active is None else active[tree.order]
    queries = np.flatnonzero(searching).astype(np.int32)
    boxes = detector.boxes(points[None])
    inputs = [device.view(points, warp.vec3f), mesh.ordered, mesh.order, *mesh.leaves]
    inputs += [*boxes[:4], device.array(queries, warp.int32)]
    inputs.append(device.array(searching.astype(np.uint8), warp.uint8))
    most = detector.limits.of(len(tree.order))[0]
    capacity = 4 * len(tree.order) + 1024
    while True:
        pairs = device.empty(capacity, warp.vec2i)
        count = device.zeros(1, warp.int32)
        arguments = [*inputs, float(distance), most, pairs, count]
        device.launch(find_close_pairs, len(queries), arguments)
        pair_count = int(count.numpy()[0])
        if pair_count > most:
            raise collapsed(len(tree.order))
        if pair_count <= capacity:
            rows = pairs.numpy()[:pair_count]
            ordered: IntArray = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
            return ordered
        capacity = pair_count


def face_each_other(points: FloatArray, faces: IntArray, pairs: IntArray) -> NDArray[np.bool_]:
    """Return which pairs (K, 2) of triangles have each other in front, (K,).

    The outside lies between them.

    points: (V, 3); faces: (F, 3), normals outwards; told at the centres.
    """
    centres = points[faces[pairs]].mean(axis=2)
    across = centres[:, 1] - centres[:, 0]
    normals = vector_areas(points, faces[pairs].reshape(-1, 3)).reshape(-1, 2, 3)
    return (dots(normals[:, 0], across) > 0.0) & (dots(normals[:, 1], across) < 0.0)
