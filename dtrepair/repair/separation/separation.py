"""Bodies that pierce each other are led apart as wholes before contacts are pushed.

Where a thin body goes deep into another one, as a sword into a stone, its sides are pushed against
each other: it would be stretched, not moved. A shift along the way with the least motion, shared by
both bodies, takes it out; the repair of contacts takes over where it ends.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from functools import partial
from itertools import islice
from typing import NamedTuple

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray, diagonal
from dtrepair.numerics.temporal import eased_in_time
from dtrepair.repair.scene.bodies import STIFF
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh
from dtrepair.repair.separation.penetration import Inside, Piercing, Shape, find_inside
from dtrepair.repair.separation.untangling import (
    FARTHEST,
    contact_counts,
    length_along,
    shortest_way,
    ways_around,
)

# A body pierces another where it is deeper inside than this many times its own thickness; if it is
# not stiff, at least this part of the vertices of either must be inside of the other: a character
# does not move as a whole for a hand in a wall. Of a rod or a blade what is inside is deeper than
# this many times its width, of a sheet it is not.
DEEP, PART, SLENDER = 1.0, 0.1, 3.0
# A shift much longer than the contact is deep is no way out of it: rings and belts stay where they
# are, and so do layers, of which at least this part covers the other body.
REACH, COVERING = 2.5, 0.3
# Frames of contact that are farther apart are two contacts; a shift comes and goes in WIDTH frames.
APART, WIDTH = 6.0, 2.0
# Frames that rank the ways, ways that are tried, and the part of the pairs that may be left.
SAMPLES, TRIES, LEFT = 4, 4, 0.3
# The shift goes this part farther than to the surface.
BEYOND = 1.01


class Contact(NamedTuple):
    """Two bodies that meet in some frames, and the part of the way that each of them goes."""

    first: int
    second: int
    frames: list[int]
    shares: tuple[float, float]


def parted_frames(
    scene: Scene,
    mesh: WeldedMesh,
    poses: FloatArray,
    pairs: Sequence[IntArray],
    frames: FloatArray,
    sheets: Collection[int] = (),
    hooked: frozenset[tuple[int, int]] = frozenset(),
) -> FloatArray:
    """Poses (T, V, 3) at `frames` (T,) with bodies that pierce each other led apart, steadily.

    All frames of a contact leave along one way, as far as each needs; before and after, the shift
    comes and goes smoothly. `pairs` (K, 2) of triangles of each frame tell who meets. What has a
    preferred direction, or a largest displacement, is left to the contacts, and so are soft sheets,
    which are better dented, unless `sheets` names one of the two bodies. Bodies that are `hooked`
    into each other are led apart whatever they are.
    """
    limited = scene.options.maximum_displacement is not None
    if len(scene.bodies) == 1 or limited or scene.options.method == "paper":
        return poses
    parting = _Parting(scene, mesh, poses, frames, sheets)
    for contact in parting.contacts(pairs):
        if not parting.part(contact) and (contact.first, contact.second) in hooked:
            parting.unhook(contact)
    return parting.poses


class _Parting:
    """The frames of a window while one contact after the other is led apart."""

    def __init__(
        self,
        scene: Scene,
        mesh: WeldedMesh,
        poses: FloatArray,
        frames: FloatArray,
        sheets: Collection[int],
    ) -> None:
        self.scene, self.mesh, self.frames, self.sheets = scene, mesh, frames, sheets
        self.poses = poses
        self.shapes: dict[int, Shape] = {}

    def contacts(self, pairs: Sequence[IntArray]) -> Iterator[Contact]:
        """Bodies that meet and of which one may move, those with most pairs first."""
        met: dict[tuple[int, int], dict[int, int]] = {}
        for frame, found in enumerate(pairs):
            names, counts = contact_counts(self.scene.body_of, found)
            for (first, second), count in zip(names.tolist(), counts.tolist(), strict=True):
                met.setdefault((first, second), {})[frame] = count
        for (first, second), where in sorted(met.items(), key=lambda m: -sum(m[1].values())):
            shares = self._shares(first, second)
            if shares is None:
                continue
            run: list[int] = []
            for frame in sorted(where):
                if run and self.frames[frame] - self.frames[run[-1]] > APART:
                    yield Contact(first, second, run, shares)
                    run = []
                run.append(frame)
            yield Contact(first, second, run, shares)

    def part(self, contact: Contact) -> bool:
        """Lead the bodies of a contact apart in its frames, if one pierces the other: whether."""
        first, second = self._shape(contact.first), self._shape(contact.second)
        inside = [self._inside(self.poses[frame], contact) for frame in contact.frames]
        deepest = [max(mine.depth, theirs.depth) for mine, theirs in inside]
        if not any(self._pierced(contact, *found) for found in inside):
            return False
        count = len(contact.frames)
        chosen = {*np.linspace(0, count - 1, SAMPLES).astype(int), int(np.argmax(deepest))}
        samples = sorted(int(index) for index in chosen)
        some = Piercing(
            first,
            second,
            [self.poses[contact.frames[index]] for index in samples],
            [inside[index] for index in samples],
        )
        worst = samples.index(int(np.argmax(deepest)))
        known = ((some.length(worst, way), way) for way in some.ways())
        short = ((length, way) for length, way in known if length <= REACH * max(deepest))
        pose = some.poses[worst]
        met = self._met(contact, pose)
        for length, way in islice(short, TRIES):
            if self._frees(contact, pose, met, BEYOND * length * way):
                poses = [self.poses[frame] for frame in contact.frames]
                every = Piercing(first, second, poses, inside)
                self._shift(contact, way, [every.length(index, way) for index in range(count)])
                return True
        return False

    def unhook(self, contact: Contact) -> None:
        """Lead the bodies of a contact apart along the shortest way that frees most of its pairs.

        That of the frame with most pairs serves all of them.
        """
        poses = [self.poses[frame] for frame in contact.frames]
        met = [self._met(contact, pose) for pose in poses]
        worst = int(np.argmax([between for between, _ in met]))
        bodies = [poses[worst][self._shape(b).vertices] for b in (contact.first, contact.second)]
        farthest = FARTHEST * min(diagonal(points) for points in bodies)
        frees = partial(self._frees, contact, poses[worst], met[worst])
        way = shortest_way(frees, ways_around(*bodies), farthest)
        if way is None:
            return
        lengths = []
        for pose, before in zip(poses, met, strict=True):
            frees = partial(self._frees, contact, pose, before)
            lengths.append(length_along(frees, way, farthest))
        self._shift(contact, way, lengths)

    def _shift(self, contact: Contact, way: FloatArray, lengths: list[float]) -> None:
        needed = np.zeros(len(self.frames))
        needed[contact.frames] = BEYOND * np.array(lengths)
        path = eased_in_time(needed, self.frames, WIDTH)[:, None] * way
        self.poses = np.stack(
            [
                self._moved(pose, contact, shift)
                for pose, shift in zip(self.poses, path, strict=True)
            ]
        )

    def _moved(self, pose: FloatArray, contact: Contact, shift: FloatArray) -> FloatArray:
        result = pose.copy()
        bodies = ((contact.first, 1.0), (contact.second, -1.0))
        for (body, sign), share in zip(bodies, contact.shares, strict=True):
            if share > 0.0 and shift.any():
                result[self._shape(body).vertices] += sign * share * shift
        return result

    def _frees(
        self, contact: Contact, pose: FloatArray, met: tuple[int, int], shift: FloatArray
    ) -> bool:
        """Whether a shift clears most of a contact of a pose, `met` there, and makes no others."""
        before, all_before = met
        after, all_after = self._met(contact, self._moved(pose, contact, shift))
        gone = before - after
        return after <= LEFT * before and all_after <= all_before - (1.0 - LEFT) * gone

    def _met(self, contact: Contact, pose: FloatArray) -> tuple[int, int]:
        """Pairs between the bodies of a contact, and all pairs of either, in a pose."""
        surface, both = self.mesh.surface, (contact.first, contact.second)
        pairs = surface.contacts.pairs(
            self.mesh.reduced(pose), active=np.isin(surface.body_of, both)
        )
        bodies = np.sort(surface.body_of[pairs], axis=1)
        return int((bodies == both).all(axis=1).sum()), len(bodies)

    def _inside(self, pose: FloatArray, contact: Contact) -> tuple[Inside, Inside]:
        first, second = self._shape(contact.first), self._shape(contact.second)
        return find_inside(pose, first, second), find_inside(pose, second, first)

    def _pierced(self, contact: Contact, mine: Inside, theirs: Inside) -> bool:
        """Whether one of the bodies is deep in the other, and neither covers the other."""
        deep, large = False, max(mine.part, theirs.part) >= PART
        sheets = contact.first in self.sheets or contact.second in self.sheets
        sides = ((contact.first, contact.second, mine), (contact.second, contact.first, theirs))
        for inner, outer, found in sides:
            if len(found.vertices) == 0:
                continue
            surface, body = self.mesh.surface, self.scene.bodies[inner]
            under = surface.cover[self.mesh.place[found.vertices]]
            covering = (under >= 0) & (surface.body_of_vertex[under] == outer)
            if covering.mean() > COVERING:
                return False
            stiff = body.rigid or (body.diffusion or self.scene.options.diffusion) >= STIFF
            thick = DEEP * self._shape(inner).thickness
            moved = stiff or (large and (sheets or found.depth > SLENDER * found.width))
            deep |= found.depth > thick and moved
        return deep

    def _shares(self, first: int, second: int) -> tuple[float, float] | None:
        """Parts of a way that two bodies go, the larger one less; None where neither may.

        The least sum of squared displacements over both surfaces.
        """
        freedom = []
        for body in (first, second):
            own = self._shape(body).vertices
            if self.scene.direction[own].any():
                return None
            mobility = self.scene.mobility[own]
            whole = mobility.min() == mobility.max()
            freedom.append(mobility.min() / (self._shape(body).area or 1.0) if whole else 0.0)
        total = sum(freedom)
        return None if total == 0.0 else (freedom[0] / total, freedom[1] / total)

    def _shape(self, body: int) -> Shape:
        if body not in self.shapes:
            self.shapes[body] = Shape(self.scene, body)
        return self.shapes[body]
