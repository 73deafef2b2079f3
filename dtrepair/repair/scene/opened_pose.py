"""A pose of a scene before it is solved: gathered, centred, welded, and its contacts found."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray, extent, triangle_frames
from dtrepair.repair.scene.attached_parts import attached_bodies
from dtrepair.repair.scene.bodies import Absent, about_centre
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.surface.rigid_bodies import RigidBodies

BoolArray = NDArray[np.bool_]
# Up to so many times as many triangles, and so many more, may intersect where fewer pairs do.
SPREAD, FEW = 1.1, 10


def _none() -> IntArray:
    return np.zeros((0, 2), dtype=np.int32)


@dataclass(frozen=True, eq=False, kw_only=True)
class OpenedPose:
    """A pose of all bodies.

    Args:
        given: The points of each body as they came.
        original: These points (V, 3) in one array.
        centred: The same about the origin, where they are far from it; once there are contacts,
            with splits closed that only rounding opened.
        centre: What was taken off them (3,).
        weld: Vertices (V,) that count as one.
        sewn: The same across the closed seams of bodies, which are solved as one skin.
        detected: Whether the contacts are known.
        first_pairs: The intersecting pairs (K, 2) that count, of the points as they came.
        pairs: The same of `centred`.
        enclosed: Parts (K, 2) wholly inside others.
        seconds: What it took to find them.
        absent: Vertices (V,) of bodies that are not there; None: all are.
        begun: The pose from which it is solved; None: itself.
    """

    given: Sequence[Any]
    original: FloatArray
    centred: FloatArray
    centre: FloatArray | float
    weld: IntArray
    sewn: IntArray
    detected: bool = False
    first_pairs: IntArray = field(default_factory=_none)
    pairs: IntArray = field(default_factory=_none)
    enclosed: IntArray = field(default_factory=_none)
    seconds: float = 0.0
    absent: BoolArray | None = None
    begun: Self | None = None

    @property
    def wrong(self) -> int:
        """How many pairs, and parts inside others, there are to be repaired."""
        return len(self.pairs) + len(self.enclosed)

    def wrong_with(self, pairs: IntArray, enclosed: int) -> int:
        """Return how much is wrong with a correction of it: its pairs (K, 2), parts inside others.

        More than with the pose itself where clearly more triangles intersect: what comes out
        through its clothes may do so in fewer pairs than what was in them by a little.
        """
        left, few = len(pairs) + enclosed, FEW + SPREAD * len(np.unique(self.pairs))
        more = len(np.unique(pairs)) - int(few)
        # A part that was led out of another may meet it in a few triangles yet.
        return left if more <= 0 or enclosed < len(self.enclosed) else max(left, self.wrong + more)


Pose = TypeVar("Pose", bound=OpenedPose)


def gathered(scene: Scene, points: Sequence[Any]) -> OpenedPose:
    """Return points (V, 3) of each body as a pose; ValueError for wrong shapes or numbers."""
    original, absent = scene.gather(points), None
    hidden = [body for body, own in enumerate(points) if isinstance(own, Absent)]
    if hidden:
        absent = np.isin(scene.body_of_vertex, hidden)
        unplaced = [body for body in hidden if not points[body].placed]
        original = _out_of_the_way(scene, original, absent, unplaced)
    centred, centre = about_centre(original)
    weld = scene.weld(centred)
    return OpenedPose(
        given=points,
        original=original,
        centred=centred,
        centre=centre,
        weld=weld,
        sewn=scene.sewn(centred, weld),
        absent=absent,
    )


def _out_of_the_way(
    scene: Scene, points: FloatArray, absent: BoolArray, unplaced: Sequence[int]
) -> FloatArray:
    """Return a pose (V, 3) with absent bodies beside all others, and beside each other.

    What is attached to others stays where it would be: they hold on to it in all poses. Of bodies
    that are unplaced they say where that is.
    """
    moved, there = points.copy(), ~absent
    beside = points[there].max(axis=0)[0] if there.any() else 0.0
    held = attached_bodies(scene.attachments, scene.body_of, scene.body_of_vertex)
    for body in np.unique(scene.body_of_vertex[absent]).tolist():
        own = scene.vertices_of(body)
        if body in held:
            if body in unplaced:
                moved[own] = _where_held(scene, points, body)
            continue
        beside += extent(points[own])
        moved[own] += [beside - points[own].min(axis=0)[0], 0.0, 0.0]
        beside = moved[own].max(axis=0)[0]
    return moved


def _where_held(scene: Scene, points: FloatArray, body: int) -> FloatArray:
    """Return a body (V, 3), moved as a whole to where the others of a pose hold it."""
    assert scene.attachments is not None
    ties, own = scene.attachments.every_tie, scene.vertices_of(body)
    outwards = (scene.body_of_vertex[ties.vertices] == body) & (
        scene.body_of[ties.triangles] != body
    )
    ties = ties.among(outwards)
    corners = points[scene.faces[ties.triangles]]
    places = np.einsum("nk,nkj->nj", ties.weights, corners)
    places += np.einsum("nij,nj->ni", triangle_frames(corners), ties.offsets)
    target, weights = points.copy(), np.zeros(len(points))
    target[ties.vertices], weights[ties.vertices] = places, 1.0
    if not len(places):
        return points[own]
    whole = RigidBodies([(own.start, own.stop)], weights)
    return np.asarray(whole.fitted(points, target)[own])


def detected(scene: Scene, pose: Pose) -> Pose:
    """Return the pose with its contacts; as it is where they are known."""
    if pose.detected:
        return pose
    start = time.perf_counter()
    first = pairs = scene.pairs(pose.centred, pose.weld)
    if not np.array_equal(pose.sewn, pose.weld):
        # What is solved as one point cannot be led apart, nor be counted as two in a clean pose
        # that eases in.
        centred = _closed(scene, pose)
        closed = replace(pose, centred=centred, weld=scene.weld(centred))
        left = scene.pairs(centred, closed.weld)
        if len(pairs) or not len(left):
            pose, pairs = closed, left
    enclosed = scene.enclosed_parts(pose.centred, pairs)
    seconds = time.perf_counter() - start
    return replace(
        pose, detected=True, first_pairs=first, pairs=pairs, enclosed=enclosed, seconds=seconds
    )


def _closed(scene: Scene, pose: OpenedPose) -> FloatArray:
    """Return the pose (V, 3) with splits closed: where something is fixed, there."""
    fixed = np.flatnonzero(scene.mobility == 0.0)
    stands = np.arange(len(pose.sewn))
    stands[pose.sewn[fixed]] = fixed
    closed = pose.centred[stands[pose.sewn]]
    closed[fixed] = pose.centred[fixed]
    return closed
