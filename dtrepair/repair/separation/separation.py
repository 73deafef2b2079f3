"""Bodies that penetrate each other are led apart as wholes before contacts are pushed.

Where a thin body goes deep into another one, as a sword into a stone, its sides are pushed against
each other: it would be stretched, not moved. A shift along the way with the least motion, shared by
both bodies, takes it out; the repair of contacts takes over where it ends.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import NamedTuple

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray, diagonal
from dtrepair.numerics.temporal import eased_in_time
from dtrepair.numerics.worn.measure import WornOptions
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh
from dtrepair.repair.separation.lifting import layered_bodies
from dtrepair.repair.separation.penetration import (
    BodyShape,
    Inside,
    Penetration,
    PenetrationOptions,
    find_inside,
    shares_of_way,
)
from dtrepair.repair.separation.untangling import (
    UntanglingOptions,
    contact_counts,
    directions_around,
    length_along,
    shortest_direction,
)
from dtrepair.repair.separation.worn_pairs import WornPairs


@dataclass(frozen=True, kw_only=True)
class SeparationOptions:
    """Which bodies are led apart as wholes, and which way.

    Args:
        deep: A body penetrates another where it is deeper inside than so many times its own
            thickness.
        fraction: If it is not stiff, at least this fraction of the vertices of either must be
            inside of the other: a character does not move as a whole for a hand in a wall.
        slender: Of a rod or a blade what is inside is deeper than so many times its width; of a
            sheet it is not, and a soft one is better dented.
        reach: Longest shift, as a multiple of how deep the contact is: rings and belts stay where
            they are.
        covering: Of layers at least this fraction covers the other body; they stay too.
        apart: Frames of contact that are farther apart are two contacts.
        width: Standard deviation, in frames, over which a shift comes and goes.
        samples: Frames that rank the directions.
        tries: Directions that are tried.
        left: Fraction of the pairs that a shift may leave, and of new ones that it may make.
        deeper, off: What is fitted to a body goes so many times as far as it is deep in another,
            and this fraction of the diagonal, for what no depth tells the way of.
        beyond: Factor by which a shift is longer than the way to the surface: out is out.
        attached: What is attached to other bodies goes no farther than this fraction of the
            diagonal, for each contact: it would come off them.
        penetration: How much is looked at.
        untangling: Of bodies that hook into each other.
        worn: What goes round another body is not led off it.
    """

    deep: float = 1.0
    fraction: float = 0.1
    slender: float = 3.0
    reach: float = 2.5
    covering: float = 0.3
    apart: float = 6.0
    width: float = 2.0
    samples: int = 4
    tries: int = 4
    left: float = 0.3
    deeper: float = 2.0
    off: float = 0.01
    beyond: float = 1.01
    attached: float = 0.02
    penetration: PenetrationOptions = field(default_factory=PenetrationOptions)
    untangling: UntanglingOptions = field(default_factory=UntanglingOptions)
    worn: WornOptions = field(default_factory=WornOptions)


class Contact(NamedTuple):
    """Two bodies that meet in some frames, and the fraction of the way that each of them goes."""

    first: int
    second: int
    frames: list[int]
    shares: tuple[float, float]


def separated_frames(
    scene: Scene,
    mesh: WeldedMesh,
    poses: FloatArray,
    pairs: Sequence[IntArray],
    frames: FloatArray,
    *,
    sheets: Collection[int] = (),
    tangled: frozenset[tuple[int, int]] = frozenset(),
    options: SeparationOptions = SeparationOptions(),
) -> FloatArray:
    """Return poses (T, V, 3) with bodies that penetrate each other led apart, steadily in time.

    All frames of a contact leave along one way, as far as each needs; the shift comes and goes
    smoothly. What has a direction, or a largest displacement, is left to the repair of contacts.

    Args:
        scene: The bodies.
        mesh: The welded mesh of the poses.
        poses: Poses (T, V, 3).
        pairs: Intersecting pairs (K, 2) of triangles of each frame, which tell who meets.
        frames: Times (T,) in frame units.
        sheets: Bodies that are led apart even where they or the others are soft sheets.
        tangled: Pairs of bodies that are led apart unless layers over each other, to be lifted.
        options: Numbers of this stage.
    """
    limited = scene.options.maximum_displacement is not None
    if len(scene.bodies) == 1 or limited or scene.options.method == "paper":
        return poses
    separation = _Separation(scene, mesh, poses, frames, sheets, options)
    tangled = tangled and tangled - layered_bodies(scene, pairs)
    for contact in separation.contacts(pairs):
        if not separation.separate(contact) and (contact.first, contact.second) in tangled:
            separation.untangle(contact)
    return separation.poses


class _Separation:
    """The frames of a window while one contact after the other is led apart."""

    def __init__(
        self,
        scene: Scene,
        mesh: WeldedMesh,
        poses: FloatArray,
        frames: FloatArray,
        sheets: Collection[int],
        options: SeparationOptions,
    ) -> None:
        self.scene, self.mesh, self.frames, self.sheets = scene, mesh, frames, sheets
        self.poses, self.options = poses, options
        self.shapes: dict[int, BodyShape] = {}
        self.worn = WornPairs(scene, self._shape, options.worn)

    def contacts(self, pairs: Sequence[IntArray]) -> Iterator[Contact]:
        """Yield bodies that meet and of which one may move, those with most pairs first."""
        met: dict[tuple[int, int], dict[int, int]] = {}
        for frame, found in enumerate(pairs):
            names, counts = contact_counts(self.scene.body_of, found)
            for (first, second), count in zip(names.tolist(), counts.tolist(), strict=True):
                met.setdefault((first, second), {})[frame] = count
        cluster = self.mesh.surface.cluster_of_body
        for (first, second), where in sorted(met.items(), key=lambda m: -sum(m[1].values())):
            if first != second and cluster[first] == cluster[second]:
                continue  # what is attached is not led apart
            shares = shares_of_way(self.scene, (self._shape(first), self._shape(second)))
            if shares is None:
                continue
            hang = (np.bincount(cluster)[cluster[[first, second]]] > 1).tolist()
            if sum(hang) == 1 and shares[hang.index(False)] > 0.0:
                shares = (float(hang[1]), float(hang[0]))  # what hangs on nothing goes all the way
            run: list[int] = []
            for frame in sorted(where):
                if run and self.frames[frame] - self.frames[run[-1]] > self.options.apart:
                    yield Contact(first, second, run, shares)
                    run = []
                run.append(frame)
            yield Contact(first, second, run, shares)

    def separate(self, contact: Contact) -> bool:
        """Separate two penetrating bodies over the frames of a contact; return whether it could."""
        first, second = self._shape(contact.first), self._shape(contact.second)
        inside = [self._inside(self.poses[frame], contact) for frame in contact.frames]
        deepest = [max(mine.depth, theirs.depth) for mine, theirs in inside]
        if not any(self._penetrates(contact, *found) for found in inside):
            return False
        options, count = self.options, len(contact.frames)
        chosen = {*np.linspace(0, count - 1, options.samples).astype(int), int(np.argmax(deepest))}
        samples = sorted(int(index) for index in chosen)
        penetration = partial(Penetration, first, second, options=options.penetration)
        some = penetration(
            [self.poses[contact.frames[index]] for index in samples],
            [inside[index] for index in samples],
        )
        worst = samples.index(int(np.argmax(deepest)))
        known = ((some.length(worst, way), way) for way in some.directions())
        pose = some.poses[worst]
        attached = self._farthest_attached(contact, pose) / options.beyond
        farthest = min(options.reach * max(deepest), attached)
        short = ((length, way) for length, way in known if length <= farthest)
        met = self._met(contact, pose)
        for length, way in islice(short, options.tries):
            if self._frees(contact, pose, met, options.beyond * length * way):
                poses = [self.poses[frame] for frame in contact.frames]
                every = penetration(poses, inside)
                lengths = [every.length(index, way) for index in range(count)]
                if max(lengths) <= attached:
                    self._shift(contact, way, lengths)
                    return True
        return False

    def untangle(self, contact: Contact) -> None:
        """Separate the bodies of a contact along the shortest way that frees most of its pairs.

        That of the frame with most pairs serves all of them.
        """
        options = self.options.untangling
        poses = [self.poses[frame] for frame in contact.frames]
        met = [self._met(contact, pose) for pose in poses]
        worst = int(np.argmax([between for between, _ in met]))
        bodies = [poses[worst][self._shape(b).vertices] for b in (contact.first, contact.second)]
        attached = self._farthest_attached(contact, poses[worst]) / self.options.beyond
        farthest = min(attached, options.farthest * min(diagonal(points) for points in bodies))
        both = zip((contact.first, contact.second), contact.shares, strict=True)
        fitted = any(share > 0.0 and self.worn.fitted(body) for body, share in both)
        if fitted:
            farthest = min(farthest, max(self._close_by(contact, pose) for pose in poses))
        frees = partial(self._frees, contact, poses[worst], met[worst])
        way = shortest_direction(frees, directions_around(*bodies), farthest, options=options)
        if way is None:
            return
        lengths = []
        for pose, before in zip(poses, met, strict=True):
            frees = partial(self._frees, contact, pose, before)
            lengths.append(length_along(frees, way, farthest, options=options))
        if fitted or self.worn.of(contact.first, contact.second) is not None:
            # What is worn goes no farther than where it still was: pushing does the rest.
            farthest = max(length for length in lengths if length is not None)
        self._shift(contact, way, [farthest if own is None else own for own in lengths])

    def _farthest_attached(self, contact: Contact, pose: FloatArray) -> float:
        """Return how far two bodies may be led apart in a pose (V, 3): inf if they are free."""
        cluster, both = self.mesh.surface.cluster_of_body, (contact.first, contact.second)
        pairs = zip((both, both[::-1]), contact.shares, strict=True)
        share = max(share * self.worn.hangs(*own, cluster) for own, share in pairs)
        most = self.options.attached * self.scene.scale.diagonal(pose)
        return most / share if share > 0.0 else np.inf

    def _close_by(self, contact: Contact, pose: FloatArray) -> float:
        """Return how far what is fitted to a body may go in a pose (V, 3): hardly off it."""
        depth = max(found.depth for found in self._inside(pose, contact))
        off = self.options.off * self.scene.scale.diagonal(pose)
        return self.options.deeper * depth + off

    def _shift(self, contact: Contact, way: FloatArray, lengths: list[float]) -> None:
        needed = np.zeros(len(self.frames))
        needed[contact.frames] = self.options.beyond * np.array(lengths)
        path = eased_in_time(needed, self.frames, self.options.width)[:, None] * way
        both = zip(self.poses, path, strict=True)
        self.poses = np.stack([self._moved(pose, contact, shift) for pose, shift in both])

    def _moved(self, pose: FloatArray, contact: Contact, shift: FloatArray) -> FloatArray:
        result = pose.copy()
        both = contact.first, contact.second
        signs = zip((both, both[::-1]), (1.0, -1.0), contact.shares, strict=True)
        for (body, other), sign, share in signs:
            if share > 0.0 and shift.any():
                for own in self.worn.companions(body, other):
                    result[self._shape(own).vertices] += sign * share * shift
        return result

    def _frees(
        self, contact: Contact, pose: FloatArray, met: tuple[int, int], shift: FloatArray
    ) -> bool:
        """Return whether a shift clears most of a contact, `met` in the pose, and makes none."""
        before, all_before = met
        moved = self._moved(pose, contact, shift)
        after, all_after = self._met(contact, moved)
        gone, left = before - after, self.options.left
        frees = after <= left * before and all_after <= all_before - (1.0 - left) * gone
        both = contact.first, contact.second
        return frees and not self.worn.takes_off(*both, pose, moved)

    def _met(self, contact: Contact, pose: FloatArray) -> tuple[int, int]:
        """Return the pairs between the bodies of a contact, and all pairs of either, in a pose."""
        surface, both = self.mesh.surface, (contact.first, contact.second)
        along = self.worn.companions(*both) + self.worn.companions(*both[::-1])
        active = np.isin(surface.body_of, along)
        pairs = surface.contacts.pairs(self.mesh.reduced(pose), active=active)
        bodies = np.sort(surface.body_of[pairs], axis=1)
        return int((bodies == both).all(axis=1).sum()), len(bodies)

    def _inside(self, pose: FloatArray, contact: Contact) -> tuple[Inside, Inside]:
        first, second = self._shape(contact.first), self._shape(contact.second)
        options = self.options.penetration
        return (
            find_inside(pose, first, second, options=options),
            find_inside(pose, second, first, options=options),
        )

    def _penetrates(self, contact: Contact, mine: Inside, theirs: Inside) -> bool:
        """Return whether one body is deep in the other, and neither covers the other."""
        options = self.options
        deep, large = False, max(mine.fraction, theirs.fraction) >= options.fraction
        sheets = contact.first in self.sheets or contact.second in self.sheets
        sides = ((contact.first, contact.second, mine), (contact.second, contact.first, theirs))
        for inner, outer, found in sides:
            if len(found.vertices) == 0:
                continue
            surface = self.mesh.surface
            under = surface.cover[self.mesh.place[found.vertices]]
            covering = (under >= 0) & (surface.body_of_vertex[under] == outer)
            if covering.mean() > options.covering:
                return False
            stiff = self.scene.is_stiff(inner)
            thick = options.deep * self._shape(inner).thickness
            slender = found.depth > options.slender * found.width
            deep |= found.depth > thick and (stiff or (large and (sheets or slender)))
        return deep

    def _shape(self, body: int) -> BodyShape:
        if body not in self.shapes:
            self.shapes[body] = BodyShape(self.scene, body)
        return self.shapes[body]
