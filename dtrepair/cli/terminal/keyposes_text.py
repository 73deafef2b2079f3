"""What `dtrepair keyposes` says about keys and in-betweens."""

from __future__ import annotations

from dtrepair.cli.terminal.console import Console
from dtrepair.pipeline.stages.sources import time_label
from dtrepair.report.record import FrameRecord, Report
from dtrepair.wording import counted


def print_keys(console: Console, records: tuple[FrameRecord, ...]) -> None:
    """Print the keys that intersect, or could not be used, where they are only counted."""
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
    spans, mended = report.keyposes.spans, report.output is not None
    rows = []
    for span in spans:
        if span.before.dirty:
            label = f"{time_label(span.start)} to {time_label(span.end)}"
            looks = (span.before, span.after) if mended else (span.before,)
            row = [label, *(f"{found.dirty}/{found.samples}" for found in looks)]
            added = ", ".join(time_label(time) for time in span.added) or "-"
            rows.append([*row, added] if mended else row)
    if rows:
        after = ["dirty before", "dirty after", "added keys"] if mended else ["dirty"]
        console.table(["in-betweens", *after], rows)
    left = [time for span in spans for time in span.left]
    total = sum(span.after.samples for span in spans)
    if total:
        console.result(f"{total - len(left)} of {total} in-betweens clean")
    else:
        console.result("no in-betweens: no two neighbouring keys are looked at")
    if skipped := report.keyposes.skipped:
        console.warn([f"{counted(skipped, 'span')} with an unusable key or frame: not looked at"])
    if left:
        times = ", ".join(time_label(time) for time in left[:8]) + (" ..." if left[8:] else "")
        if mended:
            times = f"{times}; dtrepair repair, which solves every frame, may do better"
        console.result(f"{'still ' if mended else ''}intersecting at {times}")
