"""What `dtrepair check` says: a row for each frame, what met what, what lies inside, the sum."""

from __future__ import annotations

from collections.abc import Sequence

from dtrepair.cli.terminal.console import Console, folded
from dtrepair.cli.terminal.repair_text import print_met
from dtrepair.cli.terminal.strain_text import frames_of
from dtrepair.pipeline.stages.sources import time_label
from dtrepair.report.record import FrameRecord, Report, summarize
from dtrepair.wording import counted

# So many pairs of meshes are named that lie inside each other.
NAMED = 5


def print_check(console: Console, report: Report) -> None:
    """Print the frames, those in a row that have the same in one row, and what met what.

    With -v each frame has a row, and each mesh of it that intersects.
    """
    several, records = len(report.prims) > 1, report.frames
    each, fold = several and console.verbosity > 0, console.verbosity == 0
    header = ["frame", "triangles", "pairs", *(["between meshes"] if several else [])]
    rows = []
    for record in records:
        label = time_label(record.time)
        blank = ("",) * (len(header) - 2)
        if record.before is None:
            rows.append((label, label, (record.status, *blank, *([""] if each else []))))
            continue
        every = [("all", record.before), *((p.path, p.before) for p in record.prims if p.before)]
        for path, count in every if each else every[:1]:
            if path == "all" or count.pairs:
                numbers = (str(count.triangles), str(count.pairs), str(count.inter_pairs))
                cells = (*numbers[: len(header) - 1], *([path] if each else []))
                rows.append((label, label, cells))
    console.warn(_unusable_lines(records))
    console.table(
        [*header, *(["mesh"] if each else [])], folded(rows, each=", each of {}", fold=fold)
    )
    if each and any(record.before and record.before.inter_pairs for record in records):
        console.result("a pair between two meshes is counted in the row of either, and once in all")
    print_met(console, summarize(records), checked=True)
    for line in enclosed_lines(records):
        console.result(line)
    console.result(_conclusion(records, every=report.settings.get("rest_contacts") == "repair"))


def _unusable_lines(records: Sequence[FrameRecord]) -> list[str]:
    """Why frames could not be used; what is blocked is told once, with its frames."""
    told: dict[str, list[FrameRecord]] = {}
    for record in records:
        if record.before is None:
            told.setdefault(record.message, []).append(record)
    lines = []
    for message, own in told.items():
        # What failed names its frame itself.
        where = frames_of(own) if own[0].status == "skipped" else ""
        lines.append(f"{message} in {where}" if where else message)
    return lines


def _conclusion(records: tuple[FrameRecord, ...], *, every: bool) -> str:
    """Return what was found in all; every: whether nothing was left out as modelled."""
    counts = [record.before for record in records if record.before is not None]
    hit = sum(count.pairs > 0 for count in counts)
    triangles = sum(count.triangles for count in counts)
    pairs = sum(count.pairs for count in counts)
    failed = sum(record.status == "failed" for record in records)
    ending = f"; {counted(failed, 'frame')} could not be used" if failed else ""
    modelled = sum(count.modelled_pairs for count in counts)
    if modelled:
        ending = f", beside {counted(modelled, 'pair')} that were modelled{ending}"
    if not hit:
        return f"no intersections in {counted(len(counts), 'frame')}{ending}"
    verb = "intersects" if hit == 1 else "intersect"
    return (
        f"{hit} of {counted(len(counts), 'frame')} {verb}: {counted(triangles, 'triangle')}, "
        f"{counted(pairs, 'pair')}{', every contact counted' if every else ''}{ending}"
    )


def enclosed_lines(records: Sequence[FrameRecord]) -> list[str]:
    """Sentences about what lies wholly inside what, and in which frames."""
    frames: dict[tuple[str, str], list[FrameRecord]] = {}
    for record in records:
        for found in record.enclosed or ():
            frames.setdefault((found.inner, found.outer), []).append(record)
    told, looked = [], sum(record.enclosed is not None for record in records)
    for (inner, outer), own in list(frames.items())[:NAMED]:
        what = f"{inner} lies wholly inside {outer}"
        if inner == outer:
            most = max(
                f.parts for r in own for f in r.enclosed or () if f.inner == f.outer == inner
            )
            who, lie = ("a part", "lies") if most == 1 else (f"{most} parts", "lie")
            what = f"{who} of {inner} {lie} wholly inside another part of it"
        when = f" in {frames_of(own)}"
        if len(own) == looked:
            when = " in every frame" if looked > 1 else ""
        told.append(f"{what}{when}")
    if len(frames) > NAMED:
        told.append(f"{len(frames) - NAMED} more lie wholly inside others")
    return told
