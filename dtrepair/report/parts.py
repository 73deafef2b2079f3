"""What a report says of contacts by pairs of connected parts: how many, and where."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

# So many pairs of parts are listed for a frame and for a run; so many as attached, and of what is
# modelled in each frame where a check is asked for that.
LISTED = 20
LISTED_ATTACHED = 200

Point = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class PartRecord:
    """A connected part of a mesh.

    Args:
        path: Prim path of the mesh.
        number: 1 for the part with most triangles, and so on; None where the mesh is one part.
        triangles: How many triangles it has.
        centre: Middle of its bounding box, as the mesh lies at the start of the clip before
            anything deforms it; stage units, world space.
    """

    path: str
    number: int | None
    triangles: int
    centre: Point

    @property
    def name(self) -> str:
        """The path, with the number where the mesh has several parts."""
        return self.path if self.number is None else f"{self.path} part {self.number}"

    def __str__(self) -> str:
        """Return the name; of one of several parts with what finds it again."""
        if self.number is None:
            return self.name
        return f"{self.name} ({self.triangles} triangles, around {place(self.centre)})"

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> PartRecord:
        """Return the part that a document was made of, read from JSON."""
        return cls(**{**document, "centre": _point(document["centre"])})


@dataclass(frozen=True)
class PairCounts:
    """Pairs of triangles that meet, in the input and in the result, and triangles.

    Triangles are all that are in these pairs: one that is in contacts of several pairs of parts
    counts with each of them, and is in the sum of the others several times.
    """

    pairs_before: int = 0
    pairs_after: int = 0
    triangles_before: int = 0
    triangles_after: int = 0


@dataclass(frozen=True, kw_only=True)
class PartPair:
    """Contacts of two connected parts, or of one with itself; centre: stage units, world."""

    first: PartRecord
    second: PartRecord
    counts: PairCounts
    centre: Point

    @property
    def itself(self) -> bool:
        """Whether a part met itself."""
        return self.first.name == self.second.name


@dataclass(frozen=True, kw_only=True)
class OtherPartPairs:
    """The sum of what a list leaves out: so many pairs of parts."""

    parts: int = 0
    counts: PairCounts = field(default_factory=PairCounts)


@dataclass(frozen=True, kw_only=True)
class PartPairs:
    """Contacts by pairs of connected parts, those with most left first, the rest summed."""

    listed: tuple[PartPair, ...] = ()
    others: OtherPartPairs = field(default_factory=OtherPartPairs)

    def __bool__(self) -> bool:
        """Whether anything met."""
        return self != PartPairs()

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> PartPairs:
        """Return the list that a document was made of, read from JSON."""
        others = document["others"]
        return cls(
            listed=tuple(
                PartPair(
                    first=PartRecord.from_document(item["first"]),
                    second=PartRecord.from_document(item["second"]),
                    counts=PairCounts(**item["counts"]),
                    centre=_point(item["centre"]),
                )
                for item in document["listed"]
            ),
            others=OtherPartPairs(parts=others["parts"], counts=PairCounts(**others["counts"])),
        )


@dataclass(frozen=True, kw_only=True)
class AttachedRecord:
    """Two parts whose contacts are modelled, and the pose that shows it.

    Args:
        first: One part.
        second: The other.
        pairs: How many pairs of their triangles intersect in that pose.
        pose: Which pose, in words: "bind pose", or a frame.
        centre: Middle of these triangles there, stage units, world space.
    """

    first: PartRecord
    second: PartRecord
    pairs: int
    pose: str
    centre: Point


@dataclass(frozen=True, kw_only=True)
class AttachedList:
    """Pairs of parts whose contacts are modelled, those with most first, the rest summed.

    others: how many more pairs of parts; other_pairs: how many pairs of triangles those have.
    """

    listed: tuple[AttachedRecord, ...] = ()
    others: int = 0
    other_pairs: int = 0

    def __len__(self) -> int:
        """Number of pairs of parts."""
        return len(self.listed) + self.others

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> AttachedList:
        """Return the list that a document was made of, read from JSON."""
        records = (
            AttachedRecord(
                first=PartRecord.from_document(item["first"]),
                second=PartRecord.from_document(item["second"]),
                pairs=item["pairs"],
                pose=item["pose"],
                centre=_point(item["centre"]),
            )
            for item in document["listed"]
        )
        return cls(
            listed=tuple(records), others=document["others"], other_pairs=document["other_pairs"]
        )


@dataclass(frozen=True, kw_only=True)
class PassingRecord:
    """Two parts that only pass each other in the bind pose, so that nothing of it is modelled."""

    first: PartRecord
    second: PartRecord


@dataclass(frozen=True, kw_only=True)
class WornRecord:
    """A part that is taken as worn, and the part that it lies over."""

    over: PartRecord
    under: PartRecord


def parts_of(document: Mapping[str, Any]) -> dict[str, PartRecord]:
    """Return the parts that a record of two of them is made of, from its document."""
    return {name: PartRecord.from_document(part) for name, part in document.items()}


def summed(counts: Iterable[PairCounts]) -> PairCounts:
    """Return the sum of counts, number by number."""
    rows = [vars(each) for each in counts]
    return PairCounts(**{name: sum(row[name] for row in rows) for name in vars(PairCounts())})


def bounded(
    records: Sequence[PartPair], others: OtherPartPairs | None = None, *, most: int = LISTED
) -> PartPairs:
    """Return the first `most` of the records as a list, with the rest added to `others`."""
    rest = others or OtherPartPairs()
    left_out = records[most:]
    counts = summed([rest.counts, *(record.counts for record in left_out)])
    return PartPairs(
        listed=tuple(records[:most]),
        others=OtherPartPairs(parts=rest.parts + len(left_out), counts=counts),
    )


def over_frames(lists: Iterable[PartPairs]) -> PartPairs:
    """Return the sums over frames, each place that of the frame with most pairs.

    What a frame leaves out of its list is among the others here, with the largest number of pairs
    of parts that one frame leaves out.
    """
    found: dict[tuple[str, str], list[PartPair]] = {}
    others: list[OtherPartPairs] = []
    for each in lists:
        others.append(each.others)
        for record in each.listed:
            found.setdefault((record.first.name, record.second.name), []).append(record)
    records = []
    for same in found.values():
        most = max(same, key=_most)
        records.append(
            PartPair(
                first=most.first,
                second=most.second,
                counts=summed(record.counts for record in same),
                centre=most.centre,
            )
        )
    records.sort(key=_by_left)
    rest = OtherPartPairs(
        parts=max((each.parts for each in others), default=0),
        counts=summed([PairCounts(), *(each.counts for each in others)]),
    )
    return bounded(records, rest)


def place(centre: Sequence[float]) -> str:
    """Return a position in words: its coordinates."""
    return " ".join(f"{value:.10g}" for value in centre)


def _most(record: PartPair) -> int:
    return max(record.counts.pairs_before, record.counts.pairs_after)


def _by_left(record: PartPair) -> tuple[int, int]:
    return -record.counts.pairs_after, -record.counts.pairs_before


def _point(values: Sequence[float]) -> Point:
    x, y, z = values
    return (x, y, z)
