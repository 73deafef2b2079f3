"""Records of modelled contacts, made up."""

from __future__ import annotations

from dtrepair.report.parts import PairCounts, PartPair, PartRecord


def part(number: int | None, path: str = "/Hero/Body") -> PartRecord:
    return PartRecord(path=path, number=number, triangles=412, centre=(0.1, 1.5, 0.0))


def record(number: int, pairs: int, after: int = 0) -> PartPair:
    counts = PairCounts(
        pairs_before=pairs, pairs_after=after, triangles_before=2 * pairs, triangles_after=after
    )
    return PartPair(
        first=part(number), second=part(number + 1), counts=counts, centre=(float(pairs), 0.0, 0.0)
    )
