"""What a terminal sees of connected parts: which met, what is modelled, what is worn."""

from __future__ import annotations

from collections.abc import Sequence

from dtrepair.cli.terminal.console import Console
from dtrepair.report.parts import (
    AttachedList,
    AttachedRecord,
    PairCounts,
    PartPair,
    PartPairs,
    PartRecord,
    PassingRecord,
    WornRecord,
    place,
)
from dtrepair.report.record import Report
from dtrepair.wording import NAMED, counted, listed


def print_modelled(console: Console, report: Report) -> None:
    """Print each pair of parts whose contacts are modelled: where, how many, in which pose.

    The numbers are those of the pose that shows it, and of the frame with most pairs, where that
    is known: each frame lists the pairs of parts with most. What meets in frames only is there too.
    """
    for passing in report.passing:
        console.result(f"not modelled, passing: {_names(passing)}")
    attached, most = report.attached, _most(report)
    unlisted = "?" if any(frame.modelled.others.parts for frame in report.frames) else "0"
    rows = []
    for record in attached.listed:
        frame = most.pop((record.first.name, record.second.name), None)
        number = unlisted if frame is None else str(frame.counts.pairs_before)
        where = place(record.centre)
        rows.append([str(record.pairs), number, record.pose, where, _names(record)])
    for frame in most.values():
        number = str(frame.counts.pairs_before)
        rows.append(["0", number, "frames only", place(frame.centre), _names(frame)])
    if not rows:
        console.result("nothing is taken as modelled")
        return
    width = max(len(row[-1]) for row in rows)
    header = ["pairs", "most in a frame", "as in", "around", "modelled contacts of".ljust(width)]
    console.table(header, [[*row[:-1], row[-1].ljust(width)] for row in rows])
    if any(row[1] == "?" for row in rows):
        console.result(
            "?: a frame lists the pairs of parts that have most, and this one was in no such list"
        )
    if attached.others:
        console.result(
            f"and {counted(attached.others, 'more pair')} of parts, "
            f"with {counted(attached.other_pairs, 'pair')} of triangles"
        )


def print_faults(console: Console, found: PartPairs, *, single: bool, checked: bool) -> None:
    """Print which connected parts met which in all frames together, and where in the worst one.

    single: whether all are of one mesh, which is named once; checked: whether nothing was repaired.
    """

    def name(part: PartRecord) -> str:
        return f"part {part.number}" if single else part.name

    rows = []
    for record in found.listed:
        both = name(record.first), "itself" if record.itself else name(record.second)
        counts = pairs_told(record.counts, checked=checked)
        rows.append([*counts, place(record.centre), *both])
    if others := found.others.parts:
        counts = pairs_told(found.others.counts, checked=checked)
        rows.append([*counts, "", counted(others, "other pair"), "of parts"])
    of = f" of {found.listed[0].first.path}" if single else ""
    console.result(
        f"which parts{of} met which, in all frames together (1 is the part with most triangles):"
    )
    header = ["pairs"] if checked else ["pairs before", "after"]
    console.table([*header, "around", "of", "and"], rows)


def pairs_told(counts: PairCounts, *, checked: bool) -> list[str]:
    """Return what rows tell of pairs: how many, and after a repair that as well; more is marked."""
    before, after = counts.pairs_before, counts.pairs_after
    return [str(before)] if checked else [str(before), f"{after}{' (more)' * (after > before)}"]


def print_worn(console: Console, report: Report) -> None:
    """Print what a repair would take as worn, a line for each pair of parts."""
    grouped = dict[tuple[str, str], list[WornRecord]]()
    for record in report.worn:
        grouped.setdefault((record.over.path, record.under.path), []).append(record)
    for (over, under), own in grouped.items():
        lines = [f"worn: {record.over} over {record.under}" for record in own]
        summary = f"worn: parts of {over} over parts of {under}, {counted(len(own), 'pair')}"
        for line in lines if len(lines) <= NAMED else [summary]:
            console.result(line)
    if not report.worn:
        console.result(
            "no open sheet would be taken as worn; what is closed, as rings or coats, is led too"
        )


def modelled_line(attached: AttachedList) -> str:
    """Say in one line what is taken as modelled, and what changes that."""
    names = [f"{record.first.name} with {record.second.name}" for record in attached.listed[:NAMED]]
    more = len(attached) - len(names)
    return (
        f"taken as modelled: {counted(len(attached), 'pair')} of parts: {', '.join(names)}"
        f"{f' and {more} more' if more else ''}; --rest-contacts repair treats them as faults, "
        "--attach, --detach and --ignore override, check --modelled lists them"
    )


def passing_line(parts: Sequence[PassingRecord]) -> str:
    """Say in one line which parts only pass each other in the bind pose, and what changes that."""
    names = listed([f"{own.first.name} with {own.second.name}" for own in parts])
    return (
        f"not taken as modelled: {names}, which meet in the bind pose and lie elsewhere in nearly "
        "all frames; --attach overrides"
    )


def worn_line(worn: Sequence[WornRecord]) -> str:
    """Say in one line which parts are taken as worn, and what changes that."""
    names = listed([f"{record.over.name} over {record.under.name}" for record in worn])
    means = {record.over.path == record.under.path for record in worn}
    told = {False: "--layer", True: "primvars:dtrepair:layer for each face"}
    ways = " or ".join(told[one] for one in sorted(means))
    return f"taken as worn: {names}; another order with {ways}"


def sets_line(paths: Sequence[str]) -> str:
    """Say in one line what is taken as a set around, and what changes that."""
    return (
        f"taken as a set that does not move: {listed(paths)}; a mobility of its own, "
        "[[prim]] of --config or primvars:dtrepair:mobility, lets it give way"
    )


def props_line(paths: Sequence[str]) -> str:
    """Say in one line what is taken as props, and what changes that."""
    return (
        f"taken as props that keep their shape: {listed(paths)}; rigid = false, [[prim]] of "
        "--config or primvars:dtrepair:rigid, lets them bend"
    )


def _names(record: PartPair | AttachedRecord | PassingRecord) -> str:
    return f"{record.first} with {record.second}"


def _most(report: Report) -> dict[tuple[str, str], PartPair]:
    """Return for two parts the record of the frame in which they have most pairs."""
    most: dict[tuple[str, str], PartPair] = {}
    for frame in report.frames:
        for record in frame.modelled.listed:
            names = record.first.name, record.second.name
            if names not in most or record.counts.pairs_before > most[names].counts.pairs_before:
                most[names] = record
    return most
