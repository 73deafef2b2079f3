"""What a report says of the poses between keys."""

from __future__ import annotations

from typing import Any

from dtrepair.keyposes.spans import KeyPoses, Sample


def in_betweens(found: KeyPoses, interpolation: str, skipped: int) -> dict[str, Any]:
    """Return the in-betweens for the report."""

    def count(samples: tuple[Sample, ...]) -> dict[str, int]:
        dirty = [sample for sample in samples if sample.pairs]
        pairs = sum(sample.pairs for sample in dirty)
        return {"samples": len(samples), "dirty": len(dirty), "pairs": pairs}

    spans = [
        {
            "start": span.start,
            "end": span.end,
            "before": count(span.before),
            "after": count(span.after),
            "left": [sample.time for sample in span.after if sample.pairs],
            "added": list(span.added),
        }
        for span in found.spans
    ]
    return {"interpolation": interpolation, "skipped": skipped, "spans": spans}
