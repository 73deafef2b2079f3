"""Poses of a scene, each for itself: open, lead apart, solve, verify; solved at once on a GPU."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.independent_options import IndependentOptions
from dtrepair.repair.relief.bodies_first import with_bodies_first
from dtrepair.repair.relief.followers import with_followers
from dtrepair.repair.relief.inside_out import outer_sides_first
from dtrepair.repair.relief.opening import opened_frames, own_rest, too_close
from dtrepair.repair.result import RepairResult, Solved, Stage
from dtrepair.repair.scene.bounds import Judged, came_off, wrong_of
from dtrepair.repair.scene.holding import is_tied
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.results import kept, results_of
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from dtrepair.repair.separation.groups import faulty_bodies, groups_meet, groups_of_bodies
from dtrepair.repair.single_poses import (
    Found,
    approached,
    bounded_poses,
    bounded_result,
    result_pairs,
    solved_poses,
)


def repair_poses(
    scene: Scene,
    meshes: WeldedMeshes,
    poses: Sequence[Sequence[Any]],
    *,
    options: IndependentOptions = IndependentOptions(),
) -> list[list[RepairResult]]:
    """Return the results of poses (V, 3) of each body, all in one space and length unit.

    Raises:
        ValueError: wrong shapes, numbers that are not finite.
    """
    opened = [detected(scene, gathered(scene, points)) for points in poses]
    groups = [_groups(scene, pose) for pose in opened]
    whole = [k for k, own in enumerate(groups) if not own]
    known = _found(scene, meshes, [opened[k] for k in whole], options)
    found = dict(zip(whole, known, strict=True))
    for k in set(range(len(opened))) - set(whole):
        found[k] = _found_by_groups(scene, meshes, opened[k], groups[k], options)
    results = []
    for k, pose in enumerate(opened):
        judged, pairs, solved, seconds, _ = found[k]
        (led,) = with_followers(scene, [pose], [judged], np.zeros(1), options=options.followers)
        if led is not judged:
            judged, pairs = led, result_pairs(scene, led.points)
        spent = {"detect": pose.seconds, "solve": seconds}
        result = kept(scene, pose, judged.points, pairs)
        results.append(results_of(scene, pose, result, solved, spent, judged))
    return results


def _groups(scene: Scene, pose: OpenedPose) -> list[tuple[int, ...]]:
    """Return the groups of bodies that are repaired as if there were no others; none: all are one.

    The published method knows none.
    """
    solved = pose.wrong or scene.options.clearance > 0.0
    if not solved or scene.options.method == "paper" or len(scene.bodies) == 1:
        return []
    groups = groups_of_bodies(scene, [pose.centred])
    return [] if groups == [tuple(range(len(scene.bodies)))] else groups


def _found_by_groups(
    scene: Scene,
    meshes: WeldedMeshes,
    pose: OpenedPose,
    groups: Sequence[tuple[int, ...]],
    options: IndependentOptions,
) -> Found:
    """Return what is found for groups of bodies; for all at once, if they would meet."""
    judged, solved, seconds = Judged(pose.centred), Solved(pose.centred), 0.0
    faulty = faulty_bodies(scene, [pose])
    for bodies in groups:
        # With a clearance a pose without pairs may have to move as well.
        asked = scene.options.clearance > 0.0 and not options.room
        if not asked and faulty.isdisjoint(bodies):
            continue
        parts, own = meshes.of_bodies(bodies)
        (found,) = _found(parts.scene, own, [parts.opened(pose)], options)
        judged = parts.joined(judged, found.judged)
        stages, left = [*solved.stages, *found.solved.stages], solved.left + found.solved.left
        solved, seconds = Solved(pose.centred, stages, left), seconds + found.seconds
    if groups_meet(scene, groups, [judged.points]):
        return _found(scene, meshes, [pose], options)[0]
    return Found(judged, result_pairs(scene, judged.points), solved, seconds)


def _found(
    scene: Scene, meshes: WeldedMeshes, opened: Sequence[OpenedPose], options: IndependentOptions
) -> list[Found]:
    """Return what is found for poses: without the clearance, and opened then."""
    plain = meshes.without_clearance
    found = _found_so(plain.scene, plain, opened, options)
    if scene.options.clearance == 0.0:
        return found
    return [
        own if options.room and not pose.wrong else _opened(scene, meshes, pose, own, options)
        for pose, own in zip(opened, found, strict=True)
    ]


def _opened(
    scene: Scene, meshes: WeldedMeshes, pose: OpenedPose, found: Found, options: IndependentOptions
) -> Found:
    """Return what is found for a pose with its contacts apart by the clearance."""
    start, mesh = time.perf_counter(), meshes([pose.sewn])
    known, numbers = [found.judged], options.opening
    (judged,) = opened_frames(scene, mesh, [pose], known, np.zeros(1), options=numbers)
    facing = own_rest(mesh, [pose])
    left = 0 if options.room else too_close(mesh, judged.points, facing=facing)
    pairs = result_pairs(scene, judged.points)
    spent = time.perf_counter() - start
    stages = [*found.solved.stages, Stage("open", len(pairs), 0, 0.0, 0, spent)]
    solved = replace(found.solved, stages=stages, left=left)
    return Found(judged, pairs, solved, found.seconds + spent)


def _found_so(
    scene: Scene, meshes: WeldedMeshes, opened: Sequence[OpenedPose], options: IndependentOptions
) -> list[Found]:
    """Return what is found for poses, and from the outer sides of thin shells what is left then."""
    found = _on_ways(scene, meshes, opened, options)
    for k, pose in enumerate(opened):
        rank = partial(_left, scene, pose)
        if any(rank(found[k])):
            ways = _from_outer_sides(scene, meshes, pose, options)
            found[k] = _best(found[k], ways, rank, lambda left: not any(left))
    return found


def _from_outer_sides(
    scene: Scene, meshes: WeldedMeshes, pose: OpenedPose, options: IndependentOptions
) -> Iterator[Found]:
    """Yield what is found from where the outer sides of thin shells come clean, if they do."""

    def judge(sides: WeldedMeshes, poses: list[OpenedPose]) -> list[Judged]:
        return [found.judged for found in _on_ways(sides.scene, sides, poses, options)]

    (begun,) = outer_sides_first(meshes, [pose], judge)
    if begun.begun is not None:
        yield from _on_ways(scene, meshes, [begun], options)


def _on_ways(
    scene: Scene, meshes: WeldedMeshes, opened: Sequence[OpenedPose], options: IndependentOptions
) -> list[Found]:
    """Return what is found for poses; attached parts take their garments along first."""
    if meshes.dressed is None:
        return bounded_poses(scene, meshes, opened, options)
    tied = is_tied(scene)
    first, otherwise = (meshes.dressed, _undressed) if tied else (meshes, _dressed)
    known = bounded_poses(first.scene, first, opened, options, approach=False)
    best = [otherwise(scene, meshes, *both, options) for both in zip(opened, known, strict=True)]
    return [approached(pose, found, options) for pose, found in zip(opened, best, strict=True)]


def _undressed(
    scene: Scene,
    meshes: WeldedMeshes,
    pose: OpenedPose,
    found: Found,
    options: IndependentOptions,
) -> Found:
    """Return what is found for a pose of attached parts with its garments free, if that is better.

    found: with garments tied; asked for where something is left, came off, or is strained. Where
    something still came off garments come after the body.
    """

    def rank(own: Found) -> tuple[int, bool, bool]:
        return *_left(scene, pose, own), bool(own.judged.excess)

    if not any(rank(found)):
        return found
    return _best(found, _free_ways(meshes, pose, options), rank, lambda left: not left[1])


def _free_ways(
    meshes: WeldedMeshes, pose: OpenedPose, options: IndependentOptions
) -> Iterator[Found]:
    """Yield what is found for a pose with garments free, and with them after the body."""
    yield from bounded_poses(meshes.scene, meshes, [pose], options, approach=False)
    if meshes.dressed is not None:
        yield from _after_bodies(meshes, meshes.dressed, pose, options)


def _dressed(
    scene: Scene,
    meshes: WeldedMeshes,
    pose: OpenedPose,
    found: Found,
    options: IndependentOptions,
) -> Found:
    """Return what is found for a pose with garments tied to what they lie over, if that is better.

    Where they came off, and where something is left.
    """
    left = _left(scene, pose, found)
    off = left[1] or any(own.kind == StrainKind.WORN for own in found.judged.excess)
    if not (left[0] or off) or meshes.dressed is None:
        return found
    ways = _dressed_ways(meshes, meshes.dressed, pose, options)
    return _best(found, ways, partial(_left, scene, pose), lambda left: not any(left))


def _best(
    found: Found,
    ways: Iterable[Found],
    rank: Callable[[Found], tuple[int, ...]],
    enough: Callable[[tuple[int, ...]], bool],
) -> Found:
    """Return what ranks lowest of what is found and of other ways, asked until it is enough.

    What another way found tells the stages and the time of the first as well.
    """
    start, best, left = time.perf_counter(), found, rank(found)
    for other in ways:
        if (less := rank(other)) < left:
            best, left = other, less
        if enough(left):
            break
    if best is found:
        return found
    solved = replace(best.solved, stages=[*found.solved.stages, *best.solved.stages])
    seconds = found.seconds + time.perf_counter() - start
    return best._replace(solved=solved, seconds=seconds)


def _dressed_ways(
    meshes: WeldedMeshes, tied: WeldedMeshes, pose: OpenedPose, options: IndependentOptions
) -> Iterator[Found]:
    """Yield what is found for a pose with garments tied: after the body, or pushed along with it.

    tied: the meshes in which they are.
    """
    yield from _after_bodies(meshes, tied, pose, options)
    yield from bounded_poses(tied.scene, tied, [pose], options, approach=False)


def _after_bodies(
    meshes: WeldedMeshes, tied: WeldedMeshes, pose: OpenedPose, options: IndependentOptions
) -> Iterator[Found]:
    """Yield what is found for a pose whose garments, tied in some meshes, come after the body."""

    def solve(way: WeldedMeshes, opened: OpenedPose) -> FloatArray:
        return solved_poses(way.scene, way, [opened], options)[0][0]

    led = with_bodies_first(meshes, pose, solve, options=options.bodies_first)
    if led is not None:
        yield bounded_result(tied.scene, tied, pose, led, Solved(led), 0.0, options, approach=False)


def _left(scene: Scene, pose: OpenedPose, found: Found) -> tuple[int, bool]:
    """Return how much is wrong with what is found, and whether something came off."""
    points = found.judged.points
    return wrong_of(scene, pose, points), came_off(scene, pose, points)
