"""Props and machines: bodies that move as wholes in the input, and are rigid while it is solved.

Props that were led out of something come back in the frames around, where nothing meets them:
shifts of rigid bodies are smooth over many frames, and no other stage takes them back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.temporal import eased_in_time
from dtrepair.repair.relief.other_ways import Judge, OtherWayOptions, farthest_move, left_over
from dtrepair.repair.scene.bounds import Judged, came_off, faults_left, wrong_in, wrong_of_groups
from dtrepair.repair.scene.holding import is_tied
from dtrepair.repair.scene.opened_pose import OpenedPose, Pose
from dtrepair.repair.scene.props import MachineOptions, machine_bodies
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes


@dataclass(frozen=True, kw_only=True)
class PropsBackOptions:
    """How props come back.

    Args:
        halvings: The least share of its correction that a prop needs is found by so many.
        width: Standard deviation, in frames, over which shares come and go.
        tries: Eased in time, all of it may have to come back in some frames: so many tries.
    """

    halvings: int = 3
    width: float = 1.0
    tries: int = 4


def machine_kept_whole(
    meshes: WeldedMeshes,
    frames: Sequence[Pose],
    judge: Judge[Pose],
    ways: OtherWayOptions = OtherWayOptions(),
    options: MachineOptions = MachineOptions(),
) -> tuple[list[Judged], WeldedMeshes] | None:
    """Return the clean poses of a window of a machine that stays rigid, and its meshes.

    None where it is none, or not all frames come clean that way, or much nearer where it bends.
    Limbs of a machine that press into each other deeper than its joints have play have to bend.
    """
    scene = meshes.scene
    if not is_tied(scene):
        return None
    whole = machine_bodies(scene, [frame.centred for frame in frames], options=options)
    if not whole:
        return None
    rigid = meshes.with_rigid(whole, wholes=True)
    worst = max(frames, key=lambda frame: frame.wrong)
    (alone,) = judge(rigid, [worst])
    (left,) = faults_left(scene, [worst], [alone])
    if alone.lowered or left > options.left * worst.wrong:
        return None
    judged = judge(rigid, list(frames)) if frames[1:] else [alone]
    if any(left_over(scene, frames, judged)) or _bends_nearer(meshes, frames, judged, judge, ways):
        return None
    return judged, rigid


def with_props(
    meshes: WeldedMeshes,
    frames: Sequence[Pose],
    judge: Judge[Pose],
    *,
    options: OtherWayOptions = OtherWayOptions(),
) -> tuple[list[Judged], WeldedMeshes]:
    """Return the repaired poses of a window, and the meshes they are of: with props rigid.

    They bend where that leaves less, or the frame that moves farthest moves much less by it.
    """
    rigid = meshes.with_props
    judged = judge(rigid, list(frames))
    if rigid is meshes:
        return judged, meshes
    left = left_over(rigid.scene, frames, judged)
    if any(left):
        helps = _met_where_left(rigid.scene, frames, judged)
    else:
        helps = _bends_nearer(meshes, frames, judged, judge, options)
    if not helps:
        return judged, rigid
    other = judge(meshes, list(frames))
    less = left_over(meshes.scene, frames, other)
    far, near = (farthest_move(meshes.scene, frames, own) for own in (judged, other))
    nearer = less == left and options.much_farther(far, near)
    return (other, meshes) if less < left or nearer else (judged, rigid)


def _met_where_left(scene: Scene, frames: Sequence[OpenedPose], judged: Sequence[Judged]) -> bool:
    """Return whether something met a prop in a frame in which anything is wrong yet."""
    props = [k for k, body in enumerate(scene.bodies) if body.prop]
    of_prop = np.isin(scene.body_of, props)
    poses = [own.points for own in judged]
    wrong = wrong_in(scene, frames, poses)
    return any(
        bool(of_prop[frame.pairs].any()) and (left > 0 or came_off(scene, frame, pose))
        for frame, left, pose in zip(frames, wrong, poses, strict=True)
    )


def _bends_nearer(
    meshes: WeldedMeshes,
    frames: Sequence[Pose],
    judged: Sequence[Judged],
    judge: Judge[Pose],
    options: OtherWayOptions,
) -> bool:
    """Return whether the frame that moves farthest comes clean much nearer where props bend."""
    scene = meshes.scene
    both = zip(frames, judged, strict=True)
    moves = [farthest_move(scene, [frame], [own]) for frame, own in both]
    worst = int(np.argmax(moves))
    if moves[worst] <= options.far:
        return False
    own = [frames[worst]]
    other = judge(meshes, own)
    nearer = options.much_farther(moves[worst], farthest_move(scene, own, other))
    return nearer and not any(left_over(scene, own, other))


def props_back(
    scene: Scene,
    frames: Sequence[OpenedPose],
    judged: list[Judged],
    times: FloatArray,
    *,
    options: PropsBackOptions = PropsBackOptions(),
) -> list[Judged]:
    """Return what was found for frames with props no farther out than they have to be.

    Args:
        scene: The bodies; props among them may be rigid.
        frames: The input.
        judged: What was found for it.
        times: Of the frames (T,), in frame units.
        options: The numbers.
    """
    props = [k for k, body in enumerate(scene.bodies) if body.prop and body.rigid]
    own = [scene.vertices_of(k) for k in props]
    both = list(zip(frames, judged, strict=True))
    moved = np.array([[(f.centred[v] != j.points[v]).any() for v in own] for f, j in both], bool)
    if not moved.any():
        return judged

    def wrong(frame: OpenedPose, points: FloatArray) -> IntArray:
        """Return how much is wrong with each prop (P,) in a pose (V, 3) of a frame."""
        return wrong_of_groups(scene, frame, points, scene.body_of_part)[props]

    left = [wrong(frame, found.points) for frame, found in both]

    def placed(kept: FloatArray) -> list[FloatArray]:
        """Return the poses (V, 3) with shares (T, P) of what moves the props."""
        return [_placed(scene, own, *each) for each in zip(frames, judged, kept, strict=True)]

    def closed(kept: FloatArray) -> IntArray:
        """Return in which frames which props (T, P) then meet more than they did."""
        asked = zip(frames, placed(kept), left, strict=True)
        return np.array([wrong(f, points) > was for f, points, was in asked])

    low, needed = np.zeros((2, *moved.shape))
    needed[moved & closed(low)] = 1.0
    for _ in range(options.halvings if needed.any() else 0):
        middle = 0.5 * (low + needed)
        bad = closed(middle)
        low, needed = np.where(bad, middle, low), np.where(bad, needed, middle)
    for _ in range(options.tries):
        kept = eased_in_time(needed, times, options.width)
        if not (bad := closed(kept)).any():
            poses = placed(kept)
            return [own._replace(points=pose) for own, pose in zip(judged, poses, strict=True)]
        needed[bad] = 1.0
    return judged


def _placed(
    scene: Scene, own: Sequence[slice], frame: OpenedPose, judged: Judged, kept: FloatArray
) -> FloatArray:
    """Return a pose (V, 3) with shares (P,) of what moves some props, each of them rigid."""
    before, result = frame.centred, judged.points.copy()
    for vertices, share in zip(own, kept.tolist(), strict=True):
        if share < 1.0:
            result[vertices] = before[vertices] + share * (result[vertices] - before[vertices])
    fitted: FloatArray = scene.rigid.fitted(before, result)
    return fitted
