"""What `dtrepair keyposes` says and reports about in-betweens."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dtrepair.cli.terminal.console import Console
from dtrepair.pipeline.errors import CLEAN, FRAMES, REMAINING
from dtrepair.pipeline.stages.sources import time_label
from dtrepair.report.record import FrameRecord, Report
from dtrepair.wording import counted

if TYPE_CHECKING:
    from dtrepair.keyposes.spans import KeyPoses, Sample

_WHEN = ("before", "after")


def in_betweens(found: KeyPoses, interpolation: str, skipped: int) -> dict[str, Any]:
    """The in-betweens for the report."""

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


def print_keys(console: Console, records: tuple[FrameRecord, ...]) -> None:
    """Print the keys that intersect, or could not be read, where they are only counted."""
    rows = []
    for record in records:
        label = time_label(record.time)
        if record.before is None:
            rows.append([label, record.status, ""])
        elif record.before.pairs:
            rows.append([label, str(record.before.triangles), str(record.before.pairs)])
    if rows:
        console.table(["key", "triangles", "pairs"], rows)
    clean = sum(record.status == "clean" for record in records)
    console.result(f"{clean} of {counted(len(records), 'key')} clean")


def print_spans(console: Console, report: Report) -> None:
    """Print the spans that were not clean, and what is left."""
    assert report.keyposes is not None
    spans = report.keyposes["spans"]
    rows = []
    for span in spans:
        if span["before"]["dirty"]:
            label = f"{time_label(span['start'])} to {time_label(span['end'])}"
            numbers = [f"{span[when]['dirty']}/{span[when]['samples']}" for when in _WHEN]
            added = ", ".join(time_label(time) for time in span["added"]) or "-"
            rows.append([label, *numbers, added])
    if rows:
        console.table(["in-betweens", "before", "after", "added keys"], rows)
    left = [time for span in spans for time in span["left"]]
    total = sum(span["after"]["samples"] for span in spans)
    console.result(f"{total - len(left)} of {total} in-betweens clean")
    if len(report.frames) > 1 and not spans and not report.keyposes["skipped"]:
        console.warn(["no in-between was looked at: --frames names no two neighbouring keys"])
    if skipped := report.keyposes["skipped"]:
        console.warn([f"{counted(skipped, 'span')} with an unusable key: not looked at"])
    if left:
        times = ", ".join(time_label(time) for time in left[:8]) + (" ..." if left[8:] else "")
        console.result(f"still intersecting at {times}")


def exit_code(report: Report) -> int:
    """Return the exit code of a run."""
    assert report.keyposes is not None
    if any(record.status == "failed" for record in report.frames):
        return FRAMES
    left = any(record.after is not None and record.after.pairs for record in report.frames)
    left = left or any(span["left"] for span in report.keyposes["spans"])
    return REMAINING if left else CLEAN
