"""Small loose things go along with what they follow in the input: a collar with its neck.

Nothing holds them, and nothing touches them, so that solving leaves them where they are: a head
that is pushed aside would leave its glasses behind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.attached.riders import RiderOptions, riders
from dtrepair.numerics.attachments import NO_TIES, Ties
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    extent,
    extents,
    lengths,
    triangle_areas,
)
from dtrepair.numerics.temporal import eased_in_time
from dtrepair.repair.relief.wholes import rigid_motion_of
from dtrepair.repair.scene.bounds import Judged, wrong_of_groups
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class FollowerOptions:
    """How loose things go along.

    Args:
        riders: What counts as following.
        stirs: A thing moves by so many of its own extents in the frames: what stands still tells
            nothing.
        looks: So many frames tell what follows what, at most.
        wide: A thing is turned where what it follows is so wide at least, next to it, both ways.
        faint: Motions below this are left, units of the size; up to twice this they fade in.
        width: Standard deviation, in frames, over which what does not may come and go.
        tries: What would bring contacts stays behind: so often that is looked for.
    """

    riders: RiderOptions = field(default_factory=lambda: RiderOptions(near=1.0, hosts=64))
    stirs: float = 0.02
    looks: int = 9
    wide: float = 0.1
    faint: float = 1e-4
    width: float = 2.0
    tries: int = 4


def with_followers(
    scene: Scene,
    frames: Sequence[OpenedPose],
    judged: list[Judged],
    times: FloatArray,
    *,
    options: FollowerOptions = FollowerOptions(),
) -> list[Judged]:
    """Return what was found for frames, with loose things where those that they follow lead them.

    Only what meets nothing in these frames, and where no contact comes of it; smoothly in time. Of
    several frames these tell what follows what, of a single one the rest and that.

    Args:
        scene: The bodies.
        frames: The input.
        judged: What was found for it.
        times: Of the frames (T,), in frame units.
        options: The numbers.
    """
    limited = scene.options.maximum_displacement is not None or scene.options.clearance > 0.0
    # What is limited or keeps a clearance could do so no longer.
    if limited or scene.options.method != "full" or scene.enclosures.count < 2:
        return judged
    both = zip(frames, judged, strict=True)
    if all(np.array_equal(frame.centred, own.points) for frame, own in both):
        return judged
    things = _Things(scene, frames, options)
    if not things.chosen:
        return judged
    left: dict[int, IntArray] = {}
    needed = np.zeros((len(frames), len(things.chosen)))
    for _ in range(options.tries):
        kept, result, worse = eased_in_time(needed, times, options.width), list(judged), False
        for k, (frame, own) in enumerate(zip(frames, judged, strict=True)):
            points = things.led(frame.centred, own.points, kept[k])
            if points is own.points:
                continue
            if k not in left:
                left[k] = things.wrong(frame, own.points)
            more = things.wrong(frame, points) > left[k]
            needed[k, more], worse = 1.0, worse or bool(more.any())
            result[k] = own._replace(points=points)
        if not worse:
            return result
    return judged


class _Things:
    """The loose things of a scene that follow others in some frames, the largest first.

    A thing is a part, what is attached to each other, or a rigid body.

    Args:
        scene: The bodies.
        frames: The input.
        options: The numbers.
    """

    def __init__(
        self, scene: Scene, frames: Sequence[OpenedPose], options: FollowerOptions
    ) -> None:
        self.scene, self.options = scene, options
        own = scene.enclosures
        self._thing_of_part = _things_of_parts(scene)
        # Duplicates along seams are of the thing as well.
        part = own.part[scene.rest_weld]
        self._of_vertex = np.where(part >= 0, self._thing_of_part[part], -1)
        ties, areas = self._ties(frames)
        of_tie = self._of_vertex[ties.vertices]
        order = np.argsort(-areas, kind="stable")
        self.chosen: list[int] = order[np.isin(order, of_tie)].tolist()
        self._faint = options.faint * scene.scale.extent(frames[0].centred)
        self._vertices = [np.flatnonzero(self._of_vertex == thing) for thing in self.chosen]
        self._feet = [
            np.unique(own.faces[ties.triangles[of_tie == thing]]) for thing in self.chosen
        ]

    def led(self, before: FloatArray, found: FloatArray, kept: FloatArray) -> FloatArray:
        """Return a pose (V, 3) in which each thing keeps a share (P,) of where it was found.

        before: the pose of the input. What is found is handed back where nothing follows.
        """
        result = found
        for own, feet, keeps in zip(self._vertices, self._feet, kept.tolist(), strict=True):
            if np.array_equal(before[feet], result[feet]):
                continue
            move = self._place(before, result, own, feet) - result[own]
            far = float(lengths(move).max())
            share = min(max(far / self._faint - 1.0, 0.0), 1.0) * (1.0 - keeps)
            if share > 0.0:
                result = result.copy() if result is found else result
                result[own] += share * move
        if result is found:
            return found
        # A share of a turn would shrink what is rigid.
        fitted: FloatArray = self.scene.rigid.fitted(before, result)
        return fitted

    def _place(
        self, before: FloatArray, after: FloatArray, own: NDArray[np.intp], feet: IntArray
    ) -> FloatArray:
        """Return where its feet lead a thing: turned with them where they are wide enough."""
        old, new = before[feet], after[feet]
        spread = np.linalg.svd(old - old.mean(axis=0), compute_uv=False) / np.sqrt(len(feet))
        if len(feet) < 3 or spread[1] < self.options.wide * extent(before[own]):
            shifted: FloatArray = before[own] + (new - old).mean(axis=0)
            return shifted
        turn, shift = rigid_motion_of(old, new)
        return np.asarray(before[own] @ turn.T + shift)

    def wrong(self, frame: OpenedPose, points: FloatArray) -> IntArray:
        """Return how much is wrong with each thing (P,) in a pose (V, 3) of a frame."""
        counts = wrong_of_groups(self.scene, frame, points, self._thing_of_part)
        return counts[self.chosen]

    def _ties(self, frames: Sequence[OpenedPose]) -> tuple[Ties, FloatArray]:
        """Return what loose things follow, and the area (P,) of each thing."""
        scene, options, own = self.scene, self.options, self.scene.enclosures
        count = len(self._thing_of_part)
        some = np.linspace(0, len(frames) - 1, min(options.looks, len(frames))).astype(int)
        poses = [frames[k].centred for k in some]
        alone = len(poses) == 1
        free = _loose(scene, frames, self._thing_of_part, self._of_vertex)
        if not alone:
            originals = [frames[k].original for k in some]
            free &= _stirs(originals, self._of_vertex, count, options.stirs)
        hosts = np.zeros(count, dtype=bool)
        hosts[self._of_vertex[(self._of_vertex >= 0) & (scene.mobility > 0.0)]] = True
        every = [scene.centred_rest, *poses] if alone else poses
        of_face = self._thing_of_part[own.part_of_face]
        face_areas = triangle_areas(scene.centred_rest, own.faces)
        areas = np.bincount(of_face, face_areas, count).astype(np.float64)
        if not free.any():
            return NO_TIES, areas
        return riders(every, own.faces, of_face, free, hosts, options=options.riders), areas


def _things_of_parts(scene: Scene) -> IntArray:
    """Return the thing of each part (P,): the first part of what is attached, or moves as one."""
    own = scene.enclosures
    pairs = [np.array(scene.attached_parts.pairs, dtype=np.int64).reshape(-1, 2)]
    if (known := scene.attachments) is not None:
        ties = known.every_tie
        tied = [own.part[scene.rest_weld[ties.vertices]], own.part_of_face[ties.triangles]]
        pairs.append(np.stack(tied, axis=1))
    for body, parts in enumerate(_parts_of_bodies(scene)):
        if scene.is_stiff(body) and len(parts) > 1:
            pairs.append(np.stack([np.full(len(parts), parts[0]), parts], axis=1))
    links = np.concatenate(pairs)
    graph = sparse.coo_matrix((np.ones(len(links)), links.T), shape=(own.count, own.count))
    label = csgraph.connected_components(graph, directed=False)[1]
    first = np.unique(label, return_index=True)[1]
    return np.asarray(first[label], dtype=np.int32)


def _parts_of_bodies(scene: Scene) -> list[NDArray[np.intp]]:
    """Return the parts of each body."""
    return [np.flatnonzero(scene.body_of_part == body) for body in range(len(scene.bodies))]


def _loose(
    scene: Scene, frames: Sequence[OpenedPose], thing_of_part: IntArray, of_vertex: IntArray
) -> BoolArray:
    """Return which things (P,) meet no other in any of the frames, and may move freely.

    None that lies over others as cloth does.
    """
    own, free = scene.enclosures, np.zeros(len(thing_of_part), dtype=bool)
    free[thing_of_part] = True
    used = of_vertex >= 0
    free[of_vertex[used & (scene.mobility < 1.0)]] = False
    for frame in frames:
        met = thing_of_part[own.part_of_face[frame.pairs]].reshape(-1, 2)
        free[met[met[:, 0] != met[:, 1]]] = False
        free[thing_of_part[frame.enclosed]] = False
    if scene.covering is not None:
        over: BoolArray = np.asarray(scene.covering.over.any(axis=1))
        free[of_vertex[used & over[scene.covering.part]]] = False
    return free


def _stirs(poses: Sequence[FloatArray], of_vertex: IntArray, count: int, least: float) -> BoolArray:
    """Return which things (P,) move by so many of their own extents between poses (V, 3)."""
    used = of_vertex >= 0
    own, far = of_vertex[used], np.zeros(count)
    for pose in poses[1:]:
        np.maximum.at(far, own, lengths(pose[used] - poses[0][used]))
    size = np.zeros(count)
    own_sizes = extents(poses[0][used], own)
    size[: len(own_sizes)] = np.maximum(own_sizes, 0.0)
    return np.asarray(far > least * size)
