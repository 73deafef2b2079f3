"""Poses of a scene, each for itself: check, solve, verify, report; solved at once on a GPU."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice, pairwise
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from dtrepair.intersect.proximity import close_pairs
from dtrepair.numerics.geometry import FloatArray, IntArray, differing, extent
from dtrepair.numerics.metrics import displacements, edge_log_ratio
from dtrepair.repair.clip.frames import system_of
from dtrepair.repair.options import RepairResult, Solved
from dtrepair.repair.scene.bodies import about_centre
from dtrepair.repair.separation.penetration import Shape, find_inside
from dtrepair.repair.separation.release import caught_parts, released
from dtrepair.repair.separation.separation import PART, parted_frames
from dtrepair.repair.separation.untangling import contact_counts, hooked_contacts
from dtrepair.repair.surface.surface import BoolArray

if TYPE_CHECKING:
    from dtrepair.repair.repairer import SceneRepairer
    from dtrepair.repair.scene.welded_mesh import System

Item = TypeVar("Item")

# A body whose edges changed by more (rms of the logarithms of their ratios) is torn.
TORN = 0.1
# What is pressed from so many sides has no way out; sides are bodies nearer than this part of it.
SIDES, PRESSED = 3, 0.01


class Opened(NamedTuple):
    """A pose before it is solved, in points of all bodies; seconds: what that took."""

    given: Sequence[Any]
    original: FloatArray
    centred: FloatArray
    centre: FloatArray | float
    weld: IntArray
    pairs: IntArray
    caught: IntArray
    seconds: float


def repair_poses(scene: SceneRepairer, poses: Sequence[Sequence[Any]]) -> list[list[RepairResult]]:
    """Results of poses (V, 3) of each body, all in one space and length unit.

    ValueError: wrong shapes, numbers that are not finite.
    """
    opened = [_opened(scene, points) for points in poses]
    start = time.perf_counter()
    wanted = [
        k
        for k, pose in enumerate(opened)
        if len(pose.pairs) + len(pose.caught) or scene.options.clearance > 0.0
    ]
    found = dict(zip(wanted, _solved(scene, [opened[k] for k in wanted]), strict=True))
    seconds = (time.perf_counter() - start) / max(len(wanted), 1)
    unsolved = [(pose.centred, Solved(pose.centred)) for pose in opened]
    return [
        _closed(scene, pose, *found.get(k, unsolved[k]), seconds if k in found else 0.0)
        for k, pose in enumerate(opened)
    ]


def in_batches(items: Iterable[Item], size: int) -> Iterator[list[Item]]:
    """Items in lists of `size`; the last may be shorter."""
    iterator = iter(items)
    while batch := list(islice(iterator, size)):
        yield batch


def _opened(scene: SceneRepairer, points: Sequence[Any]) -> Opened:
    start = time.perf_counter()
    original = scene._gather(points)
    centred, centre = about_centre(original)
    weld = scene._weld(centred)
    pairs = scene._pairs(centred, weld)
    caught = caught_parts(scene, centred, pairs)
    seconds = time.perf_counter() - start
    return Opened(points, original, centred, centre, weld, pairs, caught, seconds)


def _solved(scene: SceneRepairer, opened: list[Opened]) -> list[tuple[FloatArray, Solved]]:
    """A pose (V, 3) and how it was found; those of one system are solved at once."""
    starts = [
        released(scene, pose.centred, pose.caught) if len(pose.caught) else pose.centred
        for pose in opened
    ]
    systems = [system_of(scene, [pose.weld]) for pose in opened]
    found: dict[int, tuple[FloatArray, Solved]] = {}
    for system in {id(system): system for system in systems}.values():
        own = [k for k, other in enumerate(systems) if other is system]
        parted = [
            parted_frames(scene, system, starts[k][None], [opened[k].pairs], np.zeros(1))[0]
            for k in own
        ]
        found.update(zip(own, system.solve(parted), strict=True))
        for k, start in zip(own, parted, strict=True) if len(scene.bodies) > 1 else ():
            found[k] = _freed(scene, system, found[k], start, starts[k], opened[k])
    return [found[k] for k in range(len(opened))]


def _freed(
    scene: SceneRepairer,
    system: System,
    found: tuple[FloatArray, Solved],
    parted: FloatArray,
    start: FloatArray,
    pose: Opened,
) -> tuple[FloatArray, Solved]:
    """What was found from `parted`; where it is torn or has pairs, with sheets led apart too.

    Bodies that are not concerned, nor meet those that are, stay where they were found.
    """
    judged = _judged(scene, system, found[0], start)
    torn = judged.stretched >= TORN
    if torn.any():
        torn &= ~_squeezed(system, found[0], torn)
    troubled = {*np.flatnonzero(torn).tolist(), *scene._body_of[judged.pairs].ravel().tolist()}
    if not troubled:
        return found
    met, counts = contact_counts(scene._body_of, pose.pairs)
    still = contact_counts(scene._body_of, pose.pairs if torn.any() else judged.pairs)
    concerned = np.isin(met, list(troubled)).any(axis=1)
    stuck = hooked_contacts([(met[concerned], counts[concerned])], [still])
    # What was torn but came apart is hooked only where next to nothing is inside of the other.
    left = len(judged.pairs) > 0
    hooked = frozenset(both for both in stuck if left or _through(scene, start, *both))
    fresh = [*troubled, *met[concerned].ravel()]
    again = np.isin(scene.body_of_vertex, fresh)
    mixed = np.where(again[:, None], start, found[0])
    pairs = pose.pairs[np.isin(scene._body_of[pose.pairs], fresh).any(axis=1)]
    other = parted_frames(scene, system, mixed[None], [pairs], np.zeros(1), troubled, hooked)[0]
    if np.array_equal(other[again], parted[again]):
        return found
    solved = system.solve([other])[0]
    return solved if _judged(scene, system, solved[0], start).rank < judged.rank else found


def _squeezed(system: System, points: FloatArray, torn: BoolArray) -> BoolArray:
    """Which bodies (B,) are pressed from many sides in a pose (V, 3), by the size of the `torn`."""
    surface = system.surface
    bodies = [surface.bodies[body] for body in np.flatnonzero(torn)]
    near = PRESSED * min(extent(points[system.kept[own.start : own.stop]]) for own in bodies)
    close = close_pairs(surface.detector, points[system.kept].astype(np.float32), near)
    sides = contact_counts(surface.body_of, close)[0].ravel()
    return np.bincount(sides, minlength=len(torn)) >= SIDES


def _through(scene: SceneRepairer, points: FloatArray, first: int, second: int) -> bool:
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


def _judged(scene: SceneRepairer, system: System, points: FloatArray, start: FloatArray) -> Judged:
    """A pose (V, 3) beside the one that it started from."""
    surface = system.surface
    old, new = start[system.kept], points[system.kept]
    body_of_edge = surface.body_of_vertex[surface.edges[:, 0]]
    parts = np.split(surface.edges, np.searchsorted(body_of_edge, range(1, len(scene.bodies))))
    own = [slice(*ends) for ends in pairwise(scene._vertices)]
    return Judged(
        scene._pairs(points, scene._weld(points)),
        np.array([edge_log_ratio(old, new, edges) for edges in parts]),
        np.array([displacements(start[part], points[part]).mean() for part in own]),
    )


def _closed(
    scene: SceneRepairer, pose: Opened, final: FloatArray, solved: Solved, seconds: float
) -> list[RepairResult]:
    """The results of each body; what is no better than the input leaves it as it was."""
    start = time.perf_counter()
    left, caught = pose.pairs, pose.caught
    if final is not pose.centred:
        # Vertices that only happened to coincide in the input are two in the result.
        left = scene._pairs(final, scene._weld(final))
        caught = caught_parts(scene, final, left) if len(caught) else caught
        before, after = len(pose.pairs) + len(pose.caught), len(left) + len(caught)
        if after > before or after == before > 0:
            final, left, caught = pose.centred, pose.pairs, pose.caught
    moved = differing(final, pose.centred)
    repaired = np.where(moved[:, None], final.astype(np.float32) + pose.centre, pose.original)
    spent = {"detect": pose.seconds, "solve": seconds + time.perf_counter() - start}
    return [
        scene._result(
            index,
            pose.given[index],
            pose.original,
            repaired,
            pose.pairs,
            left,
            solved,
            spent,
            caught,
        )
        for index in range(len(scene.bodies))
    ]
