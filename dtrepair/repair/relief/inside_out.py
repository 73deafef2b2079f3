"""Bodies that intersect themselves are repaired before the clothes over them.

Pushed at once, body and clothes hold each other, and many frames stay dirty. The body alone comes
clean; its clothes then give way to it, and it to them a little. The two sides of a garment with a
thickness hold what came out of it, or is pressed into it: the outer one is repaired first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.temporal import runs_of
from dtrepair.repair.scene.bounds import Judged, faults_left
from dtrepair.repair.scene.holding import is_tied
from dtrepair.repair.scene.opened_pose import Pose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.sub_scene import OuterSides
from dtrepair.repair.scene.welded_mesh import PartMeshes, WeldedMesh, WeldedMeshes

# Returns repaired poses (V, 3) of the frames of a scene.
Solve = Callable[[Scene, WeldedMesh, list[Pose]], list[FloatArray]]
# Solves frames by the meshes of a way, within the bounds.
Judge = Callable[[WeldedMeshes, list[Pose]], list[Judged]]
# Returns the answers of a function for some items, in order.
SideBySide = Callable[[Callable[[Any], Any], list[Any]], list[Any]]


def one_by_one(function: Callable[[Any], Any], items: list[Any]) -> list[Any]:
    """Return the answers of a function for some items, in order."""
    return [function(item) for item in items]


@dataclass(frozen=True, kw_only=True)
class InsideOutOptions:
    """When bodies are repaired before their clothes, and how far they then still give way.

    Args:
        share: Of all pairs of the window at least so many are of inner parts alone: a crease of an
            elbow under its sleeve opens best along with the sleeve.
        mobility: How freely inner parts then move, next to their clothes.
    """

    share: float = 0.25
    mobility: float = 0.01


@dataclass(frozen=True, kw_only=True)
class OuterSideOptions:
    """When the outer sides of thin shells are solved first.

    Args:
        share: Where at least so many of the pairs are of shells and anything else: elsewhere it
            costs more than it gains.
        of_most: Frames with at most this share of such pairs, next to the most that a frame of the
            window has, begin no run, ...
        apart: ... and divide runs where so many follow each other; fewer go along.
    """

    share: float = 0.05
    of_most: float = 0.1
    apart: int = 4


def inside_out(
    meshes: WeldedMeshes,
    frames: list[Pose],
    solve: Solve[Pose],
    side_by_side: SideBySide,
    *,
    options: InsideOutOptions = InsideOutOptions(),
) -> tuple[WeldedMeshes, list[Pose]]:
    """Return the meshes and the frames that are left to be solved.

    Where clothes are in the way these are frames in which what they lie over is repaired as if they
    were not there, and meshes in which it moves less; else what is given.
    """
    inner = meshes.inner
    if inner is None:
        return meshes, frames
    pairs = np.concatenate([frame.pairs for frame in frames])
    if np.count_nonzero(inner.parts.own(pairs)) < options.share * max(len(pairs), 1):
        return meshes, frames
    opened = side_by_side(inner.parts.opened, frames)
    poses = solve(inner.meshes.scene, inner.meshes([own.sewn for own in opened]), opened)
    both = list(zip(frames, poses, strict=True))
    closed = side_by_side(lambda own: inner.parts.closed(*own), both)
    return meshes.with_inner_mobility(options.mobility), closed


def outer_sides_first(
    meshes: WeldedMeshes,
    frames: list[Pose],
    judge: Judge[Pose],
    left: Callable[[Pose], tuple[int, ...]] | None = None,
    side_by_side: SideBySide = one_by_one,
    *,
    options: OuterSideOptions = OuterSideOptions(),
) -> list[Pose]:
    """Return the frames, solved from where the outer sides of thin shells alone come clean.

    Where something meets such a shell, as a knee that comes out of a skirt or a sleeve that is
    pressed into a coat, both sides of it may hold each other there. Runs of frames where nothing
    does, or whose worst frame is left no better so, stay as given; so, too, frames whose outer
    sides keep all they meet. Loose shells are led off as wholes.

    left: how much is wrong with a frame solved from where it begins, less is better; None: all
    runs begin so.
    """
    known = meshes.outer_sides if is_tied(meshes.scene) else None
    if known is None:
        return frames
    begin = partial(_begun, known, judge, side_by_side)
    met = np.array([known.parts.pairs_of_shells(frame.pairs) for frame in frames])
    if met.sum() < options.share * max(sum(len(frame.pairs) for frame in frames), 1):
        return frames
    result = list(frames)
    for run in runs_of(met > options.of_most * met.max(), apart=options.apart):
        worst = frames[run.start + int(np.argmax(met[run]))]
        if left is None or _gains(worst, begin, left):
            result[run] = begin(frames[run])
    return result


def _gains(
    frame: Pose,
    begin: Callable[[list[Pose]], list[Pose]],
    left: Callable[[Pose], tuple[int, ...]],
) -> bool:
    """Return whether a frame that does not come clean by itself is left better where it begins."""
    alone = left(frame)
    if not any(alone):
        return False
    (begun,) = begin([frame])
    return begun.begun is not None and left(begun) < alone


def _begun(
    known: PartMeshes[OuterSides], judge: Judge[Pose], side_by_side: SideBySide, frames: list[Pose]
) -> list[Pose]:
    """Return frames that begin where the outer sides of shells, repaired alone, are led."""
    parts, own = known
    opened, result = side_by_side(parts.opened, frames), list[Pose]()
    for frame, before, found in zip(frames, opened, judge(own, opened), strict=True):
        kept = len(own.scene.pairs(found.points, before.weld))
        gains = kept == 0 or kept < len(before.pairs)
        begun = parts.closed(frame, found.points) if gains else None
        result.append(replace(frame, begun=begun))
    return result


def from_themselves(
    scene: Scene,
    frames: Sequence[Pose],
    judged: list[Judged],
    judge: Callable[[list[Pose]], list[Judged]],
) -> list[Judged]:
    """Return better poses of frames begun elsewhere that are not clean, if they leave less so."""
    result, wrong = list(judged), faults_left(scene, frames, judged)
    begun = [
        frame.begun is not None and left > 0 for frame, left in zip(frames, wrong, strict=True)
    ]
    chosen = np.flatnonzero(begun).tolist()
    own = [replace(frames[k], begun=None) for k in chosen]
    other = judge(own) if own else []
    for k, found, left in zip(chosen, other, faults_left(scene, own, other), strict=True):
        if left < wrong[k]:
            result[k] = found
    return result
