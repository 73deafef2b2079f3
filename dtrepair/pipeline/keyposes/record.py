"""What a report says of the poses between keys."""

from __future__ import annotations

from dtrepair.keyposes.spans import KeyPoses, Sample
from dtrepair.report.sections import KeyposesRecord, SamplesRecord, SpanRecord


def in_betweens(found: KeyPoses, interpolation: str, skipped: int) -> KeyposesRecord:
    """Return the in-betweens for the report."""
    spans = tuple(
        SpanRecord(
            start=span.start,
            end=span.end,
            before=_counted(span.before),
            after=_counted(span.after),
            left=tuple(sample.time for sample in span.after if sample.pairs),
            added=span.added,
        )
        for span in found.spans
    )
    return KeyposesRecord(interpolation=interpolation, skipped=skipped, spans=spans)


def _counted(samples: tuple[Sample, ...]) -> SamplesRecord:
    dirty = [sample for sample in samples if sample.pairs]
    pairs = sum(sample.pairs for sample in dirty)
    return SamplesRecord(samples=len(samples), dirty=len(dirty), pairs=pairs)
