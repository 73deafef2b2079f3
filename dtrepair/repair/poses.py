"""Poses of a scene, each for itself: check, solve, verify, report; solved at once on a GPU."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from dtrepair.geometry import FloatArray, IntArray, differing
from dtrepair.metrics import displacements, edge_log_ratio
from dtrepair.repair.bodies import about_centre
from dtrepair.repair.frames import system_of
from dtrepair.repair.options import RepairResult, Solved
from dtrepair.repair.parting import parted_frames
from dtrepair.repair.release import caught_parts, released
from dtrepair.repair.unhooking import contact_counts, hooked_contacts

if TYPE_CHECKING:
    from dtrepair.repair.repairer import SceneRepairer
    from dtrepair.repair.system import System

Item = TypeVar("Item")

# A body whose edges changed by more (rms of the logarithms of their ratios) is torn.
TORN = 0.1


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
    """What was found from `parted`; where it is torn or has pairs, with sheets led apart too."""
    left, stretched, cost = _rank(scene, system, found[0], start)
    if left == 0 and stretched < TORN:
        return found
    met, still = contact_counts(scene._body_of, pose.pairs), pose.pairs
    if stretched < TORN:
        still = scene._pairs(found[0], scene._weld(found[0]))
    hooked = hooked_contacts([met], [contact_counts(scene._body_of, still)])
    times = np.zeros(1)
    other = parted_frames(scene, system, start[None], [pose.pairs], times, True, hooked)[0]
    if np.array_equal(other, parted):
        return found
    again = system.solve([other])[0]
    fewer, _, cheaper = _rank(scene, system, again[0], start)
    return again if (fewer, cheaper) < (left, cost) else found


def _rank(
    scene: SceneRepairer, system: System, points: FloatArray, start: FloatArray
) -> tuple[int, float, float]:
    """Pairs of a pose (V, 3), the change of the edges of any body, and that plus its mean motion.

    Of the bodies the worst one.
    """
    surface = system.surface
    stretched, cost = 0.0, 0.0
    for body in range(len(scene.bodies)):
        own = slice(*scene._vertices[body : body + 2])
        edges = surface.edges[surface.body_of_vertex[surface.edges[:, 0]] == body]
        change = edge_log_ratio(start[system.kept], points[system.kept], edges)
        stretched = max(stretched, change)
        cost = max(cost, change + float(displacements(start[own], points[own]).mean()))
    return len(scene._pairs(points, scene._weld(points))), stretched, cost


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
