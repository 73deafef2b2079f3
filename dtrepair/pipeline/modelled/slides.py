"""Joints of rigid parts whose overlap moves: along one axis, or about one centre.

Rods slide in cylinders, drawers and telescopes; balls turn in sockets, and limbs about balls.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dtrepair.intersect.ignored import CollapsedPoseError
from dtrepair.numerics.geometry import FloatArray, diagonal, lengths
from dtrepair.pipeline.modelled.meshes import Look, PlacedMeshes

if TYPE_CHECKING:
    from dtrepair.numerics.attachments import Reference


@dataclass(frozen=True, kw_only=True)
class SlideOptions:
    """When two rigid parts slide in each other, or turn about each other.

    Args:
        rounding: Vertices are at most so far from a rigid motion, diagonals of their part: skinning
            rounds.
        hidden: A part that is scaled to less than this share of its diagonal is hidden: that pose
            tells nothing of it.
        least: A slide is longer than this, diagonals of the smaller part.
        apart: Poses show where two parts meet if they have slid on by this, of the same.
        straight: It strays from its axis by at most this share of its length.
        tilt: The axis itself turns by at most this angle, in radians; about it the parts may spin.
        turn: A joint turns if it does so by more than this angle, in radians, and shows where its
            parts meet if it has turned on by as much.
        centred: The centre about which it turns stays where it is by this share of the diagonal of
            the smaller part, ...
        near: ... and is at most so far from the middle of where the parts meet, of the same.
    """

    rounding: float = 1e-3
    hidden: float = 0.01
    least: float = 0.02
    apart: float = 0.02
    straight: float = 0.05
    tilt: float = 0.05
    turn: float = 0.25
    centred: float = 0.05
    near: float = 0.5


class RigidMotion(NamedTuple):
    """A rotation about the origin, and what is added to it."""

    rotation: Rotation
    shift: FloatArray

    def back(self, points: FloatArray) -> FloatArray:
        """Return where points (3,) or (N, 3) came from."""
        return np.asarray(self.rotation.apply(points - self.shift, inverse=True))


class Joint:
    """Two rigid parts that meet in a pose, and how one moves in the axes of the other.

    Args:
        key: The number of the pair of parts.
        rests: Their points (N, 3) in the pose that shows how they were modelled.
        middle: The middle (3,) of where they meet there.
        options: The numbers.
    """

    def __init__(
        self,
        key: int,
        rests: tuple[FloatArray, FloatArray],
        middle: FloatArray,
        options: SlideOptions,
    ) -> None:
        self.key, self.rests, self.middle, self.options = key, rests, middle, options
        self.extent = min(diagonal(rest) for rest in rests)
        self.bends = False
        self._path: list[FloatArray] = []
        self._turns: list[Rotation] = []

    def follow(self, first: FloatArray, second: FloatArray) -> None:
        """Note where the first part is, seen from the second one, by their points (N, 3)."""
        hidden, rounding = self.options.hidden, self.options.rounding
        both = list(zip(self.rests, (first, second), strict=True))
        if any(diagonal(pose) < hidden * diagonal(rest) for rest, pose in both):
            self._path.append(np.full(3, np.nan))
            self._turns.append(Rotation.identity())
            return
        one, other = (rigid_motion(rest, pose, rounding) for rest, pose in both)
        if one is None or other is None:
            self.bends = True
            return
        there = one.rotation.apply(self.middle) + one.shift
        self._path.append(other.back(there) - self.middle)
        self._turns.append(other.rotation.inv() * one.rotation)

    def slid(self) -> FloatArray | None:
        """Return how far (T, 1) it has slid along its axis in each pose; None if it does not slide.

        Not a number where one of the parts is hidden. The path is that of the middle of where the
        parts meet: what meets on one side only and spins as well strays from its axis.
        """
        path = np.array(self._path).reshape(-1, 3)
        far = lengths(np.nan_to_num(path))
        longest = float(far.max(initial=0.0))
        if self.bends or longest <= self.options.least * self.extent:
            return None
        axis = path[far.argmax()] / longest
        along: FloatArray = path @ axis
        astray = np.nanmax(lengths(path - along[:, None] * axis))
        tilted = max(float(np.linalg.norm(turn.apply(axis) - axis)) for turn in self._turns)
        if astray > self.options.straight * longest or tilted > self.options.tilt:
            return None
        return along[:, None]

    def turned(self) -> FloatArray | None:
        """Return how it has turned (T, 3) in each pose, rotation vectors; None if it does not turn.

        Not a number where one of the parts is hidden.
        """
        turns = Rotation.concatenate(self._turns) if self._turns else Rotation.identity(0)
        if self.bends or turns.magnitude().max(initial=0.0) <= self.options.turn:
            return None
        path = np.array(self._path)
        shown = np.isfinite(path).all(axis=1)
        # Nearest to the middle of all points that stay: a hinge has a line of them.
        moving = (turns.as_matrix() - np.eye(3))[shown]
        matrix, right = moving.reshape(-1, 3), -path[shown].ravel()
        centre = np.linalg.lstsq(matrix, right, rcond=1e-3)[0]
        astray = lengths((matrix @ centre - right).reshape(-1, 3)).max()
        if astray > self.options.centred * self.extent:
            return None
        if np.linalg.norm(centre) > self.options.near * self.extent:
            return None
        vectors: FloatArray = turns.as_rotvec()
        vectors[~shown] = np.nan
        return vectors


class _Way(NamedTuple):
    """A joint, how far (T, k) it has moved on in each frame, and how far on shows something new."""

    joint: Joint
    path: FloatArray
    apart: float
    turned: bool


def slid_references(
    meshes: PlacedMeshes,
    known: Sequence[Look],
    *,
    samples: int,
    turns: bool = True,
    options: SlideOptions = SlideOptions(),
) -> list[Reference]:
    """Return frames that show parts which slide in each other, or turn, where they have moved on.

    known: poses with the contacts that were modelled; samples: frames that are looked at, of the
    whole clip; turns: whether joints that turn are looked for, even where nobody asked for them.
    """
    ways = _ways(meshes, known, samples, options, turns=turns)
    found: list[Reference] = []
    seen = [np.zeros((1, way.path.shape[1])) for way in ways]
    # Read again: few characters have parts that slide or turn as wholes.
    for index, (name, pose) in enumerate(meshes.poses(samples) if ways else ()):
        new: dict[bool, list[int]] = {False: [], True: []}
        for number, way in enumerate(ways):
            away = np.linalg.norm(seen[number] - way.path[index], axis=1)
            if away.min() > way.apart:
                seen[number] = np.concatenate([seen[number], way.path[index : index + 1]])
                new[way.turned].append(way.joint.key)
        with suppress(CollapsedPoseError):
            if any(new.values()):
                look = meshes.look(pose, name)
                for turned, keys in new.items():
                    found += _of_keys(meshes, look, keys, turned=turned)
    return found


def _of_keys(
    meshes: PlacedMeshes, look: Look, keys: list[int], *, turned: bool
) -> Iterator[Reference]:
    """Yield what a frame shows of some pairs of parts, those that the user asked for apart."""
    chosen, asked = np.isin(look.keys, keys), meshes.asked(look.pairs)
    for own in (False, True):
        if (chosen & (asked == own)).any():
            found = look.reference(chosen & (asked == own), asked=own)
            yield found._replace(slid=True, turned=turned)


def _ways(
    meshes: PlacedMeshes,
    known: Sequence[Look],
    samples: int,
    options: SlideOptions,
    *,
    turns: bool,
) -> list[_Way]:
    """Return the joints that slide or turn."""
    of_vertex = np.full(len(meshes.rest), -1)
    of_vertex[meshes.weld[meshes.faces]] = meshes.part_of[:, None]
    order = np.argsort(of_vertex, kind="stable")
    sorted_parts = of_vertex[order]

    def vertices(part: int) -> NDArray[np.intp]:
        start, end = np.searchsorted(sorted_parts, [part, part + 1])
        return np.asarray(order[start:end])

    joints: list[tuple[Joint, tuple[NDArray[np.intp], NDArray[np.intp]]]] = []
    may_turn: set[int] = set()
    for look in known:
        by_key = np.argsort(look.keys, kind="stable")
        keys, starts = np.unique(look.keys[by_key], return_index=True)
        for key, chosen in zip(keys.tolist(), np.split(by_key, starts[1:]), strict=False):
            low, high = divmod(key, len(meshes.rest))
            corners = look.points[meshes.faces[look.pairs[chosen]]]
            own = vertices(low), vertices(high)
            rests = look.points[own[0]], look.points[own[1]]
            joints.append((Joint(key, rests, corners.mean(axis=(0, 1, 2)), options), own))
            if turns or meshes.asked(look.pairs[chosen]).any():
                may_turn.add(key)
    for _, pose in meshes.poses(samples):
        if not joints:
            break
        for joint, (low, high) in joints:
            joint.follow(pose[low], pose[high])
        joints = [each for each in joints if not each[0].bends]
    found: list[_Way] = []
    for joint, _ in joints:
        if (along := joint.slid()) is not None:
            found.append(_Way(joint, along, options.apart * joint.extent, turned=False))
        elif joint.key in may_turn and (angles := joint.turned()) is not None:
            found.append(_Way(joint, angles, options.turn, turned=True))
    return found


def rigid_motion(rest: FloatArray, pose: FloatArray, rounding: float) -> RigidMotion | None:
    """Return the motion that takes points (N, 3) to others, or None if they also deform.

    None of points on one line, too, about which any turn is as good. rounding: how far from the
    motion they may be, diagonals of the rest.
    """
    middle, there = rest.mean(axis=0), pose.mean(axis=0)
    left, size, right = np.linalg.svd((pose - there).T @ (rest - middle))
    if size[1] <= 1e-9 * size[0]:
        return None
    proper = np.diag([1.0, 1.0, np.linalg.det(left @ right)])
    rotation = Rotation.from_matrix(left @ proper @ right)
    found = RigidMotion(rotation, there - rotation.apply(middle))
    far = lengths(found.back(pose) - rest).max()
    return found if far <= rounding * diagonal(rest) else None
