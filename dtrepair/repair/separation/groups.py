"""Which bodies come near each other: those that do not are repaired each for themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.scale import boxes_of, gaps_between
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class GroupOptions:
    """When bodies are near each other.

    Args:
        near: Their boxes are no farther apart than this part of the size of the scene, and the
            clearance: what is led out of others may need room.
        near_still: The same for a body that never moves: who stands above a floor does not need it.
    """

    near: float = 0.1
    near_still: float = 0.01


def groups_of_bodies(
    scene: Scene, poses: Sequence[FloatArray], *, options: GroupOptions = GroupOptions()
) -> list[tuple[int, ...]]:
    """Return groups of bodies that never come near each other in some poses (V, 3).

    What is attached is near. A body that never moves is in each group that it is near to, perhaps
    in none; every other is in one.
    """
    still = scene.never_moves
    moving = np.flatnonzero(~still)
    if len(moving) == 0:
        return [tuple(range(len(still)))]
    part = np.where(still[:, None] | still, options.near_still, options.near)
    room = part * scene.scale.extent(scene.rest) + scene.options.clearance
    near = _attached(scene)
    for pose in poses:
        near |= _overlap(boxes_of(pose, scene.vertex_starts), room)
    among = sparse.csr_matrix(near[np.ix_(moving, moving)])
    count, label = csgraph.connected_components(among, directed=False)
    groups = []
    for number in range(count):
        own = near[moving[label == number]].any(axis=0) & still
        own[moving[label == number]] = True
        groups.append(tuple(np.flatnonzero(own).tolist()))
    return groups


def groups_meet(
    scene: Scene, groups: Sequence[tuple[int, ...]], poses: Sequence[FloatArray]
) -> bool:
    """Return whether bodies may meet that are in no group together, in some poses (V, 3)."""
    together = np.zeros((len(scene.bodies),) * 2, dtype=bool)
    for group in groups:
        together[np.ix_(group, group)] = True
    together[np.ix_(scene.never_moves, scene.never_moves)] = True
    room = scene.options.clearance
    return any(
        bool((_overlap(boxes_of(pose, scene.vertex_starts), room) & ~together).any())
        for pose in poses
    )


def faulty_bodies(scene: Scene, poses: Sequence[OpenedPose]) -> set[int]:
    """Return the bodies that have pairs, or lie inside others, in any of the poses."""
    pairs = [scene.body_of[pose.pairs] for pose in poses]
    enclosed = [scene.body_of_part[pose.enclosed] for pose in poses]
    return set(np.concatenate([*pairs, *enclosed]).ravel().tolist())


def _overlap(boxes: FloatArray, room: FloatArray | float) -> BoolArray:
    """Return which boxes (B, 2, 3) are no farther apart than some room, one or each (B, B)."""
    return gaps_between(boxes) <= room


def _attached(scene: Scene) -> BoolArray:
    """Return which bodies have parts that are attached to each other, (B, B)."""
    result = np.zeros((len(scene.bodies),) * 2, dtype=bool)
    if scene.attachments is not None:
        body_of_part = np.zeros(scene.attachments.count, dtype=np.int64)
        body_of_part[scene.attachments.part_of] = scene.body_of
        vertices, triangles, *_ = scene.attachments.every_tie
        held = [(body_of_part[a], body_of_part[b]) for a, b in scene.attachments.pairs_of_parts]
        held += zip(scene.body_of_vertex[vertices], scene.body_of[triangles], strict=True)
        first, second = np.array(held, dtype=np.int64).reshape(-1, 2).T
        result[first, second] = result[second, first] = True
    return result
