"""Poses of a scene, each for itself: open, lead apart, solve, verify; solved at once on a GPU."""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from dtrepair.intersect.proximity import close_pairs
from dtrepair.numerics.geometry import FloatArray, IntArray, extent
from dtrepair.numerics.metrics import displacements, edge_log_ratio
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.result import RepairResult, Solved
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.results import kept, results_of
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh, WeldedMeshes
from dtrepair.repair.separation.penetration import Shape, find_inside
from dtrepair.repair.separation.release import released
from dtrepair.repair.separation.separation import PART, parted_frames
from dtrepair.repair.separation.untangling import contact_counts, hooked_contacts
from dtrepair.repair.surface.surface import BoolArray

# A body whose edges changed by more (rms of the logarithms of their ratios) is torn.
TORN = 0.1
# What is pressed from so many sides has no way out; sides are bodies nearer than this part of it.
SIDES, PRESSED = 3, 0.01


def poses_at_once(options: RepairOptions, device: str) -> int:
    """How many poses are best solved at once: a GPU has room for many of the published method."""
    if options.method == "full" or device == "cpu":
        return 1
    from dtrepair.repair.paper.gpu_descent import GpuOptions

    return GpuOptions.batch


def repair_poses(
    scene: Scene, meshes: WeldedMeshes, poses: Sequence[Sequence[Any]]
) -> list[list[RepairResult]]:
    """Results of poses (V, 3) of each body, all in one space and length unit.

    ValueError: wrong shapes, numbers that are not finite.
    """
    opened = [detected(scene, gathered(scene, points)) for points in poses]
    start = time.perf_counter()
    wanted = [k for k, pose in enumerate(opened) if pose.wrong or scene.options.clearance > 0.0]
    found = dict(zip(wanted, _solved(scene, meshes, [opened[k] for k in wanted]), strict=True))
    seconds = (time.perf_counter() - start) / max(len(wanted), 1)
    unsolved = [(pose.centred, Solved(pose.centred)) for pose in opened]
    return [
        _closed(scene, pose, *found.get(k, unsolved[k]), seconds if k in found else 0.0)
        for k, pose in enumerate(opened)
    ]


def _solved(
    scene: Scene, meshes: WeldedMeshes, opened: list[OpenedPose]
) -> list[tuple[FloatArray, Solved]]:
    """A pose (V, 3) and how it was found; those of one welded mesh are solved at once."""
    starts = [
        released(scene, pose.centred, pose.caught) if len(pose.caught) else pose.centred
        for pose in opened
    ]
    of_pose = [meshes([pose.weld]) for pose in opened]
    found: dict[int, tuple[FloatArray, Solved]] = {}
    for mesh in {id(mesh): mesh for mesh in of_pose}.values():
        own = [k for k, other in enumerate(of_pose) if other is mesh]
        parted = [
            parted_frames(scene, mesh, starts[k][None], [opened[k].pairs], np.zeros(1))[0]
            for k in own
        ]
        found.update(zip(own, mesh.solve(parted), strict=True))
        for k, start in zip(own, parted, strict=True) if len(scene.bodies) > 1 else ():
            found[k] = _freed(scene, mesh, found[k], start, starts[k], opened[k])
    return [found[k] for k in range(len(opened))]


def _freed(
    scene: Scene,
    mesh: WeldedMesh,
    found: tuple[FloatArray, Solved],
    parted: FloatArray,
    start: FloatArray,
    pose: OpenedPose,
) -> tuple[FloatArray, Solved]:
    """What was found from `parted`; where it is torn or has pairs, with sheets led apart too.

    Bodies that are not concerned, nor meet those that are, stay where they were found.
    """
    judged = _judged(scene, mesh, found[0], start)
    torn = judged.stretched >= TORN
    if torn.any():
        torn &= ~_squeezed(mesh, found[0], torn)
    troubled = {*np.flatnonzero(torn).tolist(), *scene.body_of[judged.pairs].ravel().tolist()}
    if not troubled:
        return found
    met, counts = contact_counts(scene.body_of, pose.pairs)
    still = contact_counts(scene.body_of, pose.pairs if torn.any() else judged.pairs)
    concerned = np.isin(met, list(troubled)).any(axis=1)
    stuck = hooked_contacts([(met[concerned], counts[concerned])], [still])
    # What was torn but came apart is hooked only where next to nothing is inside of the other.
    left = len(judged.pairs) > 0
    hooked = frozenset(both for both in stuck if left or _through(scene, start, *both))
    fresh = [*troubled, *met[concerned].ravel()]
    again = np.isin(scene.body_of_vertex, fresh)
    mixed = np.where(again[:, None], start, found[0])
    pairs = pose.pairs[np.isin(scene.body_of[pose.pairs], fresh).any(axis=1)]
    other = parted_frames(scene, mesh, mixed[None], [pairs], np.zeros(1), troubled, hooked)[0]
    if np.array_equal(other[again], parted[again]):
        return found
    solved = mesh.solve([other])[0]
    return solved if _judged(scene, mesh, solved[0], start).rank < judged.rank else found


def _squeezed(mesh: WeldedMesh, points: FloatArray, torn: BoolArray) -> BoolArray:
    """Which bodies (B,) are pressed from many sides in a pose (V, 3), by the size of the `torn`."""
    surface = mesh.surface
    bodies = [surface.bodies[body] for body in np.flatnonzero(torn)]
    near = PRESSED * min(extent(points[mesh.kept[own.start : own.stop]]) for own in bodies)
    close = close_pairs(surface.detector, points[mesh.kept].astype(np.float32), near)
    sides = contact_counts(surface.body_of, close)[0].ravel()
    return np.bincount(sides, minlength=len(torn)) >= SIDES


def _through(scene: Scene, points: FloatArray, first: int, second: int) -> bool:
    """Whether at most a small part of either body of a pose (V, 3) is inside of the other."""
    one, other = Shape(scene, first), Shape(scene, second)
    inside = find_inside(points, one, other), find_inside(points, other, one)
    return max(found.part for found in inside) < PART


class Judged(NamedTuple):
    """Pairs (K, 2) of a pose; change of the edges, and mean motion, of each body (B,)."""

    pairs: IntArray
    stretched: FloatArray
    moved: FloatArray

    @property
    def rank(self) -> tuple[int, float]:
        """Pairs first, then what the worst body changed and moved: smaller is better."""
        return len(self.pairs), float((self.stretched + self.moved).max())


def _judged(scene: Scene, mesh: WeldedMesh, points: FloatArray, start: FloatArray) -> Judged:
    """A pose (V, 3) beside the one that it started from."""
    surface = mesh.surface
    old, new = start[mesh.kept], points[mesh.kept]
    body_of_edge = surface.body_of_vertex[surface.edges[:, 0]]
    parts = np.split(surface.edges, np.searchsorted(body_of_edge, range(1, len(scene.bodies))))
    own = [slice(*ends) for ends in pairwise(scene.vertex_starts)]
    return Judged(
        scene.pairs(points, scene.weld(points)),
        np.array([edge_log_ratio(old, new, edges) for edges in parts]),
        np.array([displacements(start[part], points[part]).mean() for part in own]),
    )


def _closed(
    scene: Scene, pose: OpenedPose, final: FloatArray, solved: Solved, seconds: float
) -> list[RepairResult]:
    """The results of each body; what is no better than the input leaves it as it was."""
    start = time.perf_counter()
    # Vertices that only happened to coincide in the input are two in the result.
    same = final is pose.centred
    pairs = pose.pairs if same else scene.pairs(final, scene.weld(final))
    found = kept(scene, pose, final, pairs)
    spent = {"detect": pose.seconds, "solve": seconds + time.perf_counter() - start}
    return results_of(scene, pose, found, solved, spent)
