"""What `dtrepair keyposes` says about keys and in-betweens."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from dtrepair.cli.terminal.console import Console, folded
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


def _rows_of_dirty(rows: Sequence[tuple[str, str, tuple[str, ...], int]]) -> list[list[str]]:
    """Return the rows of spans that were not clean: start, end, cells, and how many are dirty."""
    found: list[list[str]] = []
    for dirty, run in groupby(rows, key=lambda row: bool(row[3])):
        found += folded([row[:3] for row in run], each=", each") if dirty else []
    return found


def print_spans(console: Console, report: Report) -> None:
    """Print the spans that were not clean, those that say the same in one row, and what is left."""
    assert report.keyposes is not None
    spans, mended = report.keyposes.spans, report.output is not None
    rows = []
    for span in spans:
        looks = (span.before, span.after) if mended else (span.before,)
        cells = [f"{found.dirty} of {found.samples}" for found in looks]
        cells += [", ".join(time_label(time) for time in span.added) or "-"] if mended else []
        rows.append((time_label(span.start), time_label(span.end), tuple(cells), span.before.dirty))
    if any(dirty for *_, dirty in rows):
        # The input may have had more: its keys are repaired first.
        looked = ["dirty with repaired keys", "dirty in the output", "added keys"]
        header = ["in-betweens", *(looked if mended else ["dirty"])]
        console.table(header, _rows_of_dirty(rows))
    left = [time for span in spans for time in span.left]
    total = sum(span.after.samples for span in spans)
    if total:
        dirty, looked_at = (
            sum(getattr(span.before, name) for span in spans) for name in ("dirty", "samples")
        )
        alone = f"; with repaired keys alone {looked_at - dirty} of {looked_at}"
        console.result(f"{total - len(left)} of {total} in-betweens clean{alone if mended else ''}")
    else:
        console.result("no in-betweens: no two neighbouring keys are looked at")
    if skipped := report.keyposes.skipped:
        console.warn([f"{counted(skipped, 'span')} with an unusable key or frame: not looked at"])
    if left:
        times = ", ".join(time_label(time) for time in left[:8]) + (" ..." if left[8:] else "")
        if mended:
            times = f"{times}; dtrepair repair, which solves every frame, may do better"
        console.result(f"{'still ' if mended else ''}intersecting at {times}")
