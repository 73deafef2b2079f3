"""What is strained beyond the bounds: one line for each part and measure, with its frames."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from dtrepair.diagnosis import KEPT, LEFT_OUT, Advice, Strain
from dtrepair.pipeline.repair.records import REMEDIES
from dtrepair.pipeline.stages.sources import time_label
from dtrepair.report.record import FrameRecord
from dtrepair.wording import frames_named

# So many lines are told: the report has all of them.
LINES = 8


def strain_lines(records: Sequence[FrameRecord]) -> Iterator[str]:
    """Yield a line for each part and measure: the worst number with its place, and the frames."""
    found: dict[tuple[object, ...], list[tuple[FrameRecord, Strain]]] = {}
    for record in records:
        for strain in record.left.strains:
            key = (strain.body, strain.part, strain.kind, record.left.left_out)
            found.setdefault(key, []).append((record, strain))
    every = sorted(found.values(), key=lambda own: -len(own))
    for own in every[:LINES]:
        record, worst = max(own, key=lambda each: each[1].value / each[1].bound)
        end = KEPT
        if record.left.left_out:
            end = f"{LEFT_OUT}; {REMEDIES[Advice.TAKE_AT_ANY_COST]}"
        yield f"strained: {_frames([each for each, _ in own], record)}{worst}: {end}"
    if len(every) > LINES:
        yield f"strained: {len(every) - LINES} more parts and measures: the report has them"


def frames_of(records: Iterable[FrameRecord]) -> str:
    """Return which frames there are, as "frame 2" or "frames 2, 12:19"; nothing without a time."""
    return frames_named(record.time for record in records if record.time is not None)


def _frames(records: Sequence[FrameRecord], worst: FrameRecord) -> str:
    """Return in which frames it is, and in which of them it is worst."""
    where = frames_of(records)
    if where.startswith("frames"):
        where += f", worst in {time_label(worst.time)}"
    return f"{where}: " if where else ""
