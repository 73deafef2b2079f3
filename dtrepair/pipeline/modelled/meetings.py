"""What meets at rest, and whether frames show it there: what only passes by tells nothing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.closest_point import NearestTriangles
from dtrepair.numerics.geometry import FloatArray, IntArray, diagonal, lengths

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class MeetingOptions:
    """When two groups of triangles that meet at rest only pass each other there.

    Args:
        samples: Frames of the whole clip that are looked at, at most.
        far: What meets at rest is farther apart than this in frames, by half of the pairs, in
            diagonals of the smaller group, ...
        least: ... and farther than this, in diagonals of all that meets something: a joint of small
            parts that bends moves its overlap on by much of their size, ...
        share: ... in this share of the frames at least; ...
        rooted, root: ... in half of them no farther apart than this part of it by no more than this
            share of the pairs: a strand may lie along a body in whose scalp it is rooted; ...
        touch: ... and in less than half of them half of what meets the other group at rest, of one
            of the two, is no more than this farther from it, in diagonals of the smaller one: a rod
            that is drawn out of its sleeve, or a wheel, is elsewhere but touches what it did.
        places: So many places are asked for that, at most.
        joint: What meets at rest at a joint of a third group that both stay with belongs to it, as
            a ring round an arm where that comes out of its sleeve: half of the pairs are no farther
            from what meets there of either, in diagonals of all that meets something. 0: none does.
    """

    samples: int = 33
    far: float = 0.1
    least: float = 0.0
    share: float = 1.0
    rooted: float = -1e9
    root: float = 0.1
    touch: float = 0.02
    places: int = 200
    joint: float = 0.0


class Meetings(NamedTuple):
    """Two groups (N, 2) of triangles each that meet at rest, and which (N,) only pass by."""

    sides: IntArray
    passing: BoolArray


def meetings(
    rest: FloatArray,
    poses: Iterable[FloatArray],
    faces: IntArray,
    pairs: IntArray,
    group_of: NDArray[np.integer],
    *,
    options: MeetingOptions = MeetingOptions(),
) -> Meetings:
    """Return which groups of triangles meet at rest, and which of them only pass by there.

    Args:
        rest: All points (V, 3) at rest.
        poses: The same in frames; no more are looked at than it takes.
        faces: The triangles (F, 3).
        pairs: Those (K, 2) of two groups each that meet at rest.
        group_of: The group (F,) of each triangle.
        options: Numbers.
    """
    met = _Met(rest, faces, pairs, group_of, options)
    passing = np.ones(len(met.sides), dtype=bool)
    looks, stays, rooted, touching = np.zeros((4, len(met.sides)), dtype=int)
    for pose in poses if len(met.sides) else ():
        near, root, shown = met.near(pose)
        looks += shown
        stays += near & shown
        rooted += root & shown
        passing &= options.samples - stays >= options.share * options.samples
        if not passing.any():
            break
        asked = passing & shown & ~near
        touching[asked] += met.touch(pose, np.flatnonzero(asked).tolist())
    passing &= (looks - stays >= options.share * looks) & (2 * rooted < looks)
    passing &= 2 * touching < looks
    passing &= ~met.at_joints(rest, passing)
    return Meetings(met.sides, passing)


class _Met:
    """What meets of each two groups at rest; see `meetings`."""

    def __init__(
        self,
        rest: FloatArray,
        faces: IntArray,
        pairs: IntArray,
        group_of: NDArray[np.integer],
        options: MeetingOptions,
    ) -> None:
        self.faces, self.group_of, self.options = faces, group_of, options
        pairs = np.take_along_axis(pairs, group_of[pairs].argsort(axis=1, kind="stable"), axis=1)
        # The two groups (N, 2), and which (K,) two each pair is of.
        sides, place = np.unique(group_of[pairs], axis=0, return_inverse=True)
        self.sides = sides.astype(np.int32)
        order = np.argsort(place.reshape(-1), kind="stable")
        self.pairs, self.place = pairs[order], place.reshape(-1)[order]
        ends = np.cumsum([0, *np.bincount(self.place, minlength=len(self.sides))])
        # Where half of the pairs of each two groups are nearer, and as many as a root has.
        self._middle, self._root = (
            ends[:-1] + (share * (np.diff(ends) - 1)).astype(np.int64)
            for share in (0.5, options.root)
        )
        self._triangles = {own: np.flatnonzero(group_of == own) for own in np.unique(sides)}
        self._every = np.unique(faces[np.isin(group_of, self.sides)])
        self.before, self.apart = self._sizes(rest), self._apart(rest)
        self._at_rest = _Trees(rest, faces, self._triangles)
        self._places: dict[tuple[int, int], tuple[IntArray, FloatArray]] = {}

    def near(self, pose: FloatArray) -> tuple[BoolArray, BoolArray, BoolArray]:
        """Return of which two groups (N,) half of what meets at rest is near in a pose.

        Second, of which a root is at its place. Last, which two are shown there: what is scaled to
        nothing is not.
        """
        sizes = self._sizes(pose)
        shown = (sizes > 1e-6 * self.before).all(axis=1)
        smaller = self.before.argmin(axis=1)[:, None]
        size, before = (np.take_along_axis(own, smaller, 1)[:, 0] for own in (sizes, self.before))
        scale = np.where(before > 0.0, size / np.maximum(before, 1e-300), 1.0)
        beyond = self._apart(pose) - scale[self.place] * self.apart
        ordered = beyond[np.lexsort((beyond, self.place))]
        least = self.options.least * diagonal(pose[self._every])
        most = np.maximum(self.options.far * size, least)
        near = ordered[self._middle] <= most
        root = ordered[self._root] <= self.options.rooted * most
        return np.asarray(near), np.asarray(root), np.asarray(shown)

    def touch(self, pose: FloatArray, chosen: Sequence[int]) -> BoolArray:
        """Return of which of some two groups (C,) one touches the other half as much as at rest."""
        found, trees = np.zeros(len(chosen), dtype=bool), _Trees(pose, self.faces, self._triangles)
        for row, index in enumerate(chosen):
            size = self._size(pose, self.sides[index, self.before[index].argmin()])
            for side in (0, 1):
                own, reach = self._some(index, side)
                away = trees.distances(own, self.sides[index, 1 - side])
                found[row] |= np.median(away - reach) <= self.options.touch * size
        return found

    def at_joints(self, rest: FloatArray, passing: BoolArray) -> BoolArray:
        """Return which two groups (N,) of those that pass (N,) meet at a joint of a third one.

        rest: All points (V, 3) at rest.
        """
        found = np.zeros(len(passing), dtype=bool)
        if not self.options.joint:
            return found
        number = {tuple(both): index for index, both in enumerate(self.sides.tolist())}
        together: dict[int, set[int]] = {}
        for one, other in self.sides[~passing].tolist():
            together.setdefault(one, set()).add(other)
            together.setdefault(other, set()).add(one)
        for index in np.flatnonzero(passing).tolist():
            one, other = self.sides[index].tolist()
            for third in sorted(together.get(one, set()) & together.get(other, set())):
                joints = [number[min(own, third), max(own, third)] for own in (one, other)]
                found[index] |= all(self._beside(rest, index, joint) for joint in joints)
        return found

    def _beside(self, rest: FloatArray, index: int, joint: int) -> bool:
        """Return whether two groups meet where others do, `joint`, in a pose (V, 3)."""
        middles = rest[self.faces[self._pairs(index)]].mean(axis=(1, 2))
        closest = NearestTriangles(rest[self.faces[self._pairs(joint).ravel()]]).nearest(middles)[1]
        most = self.options.joint * diagonal(rest[self._every])
        return bool(np.median(lengths(closest - middles)) <= most)

    def _pairs(self, index: int) -> IntArray:
        """Return the pairs (K, 2) of triangles of two groups that meet at rest."""
        return self.pairs[np.flatnonzero(self.place == index)]

    def _some(self, index: int, side: int) -> tuple[IntArray, FloatArray]:
        """Return a few triangles (N,) of one of two that meet, and their distances (N,) at rest."""
        if (index, side) not in self._places:
            own = np.unique(self._pairs(index)[:, side]).astype(np.int32)
            own = own[:: -(-len(own) // self.options.places)]
            away = self._at_rest.distances(own, self.sides[index, 1 - side])
            self._places[index, side] = own, away
        return self._places[index, side]

    def _sizes(self, points: FloatArray) -> FloatArray:
        """Return the diagonals (N, 2) of each two groups in points (V, 3)."""
        size = {own: self._size(points, own) for own in self._triangles}
        return np.array([[size[own] for own in both] for both in self.sides]).reshape(-1, 2)

    def _size(self, points: FloatArray, group: int) -> float:
        """Return the diagonal of a group in points (V, 3)."""
        return diagonal(points[self.faces[self._triangles[group]].ravel()])

    def _apart(self, points: FloatArray) -> FloatArray:
        """Return how far (K,) the middles of two triangles are from each other."""
        first, second = points[self.faces[self.pairs]].mean(axis=2).swapaxes(0, 1)
        return lengths(first - second)


class _Trees:
    """A pose (V, 3) of groups, each with a search tree that is built when it is asked for."""

    def __init__(
        self, points: FloatArray, faces: IntArray, triangles: dict[int, NDArray[np.intp]]
    ) -> None:
        self.points, self.faces, self.triangles = points, faces, triangles
        self._trees: dict[int, NearestTriangles] = {}

    def distances(self, triangles: IntArray, group: int) -> FloatArray:
        """Return how far the middles of triangles (N,) are from a group."""
        if group not in self._trees:
            corners = self.points[self.faces[self.triangles[group]]]
            self._trees[group] = NearestTriangles(corners)
        middles = self.points[self.faces[triangles]].mean(axis=1)
        return lengths(self._trees[group].nearest(middles)[1] - middles)
