"""Poses of a scene by the meshes of one way, each for itself: led apart, solved, bounded."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.frame.turned_poses import turned_back
from dtrepair.repair.independent_options import IndependentOptions
from dtrepair.repair.relief.approach import bounded_approach
from dtrepair.repair.relief.relief import relieved_poses
from dtrepair.repair.result import Solved
from dtrepair.repair.scene.bounds import Bounded, Judged, PairsOf, bounded_pose
from dtrepair.repair.scene.mending import mended
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh, WeldedMeshes
from dtrepair.repair.separation.lifting import lifted_frames, not_worn, parts_that_meet
from dtrepair.repair.separation.release import released
from dtrepair.repair.separation.sunken import raised_frames
from dtrepair.repair.torn_poses import LedPose


class Found(NamedTuple):
    """What was found for a pose, its pairs (K, 2), and how and in what time it was found.

    way: the meshes of the way on which it was found.
    """

    judged: Judged
    pairs: IntArray
    solved: Solved
    seconds: float
    way: WeldedMeshes | None = None


def bounded_poses(
    scene: Scene,
    meshes: WeldedMeshes,
    opened: Sequence[OpenedPose],
    options: IndependentOptions,
    *,
    approach: bool = True,
) -> list[Found]:
    """Return what is found for poses by the meshes of one way, within the bounds.

    approach: whether what is left is led in from the rest; else see `approached`.
    """
    start = time.perf_counter()
    wanted = [k for k, pose in enumerate(opened) if pose.wrong]
    solved = solved_poses(scene, meshes, [opened[k] for k in wanted], options)
    found = dict(zip(wanted, solved, strict=True))
    seconds = (time.perf_counter() - start) / max(len(wanted), 1)
    unsolved = [(pose.centred, Solved(pose.centred)) for pose in opened]
    spent = [seconds if k in found else 0.0 for k in range(len(opened))]
    return [
        bounded_result(
            scene, meshes, pose, *found.get(k, unsolved[k]), spent[k], options, approach=approach
        )
        for k, pose in enumerate(opened)
    ]


def solved_poses(
    scene: Scene, meshes: WeldedMeshes, opened: list[OpenedPose], options: IndependentOptions
) -> list[tuple[FloatArray, Solved]]:
    """Return a pose (V, 3) and how it was found; those of one welded mesh are solved at once."""
    opened = [pose.begun or pose for pose in opened]
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
    points = solved_poses(scene, meshes, [opened], options)[0][0]
    pairs_of = partial(scene.pairs, weld=opened.weld)
    found = bounded_pose(
        scene, opened, Judged(points), pairs_of(points), pairs_of, options=options.share
    )
    better = _last_resorts(scene, meshes([opened.sewn]), opened, found, pairs_of, options)
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


def result_pairs(scene: Scene, points: FloatArray) -> IntArray:
    """Return the pairs (K, 2) of a result (V, 3), in which each vertex stands for itself.

    What only happened to coincide in the input are two in the result.
    """
    return scene.pairs(points, scene.weld(points))


def bounded_result(
    scene: Scene,
    meshes: WeldedMeshes,
    pose: OpenedPose,
    final: FloatArray,
    solved: Solved,
    seconds: float,
    options: IndependentOptions,
    *,
    approach: bool = True,
) -> Found:
    """Return what was found for a pose, `final` (V, 3), within the bounds.

    seconds: what it took so far; approach: see `bounded_poses`.
    """
    start, found = time.perf_counter(), (Judged(final), pose.pairs)
    if final is not pose.centred:
        mesh, pairs_of = meshes([pose.sewn]), partial(result_pairs, scene)
        found = _kept(scene, mesh, pose, final, pairs_of, options)
        if approach:
            found = _last_resorts(scene, mesh, pose, found, pairs_of, options)
    found = _mended(scene, meshes, pose, found, options)
    return Found(*found, solved, seconds + time.perf_counter() - start, meshes)


def _kept(
    scene: Scene,
    mesh: WeldedMesh,
    pose: OpenedPose,
    points: FloatArray,
    pairs_of: PairsOf,
    options: IndependentOptions,
) -> Bounded:
    """Return what is kept within the bounds of a solution (V, 3)."""
    (eased,) = relieved_poses(scene, mesh, [pose], [points], options=options.relief)
    pairs = pairs_of(eased)
    return bounded_pose(scene, pose, Judged(eased), pairs, pairs_of, options=options.share)


def _last_resorts(
    scene: Scene,
    mesh: WeldedMesh,
    pose: OpenedPose,
    found: Bounded,
    pairs_of: PairsOf,
    options: IndependentOptions,
) -> Bounded:
    """Return what is kept of a pose, or of one that is pushed otherwise, or led in, if better."""

    def bounded(points: FloatArray) -> Bounded:
        return _kept(scene, mesh, pose, points, pairs_of, options)

    numbers = options.full, options.turned
    found = turned_back(scene, mesh, pose, found, bounded, *numbers)
    return bounded_approach(scene, mesh, pose, found, pairs_of, options=options.approach)


def approached(pose: OpenedPose, found: Found, options: IndependentOptions) -> Found:
    """Return what is found for a pose that is led in from the rest, if that is better.

    found: the best of several ways: the last resort is long, and asked for on one of them only.
    """
    if found.judged.points is pose.centred and not pose.wrong:
        return found
    assert found.way is not None
    start, scene, mesh = time.perf_counter(), found.way.scene, found.way([pose.sewn])
    known, pairs_of = (found.judged, found.pairs), partial(result_pairs, scene)
    better = _last_resorts(scene, mesh, pose, known, pairs_of, options)
    if better is not known:
        better = _mended(scene, found.way, pose, better, options)
    spent = found.seconds + time.perf_counter() - start
    return Found(*better, found.solved, spent, found.way)


def _mended(
    scene: Scene,
    meshes: WeldedMeshes,
    pose: OpenedPose,
    found: tuple[Judged, IntArray],
    options: IndependentOptions,
) -> tuple[Judged, IntArray]:
    """Return what is found within the bounds, mended where only a share of it is kept."""
    if not found[0].lowered:
        return found
    return mended(
        scene,
        meshes([pose.sewn]),
        pose.centred,
        *found,
        partial(result_pairs, scene),
        step=options.mend_step,
        options=options.mend,
    )
