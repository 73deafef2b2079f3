"""Poses of a scene, each for itself: open, lead apart, solve, verify; solved at once on a GPU."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.independent_options import IndependentOptions
from dtrepair.repair.relief.approach import bounded_approach
from dtrepair.repair.relief.bodies_first import with_bodies_first
from dtrepair.repair.relief.followers import with_followers
from dtrepair.repair.relief.opening import opened_frames, own_rest, too_close
from dtrepair.repair.relief.relief import relieved_poses
from dtrepair.repair.result import RepairResult, Solved, Stage
from dtrepair.repair.scene.bounds import Judged, bounded_pose, came_off, wrong_of
from dtrepair.repair.scene.holding import is_tied
from dtrepair.repair.scene.mending import mended
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.results import kept, results_of
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from dtrepair.repair.separation.groups import faulty_bodies, groups_meet, groups_of_bodies
from dtrepair.repair.separation.lifting import lifted_frames, not_worn, parts_that_meet
from dtrepair.repair.separation.release import released
from dtrepair.repair.separation.sunken import raised_frames
from dtrepair.repair.torn_poses import LedPose


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
        judged, pairs, solved, seconds = found[k]
        (led,) = with_followers(scene, [pose], [judged], np.zeros(1), options=options.followers)
        if led is not judged:
            judged, pairs = led, _pairs_of(scene, led.points)
        spent = {"detect": pose.seconds, "solve": seconds}
        result = kept(scene, pose, judged.points, pairs)
        results.append(results_of(scene, pose, result, solved, spent, judged))
    return results


class _Found(NamedTuple):
    """What was found for a pose, its pairs (K, 2), and how and in what time it was found."""

    judged: Judged
    pairs: IntArray
    solved: Solved
    seconds: float


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
) -> _Found:
    """Return what is found for groups of bodies; for all at once, if they would meet."""
    judged, solved, seconds = Judged(pose.centred), Solved(pose.centred), 0.0
    faulty = faulty_bodies(scene, [pose])
    for bodies in groups:
        # With a clearance a pose without pairs may have to move as well.
        if scene.options.clearance == 0.0 and faulty.isdisjoint(bodies):
            continue
        parts, own = meshes.of_bodies(bodies)
        (found,) = _found(parts.scene, own, [parts.opened(pose)], options)
        judged = parts.joined(judged, found.judged)
        stages, left = [*solved.stages, *found.solved.stages], solved.left + found.solved.left
        solved, seconds = Solved(pose.centred, stages, left), seconds + found.seconds
    if groups_meet(scene, groups, [judged.points]):
        return _found(scene, meshes, [pose], options)[0]
    return _Found(judged, _pairs_of(scene, judged.points), solved, seconds)


def _found(
    scene: Scene, meshes: WeldedMeshes, opened: Sequence[OpenedPose], options: IndependentOptions
) -> list[_Found]:
    """Return what is found for poses: without the clearance, and opened then."""
    plain = meshes.without_clearance
    found = _found_so(plain.scene, plain, opened, options)
    if scene.options.clearance == 0.0:
        return found
    both = zip(opened, found, strict=True)
    return [_opened(scene, meshes, pose, own, options) for pose, own in both]


def _opened(
    scene: Scene, meshes: WeldedMeshes, pose: OpenedPose, found: _Found, options: IndependentOptions
) -> _Found:
    """Return what is found for a pose with its contacts apart by the clearance."""
    start, mesh = time.perf_counter(), meshes([pose.sewn])
    known, numbers = [found.judged], options.opening
    (judged,) = opened_frames(scene, mesh, [pose], known, np.zeros(1), options=numbers)
    left = too_close(mesh, judged.points, facing=own_rest(mesh, [pose]))
    pairs = _pairs_of(scene, judged.points)
    spent = time.perf_counter() - start
    stages = [*found.solved.stages, Stage("open", len(pairs), 0, 0.0, 0, spent)]
    solved = replace(found.solved, stages=stages, left=left)
    return _Found(judged, pairs, solved, found.seconds + spent)


def _found_so(
    scene: Scene, meshes: WeldedMeshes, opened: Sequence[OpenedPose], options: IndependentOptions
) -> list[_Found]:
    """Return what is found for poses; attached parts take their garments along first."""
    dressed = meshes.dressed if is_tied(scene) else None
    first, otherwise = (meshes, _dressed) if dressed is None else (dressed, _undressed)
    both = zip(opened, _bounded_poses(first.scene, first, opened, options), strict=True)
    return [otherwise(scene, meshes, pose, found, options) for pose, found in both]


def _bounded_poses(
    scene: Scene, meshes: WeldedMeshes, opened: Sequence[OpenedPose], options: IndependentOptions
) -> list[_Found]:
    """Return what is found for poses by the meshes of one way, within the bounds."""
    start = time.perf_counter()
    wanted = [k for k, pose in enumerate(opened) if pose.wrong]
    solved = _solved(scene, meshes, [opened[k] for k in wanted], options)
    found = dict(zip(wanted, solved, strict=True))
    seconds = (time.perf_counter() - start) / max(len(wanted), 1)
    unsolved = [(pose.centred, Solved(pose.centred)) for pose in opened]
    return [
        _bounded(
            scene, meshes, pose, *found.get(k, unsolved[k]), seconds if k in found else 0.0, options
        )
        for k, pose in enumerate(opened)
    ]


def _undressed(
    scene: Scene,
    meshes: WeldedMeshes,
    pose: OpenedPose,
    found: _Found,
    options: IndependentOptions,
) -> _Found:
    """Return what is found for a pose of attached parts with its garments free, if that is better.

    found: with garments tied; asked for where something is left, came off, or is kept in part only.
    """
    left, start = (*_left(scene, pose, found), found.judged.lowered), time.perf_counter()
    if any(left):
        (other,) = _bounded_poses(scene, meshes, [pose], options)
        if (*_left(scene, pose, other), other.judged.lowered) < left:
            return _after(found, other, start)
    return found


def _dressed(
    scene: Scene,
    meshes: WeldedMeshes,
    pose: OpenedPose,
    found: _Found,
    options: IndependentOptions,
) -> _Found:
    """Return what is found for a pose with garments tied to what they lie over, if that is better.

    Where they came off, and where something is left.
    """
    left = _left(scene, pose, found)
    off = left[1] or any(own.kind == StrainKind.WORN for own in found.judged.excess)
    if not (left[0] or off) or meshes.dressed is None:
        return found
    start, best = time.perf_counter(), found
    for other in _dressed_ways(meshes, meshes.dressed, pose, options):
        less = _left(scene, pose, other)
        if less < left:
            best, left = other, less
        if not any(left):
            break
    return found if best is found else _after(found, best, start)


def _after(first: _Found, other: _Found, start: float) -> _Found:
    """Return what another way found from a `start` on, with what the first took as well."""
    solved = replace(other.solved, stages=[*first.solved.stages, *other.solved.stages])
    seconds = first.seconds + time.perf_counter() - start
    return other._replace(solved=solved, seconds=seconds)


def _dressed_ways(
    meshes: WeldedMeshes, tied: WeldedMeshes, pose: OpenedPose, options: IndependentOptions
) -> Iterator[_Found]:
    """Yield what is found for a pose with garments tied: after the body, or pushed along with it.

    tied: the meshes in which they are.
    """

    def solve(way: WeldedMeshes, opened: OpenedPose) -> FloatArray:
        return _solved(way.scene, way, [opened], options)[0][0]

    led = with_bodies_first(meshes, pose, solve, options=options.bodies_first)
    if led is not None:
        yield _bounded(tied.scene, tied, pose, led, Solved(led), 0.0, options)
    yield from _found(tied.scene, tied, [pose], options)


def _left(scene: Scene, pose: OpenedPose, found: _Found) -> tuple[int, bool]:
    """Return how much is wrong with what is found, and whether something came off."""
    points = found.judged.points
    return wrong_of(scene, pose, points), came_off(scene, pose, points)


def _solved(
    scene: Scene, meshes: WeldedMeshes, opened: list[OpenedPose], options: IndependentOptions
) -> list[tuple[FloatArray, Solved]]:
    """Return a pose (V, 3) and how it was found; those of one welded mesh are solved at once."""
    starts = [_start(scene, pose, options) for pose in opened]
    of_pose = [meshes([pose.sewn]) for pose in opened]
    found: dict[int, tuple[FloatArray, Solved]] = {}
    for mesh in {id(mesh): mesh for mesh in of_pose}.values():
        own = [k for k, other in enumerate(of_pose) if other is mesh]
        numbers = options.separation, options.torn
        poses = [LedPose(scene, mesh, opened[k], starts[k], *numbers) for k in own]
        separated = [pose.separated(pose.start, pose.opened.pairs) for pose in poses]
        for pose, k, led, solved in zip(poses, own, separated, mesh.solve(separated), strict=True):
            found[k] = solved if len(scene.bodies) == 1 else pose.improved(solved, led)
    return [found[k] for k in range(len(opened))]


def solved_pose(
    scene: Scene, meshes: WeldedMeshes, opened: OpenedPose, *, options: IndependentOptions
) -> FloatArray:
    """Return what is found (V, 3) for a pose on its own; it may be strained."""
    points = _solved(scene, meshes, [opened], options)[0][0]
    pairs_of = partial(scene.pairs, weld=opened.weld)
    found = bounded_pose(
        scene, opened, Judged(points), pairs_of(points), pairs_of, options=options.share
    )
    mesh, numbers = meshes([opened.sewn]), options.approach
    better = bounded_approach(scene, mesh, opened, found, pairs_of, options=numbers)
    return points if better is found else better[0].points


def _start(scene: Scene, pose: OpenedPose, options: IndependentOptions) -> FloatArray:
    """Return a pose (V, 3) with its enclosed and sunken parts led out, and its layers lifted."""
    start = pose.centred
    if len(pose.enclosed):
        start = released(scene, start, not_worn(scene, pose.enclosed), options=options.release)
    met, one = parts_that_meet(scene, pose.pairs, pose.enclosed), np.zeros(1)
    frames = raised_frames(scene, start[None], [pose.pairs], one, options=options.sunken)
    lifted: FloatArray = lifted_frames(scene, frames, [met], one, options=options.lift)[0]
    return lifted


def _pairs_of(scene: Scene, points: FloatArray) -> IntArray:
    """Return the pairs (K, 2) of a result (V, 3), in which each vertex stands for itself.

    What only happened to coincide in the input are two in the result.
    """
    return scene.pairs(points, scene.weld(points))


def _bounded(
    scene: Scene,
    meshes: WeldedMeshes,
    pose: OpenedPose,
    final: FloatArray,
    solved: Solved,
    seconds: float,
    options: IndependentOptions,
) -> _Found:
    """Return what was found for a pose, `final` (V, 3), within the bounds.

    seconds: what it took so far.
    """
    start, pairs_of = time.perf_counter(), partial(_pairs_of, scene)
    if final is pose.centred:
        judged, pairs = bounded_pose(
            scene, pose, Judged(final), pose.pairs, pairs_of, options=options.share
        )
    else:
        mesh = meshes([pose.sewn])
        (final,) = relieved_poses(scene, mesh, [pose], [final], options=options.relief)
        bounded = bounded_pose(
            scene, pose, Judged(final), pairs_of(final), pairs_of, options=options.share
        )
        numbers = options.approach
        judged, pairs = bounded_approach(scene, mesh, pose, bounded, pairs_of, options=numbers)
    if judged.lowered:
        judged, pairs = mended(
            scene,
            meshes([pose.sewn]),
            pose.centred,
            judged,
            pairs,
            pairs_of,
            step=options.mend_step,
            options=options.mend,
        )
    return _Found(judged, pairs, solved, seconds + time.perf_counter() - start)
