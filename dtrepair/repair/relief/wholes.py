"""Parts that lost their shapes go as wholes with what they are attached to.

What a push turned inside out, as the pin of a buckle, cannot be relaxed back.
"""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.repair.scene.bounds import LOOSE, badness, pairs_and_enclosed, strain_of
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.strain.parts import ConnectedParts
from dtrepair.repair.strain.turning import best_rotation


def with_wholes(scene: Scene, pose: OpenedPose, points: FloatArray, *, most: int) -> FloatArray:
    """Return what was found (V, 3) for a pose, parts that lost their shapes moved as wholes.

    Each where that is less strained, brings no contact back, and leads nothing farther than what
    was found does. most: so many are tried, the smallest first.
    """
    before, parts = pose.centred, scene.strain_meter.parts
    excess = strain_of(scene, before, points)
    lost = sorted({own.part for own in excess if own.kind not in LOOSE})
    if not lost:
        return points
    least, wrong = badness(excess), pairs_and_enclosed(scene, pose, points)
    farthest, sizes = lengths(points - before).max(), np.bincount(parts.of_face)
    for part in sorted(lost, key=sizes.__getitem__)[:most]:
        own = parts.of_vertex[scene.rest_sewn] == part
        if (scene.mobility[own] == 0.0).any():
            continue
        turn, shift = rigid_motion(parts, before, points, part)
        trial = np.where(own[:, None], before @ turn.T + shift, points)
        if lengths(trial - before).max() > farthest:
            continue
        if (value := badness(strain_of(scene, before, trial))) >= least:
            continue
        left = pairs_and_enclosed(scene, pose, trial)
        if left[0] <= wrong[0] and left[1] <= wrong[1]:
            points, least, wrong = trial, value, left
    return points


def rigid_motion(
    parts: ConnectedParts, before: FloatArray, after: FloatArray, part: int
) -> tuple[FloatArray, FloatArray]:
    """Return the rotation R (3, 3) and the shift s (3,) of a part: x goes to R x + s.

    They lead it, and what its ties join it to, best from one pose (V, 3) to another: how a pin
    that was turned inside out lies, the buckle round it tells.
    """
    near = [np.flatnonzero(parts.of_vertex == part)]
    if parts.ties is not None:
        hosts = parts.corners[parts.ties.triangles]
        near.append(hosts[parts.of_vertex[parts.ties.vertices] == part].ravel())
        near.append(parts.ties.vertices[parts.of_vertex[hosts[:, 0]] == part])
    known = np.unique(np.concatenate(near))
    return rigid_motion_of(before[known], after[known])


def rigid_motion_of(before: FloatArray, after: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rotation R (3, 3) and the shift s (3,) that lead points (N, 3) best to others."""
    old, new = (np.vstack([points.mean(axis=0), points]) for points in (before, after))
    spokes = np.stack([np.zeros(len(before)), 1 + np.arange(len(before))], axis=1)
    rotation = best_rotation(old, new, spokes.astype(np.int32))
    return rotation, new[0] - rotation @ old[0]
