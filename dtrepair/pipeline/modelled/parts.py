"""Lists of the contacts of the connected parts of an input: what was modelled, what is a fault.

Attachments know parts and triangles by number; a report names them so that they are found again.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.modelled.names import PartNames
from dtrepair.pipeline.observer import (
    ModelledFound,
    Observer,
    PassingFound,
    PropsFound,
    SetsFound,
    warn,
)
from dtrepair.pipeline.stages.bodies import unclear_sides
from dtrepair.pipeline.stages.matching import Side, SidePairs
from dtrepair.pipeline.stages.sources import Source
from dtrepair.report.parts import (
    LISTED,
    LISTED_ATTACHED,
    AttachedList,
    AttachedRecord,
    PairCounts,
    PartPair,
    PartPairs,
    PartRecord,
    PassingRecord,
    bounded,
)

if TYPE_CHECKING:
    from dtrepair.intersect.scene_counts import SceneCount
    from dtrepair.numerics.attachments import Attachments, Reference
    from dtrepair.repair.scene.scene import Scene


class _Met(NamedTuple):
    """Pairs of parts (N, 2) that meet, how often (N,), and the number of each contact's (K,)."""

    parts: NDArray[np.int64]
    pairs: NDArray[np.int64]
    number: NDArray[np.int64]


class InFrame(NamedTuple):
    """Contacts of a frame by pairs of parts: what was modelled, and what is a fault."""

    modelled: PartPairs
    faults: PartPairs


class ModelledParts:
    """The connected parts of an input by name; lists what was modelled, and what is a fault.

    Args:
        source: The meshes.
        attachments: What was modelled, by the triangles of all meshes in a row; None: nothing.
        references: The poses that show it, all meshes in a row.
    """

    def __init__(
        self,
        source: Source,
        attachments: Attachments | None,
        references: Sequence[Reference] = (),
    ) -> None:
        self.source, self.attachments, self.references = source, attachments, references
        self.names = PartNames(source)

    @cached_property
    def records(self) -> list[PartRecord]:
        """All connected parts, in the order of their numbers in the attachments."""
        return self.names.named(self._part_of, int(self._part_of.max(initial=-1)) + 1)

    @cached_property
    def _part_of(self) -> NDArray[np.integer]:
        """The part (F,) of each triangle."""
        if self.attachments is not None:
            return self.attachments.part_of
        return self.names.connected

    def in_frame(
        self,
        time: float,
        before: SceneCount,
        old: Sequence[NDArray[Any]],
        after: SceneCount,
        new: Sequence[NDArray[Any]],
        *,
        most: int = LISTED,
    ) -> InFrame:
        """List what of a frame was modelled and, where there are several parts, what is a fault.

        Pairs sum to those of the counts; a triangle counts with each pair of parts that it is in.
        old, new: points of each mesh in the space of the frames, before and after; most: so many
        pairs of parts are listed as modelled, the rest is summed.
        """
        points = np.concatenate(old), np.concatenate(new)
        modelled = self._listed((before.modelled, after.modelled), points, time, most)
        faults = before.pairs, after.pairs
        if not any(map(len, faults)) or len(self.records) < 2:
            return InFrame(modelled, PartPairs())
        return InFrame(modelled, self._listed(faults, points, time))

    def _listed(
        self,
        contacts: Sequence[NDArray[Any]],
        poses: Sequence[NDArray[Any]],
        time: float,
        most: int = LISTED,
    ) -> PartPairs:
        """List contacts (K, 2) before and after by pairs of parts, with most left first."""
        if not any(map(len, contacts)):
            return PartPairs()
        met = self._met(np.concatenate(contacts))
        numbers = np.split(met.number, [len(contacts[0])])
        pairs = [np.bincount(each, minlength=len(met.pairs)) for each in numbers]
        both = zip(contacts, numbers, strict=True)
        triangles = [_triangles(own, each, len(met.pairs)) for own, each in both]
        order = np.lexsort([-pairs[0], -pairs[1]])
        records = []
        for index in order.tolist():
            side = 0 if pairs[0][index] else 1
            own = contacts[side][numbers[side] == index]
            a, b = met.parts[index].tolist()
            records.append(
                PartPair(
                    first=self.records[a],
                    second=self.records[b],
                    counts=PairCounts(
                        *(int(each[index]) for each in pairs),
                        *(int(each[index]) for each in triangles),
                    ),
                    centre=self.names.where(poses[side], own, time),
                )
            )
        return bounded(records, most=most)

    @cached_property
    def attached(self) -> AttachedList:
        """The pairs of parts whose contacts are modelled, each in the pose that shows most."""
        if self.attachments is None:
            return AttachedList()
        found: dict[tuple[int, int], AttachedRecord] = {}
        time = float(self.source.all_times[0])
        for reference in self.references:
            if not reference.shows_all:
                continue  # another pose shows the same parts as they were modelled
            contacts = reference.pairs[self.attachments.modelled(reference.pairs)]
            met = self._met(contacts)
            for index, (a, b) in enumerate(met.parts.tolist()):
                number = int(met.pairs[index])
                if (a, b) in found and found[a, b].pairs >= number:
                    continue
                own = contacts[met.number == index]
                found[a, b] = AttachedRecord(
                    first=self.records[a],
                    second=self.records[b],
                    pairs=number,
                    pose=reference.name,
                    centre=self.names.where(reference.points, own, time),
                )
        every = [found[key] for key in sorted(found, key=lambda key: (-found[key].pairs, key))]
        rest = every[LISTED_ATTACHED:]
        return AttachedList(
            listed=tuple(every[:LISTED_ATTACHED]),
            others=len(rest),
            other_pairs=sum(record.pairs for record in rest),
        )

    @cached_property
    def passing(self) -> tuple[PassingRecord, ...]:
        """Pairs of parts that only pass each other in the bind pose, as many as are listed."""
        told = [own for own in self.references if own.apart and not own.asked]
        pairs = [pair for own in told for pair in self._met(own.pairs).parts.tolist()]
        pairs = pairs[:LISTED_ATTACHED]
        return tuple(PassingRecord(first=self.records[a], second=self.records[b]) for a, b in pairs)

    @cached_property
    def meshes(self) -> set[tuple[int, int]]:
        """The pairs of meshes (i, j), i <= j, between which contacts are modelled."""
        found: set[tuple[int, int]] = set()
        if self.attachments is None:
            return found
        for reference in self.references:
            found |= self._meshes(reference.pairs[self.attachments.modelled(reference.pairs)])
        return found

    def tell_of(self, one: Side, other: Side) -> bool:
        """Whether contacts of a pair that the user names are modelled."""
        if (one.mesh, other.mesh) not in self.meshes:
            return False
        if not one.part and not other.part:
            return True
        return any(
            (self._is(first, one) and self._is(second, other))
            or (self._is(first, other) and self._is(second, one))
            for first, second in self._modelled_parts
        )

    def _is(self, part: PartRecord, side: Side) -> bool:
        """Whether a part is one that the user names."""
        own = part.path == self.source.meshes[side.mesh].path
        return own and side.part in (0, part.number or 1)

    @cached_property
    def _modelled_parts(self) -> list[tuple[PartRecord, PartRecord]]:
        """The pairs of parts whose contacts are modelled."""
        if self.attachments is None:
            return []
        shown = np.concatenate([own.pairs for own in self.references])
        met = self._met(shown[self.attachments.modelled(shown)])
        return [(self.records[a], self.records[b]) for a, b in met.parts.tolist()]

    @cached_property
    def meshes_told(self) -> set[tuple[int, int]]:
        """The same of which anything tells: with those of which parts are not attached."""
        apart = [self._meshes(own.pairs) for own in self.references if own.apart]
        return self.meshes.union(*apart)

    def _meshes(self, contacts: NDArray[np.integer]) -> set[tuple[int, int]]:
        """Return the pairs of meshes (i, j), i <= j, of contacts (K, 2)."""
        sizes = [len(mesh.faces) for mesh in self.source.meshes]
        mesh_of = np.repeat(np.arange(len(sizes)), sizes)
        pairs = np.unique(np.sort(mesh_of[contacts], axis=1), axis=0)
        return {(int(i), int(j)) for i, j in pairs}

    def _met(self, contacts: NDArray[np.integer]) -> _Met:
        parts = np.sort(self._part_of[contacts], axis=1).astype(np.int64)
        count = int(self._part_of.max(initial=-1)) + 1
        keys, number, pairs = np.unique(
            parts[:, 0] * count + parts[:, 1], return_inverse=True, return_counts=True
        )
        return _Met(np.stack([keys // count, keys % count], axis=1), pairs, number.reshape(-1))


def tell_sets(observer: Observer, source: Source) -> None:
    """Tell what is taken as a set around, where anything is."""
    if sets := tuple(mesh.path for mesh in source.meshes if mesh.of_set):
        observer.remark(SetsFound(sets))


def tell_props(observer: Observer, scene: Scene) -> None:
    """Tell what is taken as a prop, where anything is."""
    if props := tuple(body.name for body in scene.bodies if body.prop):
        observer.remark(PropsFound(props))


def tell_modelled(
    observer: Observer,
    parts: ModelledParts,
    *,
    asked: SidePairs,
    unclear: Sequence[tuple[int, int]] = (),
) -> None:
    """Tell once what is taken as a set, what as modelled, and what that leaves open.

    Args:
        observer: Hears of it.
        parts: What was modelled.
        asked: Pairs of meshes, or of their parts, that the user calls attached.
        unclear: Pairs of meshes whose rest poses meet wherever they lie.
    """
    meshes = parts.source.meshes
    tell_sets(observer, parts.source)
    for one, other in asked:
        if parts.tell_of(one, other):
            continue
        first, second = (f"{meshes[own.mesh].path}{_part(own.part)}" for own in (one, other))
        what = f"{first} and {second}" if one != other else f"different parts of {first}"
        observer.warning(
            f"attach: {what} meet neither in the bind pose nor in a frame that was looked at, or "
            "are ignored: none of their contacts counts as modelled"
        )
    left = [pair for pair in unclear if pair not in parts.meshes_told]
    warn(observer, unclear_sides(parts.source, left))
    if parts.attached:
        observer.remark(ModelledFound(parts.attached))
    if parts.passing:
        observer.remark(PassingFound(parts.passing))


def _part(number: int) -> str:
    return f" part {number}" if number else ""


def _triangles(
    contacts: NDArray[np.integer], number: NDArray[np.integer], count: int
) -> NDArray[np.int64]:
    """Return how many triangles the contacts (K, 2) of each number (K,) have, (count,)."""
    each = np.unique(np.column_stack([np.repeat(number, 2), contacts.reshape(-1)]), axis=0)
    return np.bincount(each[:, 0], minlength=count)
