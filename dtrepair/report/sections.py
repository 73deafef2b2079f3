"""What a report says of a transfer, and of the poses between keys."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class MarkersRecord:
    """How well markers agree with each other.

    Args:
        count: How many there are.
        distance_median: Distance from where the others put a marker, of the target's diagonal.
        distance_max: The largest of these distances.
        suspects: Markers to look at.
        swapped: Pairs of suspects that sit where the other belongs.
    """

    count: int
    distance_median: float
    distance_max: float
    suspects: tuple[int, ...] = ()
    swapped: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True, kw_only=True)
class TransferRecord:
    """What a transfer is worth; figures of the frames are None where none was usable.

    Args:
        correspondence: Where the pairs come from: "topology", "markers" or "file".
        target: The mesh that was moved.
        pairs: Pairs of triangles of source and target.
        unmatched: Target triangles without a partner.
        unmatched_area: Their fraction of the target's area.
        largest_hole: Triangles of their largest connected patch.
        source_used: Fraction of the source's triangles that are in a pair.
        root_scale: Scale of the travel.
        residual_median: Of || G x - S P || over triangles and frames; no unit.
        residual_p95: What 95 % of the residuals lie below.
        residual_max: The largest residual.
        inside_out: Fraction of triangles turned inside out, in the worst frame.
        unit_ratio: Size of the poses over that of the source's rest.
        turn_degrees: Angle between both rests.
        rest_error: The source's rest, transferred, against the target's, of its diagonal.
        markers: None without markers.
    """

    correspondence: str
    target: str
    pairs: int
    unmatched: int
    unmatched_area: float
    largest_hole: int
    source_used: float
    root_scale: float
    residual_median: float | None = None
    residual_p95: float | None = None
    residual_max: float | None = None
    inside_out: float | None = None
    unit_ratio: float | None = None
    turn_degrees: float | None = None
    rest_error: float | None = None
    markers: MarkersRecord | None = None

    def document(self) -> dict[str, Any]:
        """Return the section as plain values: dictionaries, lists and numbers."""
        document: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        return document


@dataclass(frozen=True, kw_only=True)
class SamplesRecord:
    """In-betweens that were looked at, those of them that intersect, and their pairs."""

    samples: int
    dirty: int
    pairs: int


@dataclass(frozen=True, kw_only=True)
class SpanRecord:
    """The in-betweens from one given key to the next.

    Args:
        start: Time code of the first key.
        end: Time code of the second.
        before: As the repaired keys interpolate them; those of the input, if nothing is repaired.
        after: As the output does, which has more where keys were added.
        left: Time codes of those that still intersect.
        added: Time codes of added keys.
    """

    start: float
    end: float
    before: SamplesRecord
    after: SamplesRecord
    left: tuple[float, ...] = ()
    added: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True)
class KeyposesRecord:
    """The spans between keys; `skipped` of them have a key that cannot be used."""

    interpolation: str
    skipped: int = 0
    spans: tuple[SpanRecord, ...] = ()
