"""What is strained beyond the bounds: one line for each part and measure, with its frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dtrepair.diagnosis import KEPT, LEFT_OUT, Advice, Strain
from dtrepair.pipeline.repair.records import REMEDIES
from dtrepair.pipeline.stages.sources import time_label
from dtrepair.report.record import FrameRecord

# So many lines are told, and so many frames in a line: the report has all of them.
LINES, FRAMES = 8, 6


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


def _frames(records: Sequence[FrameRecord], worst: FrameRecord) -> str:
    """Return in which frames it is, and in which of them it is worst."""
    if worst.time is None:
        return ""
    # Two patches of a part may be beyond the bounds in one frame.
    labels = list(dict.fromkeys(time_label(record.time) for record in records))
    if len(labels) == 1:
        return f"frame {labels[0]}: "
    more = f" and {len(labels) - FRAMES} more" if len(labels) > FRAMES else ""
    listed = ", ".join(labels[:FRAMES])
    return f"frames {listed}{more}, worst in {time_label(worst.time)}: "
