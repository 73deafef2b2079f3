"""What `dtrepair repair` says: its plan, each frame, the table."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.modelled_text import pairs_told, print_faults
from dtrepair.cli.terminal.strain_text import frames_of, strain_lines
from dtrepair.diagnosis import Status, concerns
from dtrepair.pipeline.observer import CorrectionWritten, FrameDone
from dtrepair.pipeline.repair.records import REMEDIES
from dtrepair.pipeline.selection import NUMBERS, ObjectSettings
from dtrepair.pipeline.stages.plan import Plan
from dtrepair.pipeline.stages.sources import time_label
from dtrepair.report.parts import PairCounts, PartPairs
from dtrepair.report.record import FrameRecord, MotionRecord, summarize
from dtrepair.wording import counted, length

# So many contacts are named in a line of advice.
_NAMED = 3


def say(console: Console, done: FrameDone) -> None:
    """Tell about one frame: with -v all of them, otherwise those without a result."""
    record = done.record
    label = f"frame {time_label(record.time)}"
    if record.before is None or record.after is None:
        console.warn([f"{label}: {record.status}: {record.message}"])
        return
    # A frame of a clip is solved together with others: no iterations are its own.
    own = f"{counted(record.iterations, 'iteration')}, " if record.iterations else ""
    console.remark(
        f"{label}: {record.before.triangles} -> {record.after.triangles} triangles, "
        f"{own}{record.seconds:.2f} s, {record.status}"
    )


def correction_line(done: CorrectionWritten) -> str:
    """What a layer of corrections holds, and how large it is."""
    size = f"{done.bytes / 1e6:.2f} MB" if done.bytes >= 1e5 else f"{done.bytes / 1e3:.1f} kB"
    moved = f"{counted(done.vertices, 'point')} moved, {size}"
    if done.form == "offsets":
        return f"offsets of {counted(done.shapes, 'frame')}: {moved}"
    near = f"within {length(done.error, done.size)}"
    fewest = f", fewer than {done.least} could not" if done.least > 1 else ""
    return f"{counted(done.shapes, 'blend shape')}: {moved}; repaired points are met {near}{fewest}"


def print_plan(console: Console, plan: Plan) -> None:
    """Print what a run would do; without an output it counts."""
    rows = [
        [
            mesh.path,
            str(mesh.vertices),
            str(mesh.triangles),
            described(mesh.settings, collider=mesh.collider),
            mesh.rest,
        ]
        for mesh in plan.meshes
    ]
    console.table(["mesh", "vertices", "triangles", "role", "rest pose"], rows)
    for name in ("attach", "detach", "ignore"):
        for pair in getattr(plan.objects, name):
            console.result(f"--{name} {pair}")
    console.result(planned_line(plan))


def planned_line(plan: Plan) -> str:
    """Say which frames a run would count or write, and that an older output would be replaced."""
    end = "counted" if plan.output is None else f"written to {plan.output}"
    if plan.output is not None and os.path.isfile(plan.output):
        end += ", which exists and would be replaced"
    return f"{frames_text(plan.times)} would be {end}"


def frames_text(times: Sequence[float]) -> str:
    """How many frames there are, with the first and the last of them."""
    labels = [time_label(time) for time in times] or ["none"]
    ends = labels[0] if len(labels) == 1 else f"{labels[0]} to {labels[-1]}"
    return f"{counted(len(times), 'frame')} ({ends})"


def described(own: ObjectSettings, *, collider: bool) -> str:
    """What an object does, in a word or two."""
    if collider:
        return "collider"
    role = "rigid" if own.rigid else "repaired"
    told = [f"{name} {getattr(own, name):g}" for name in NUMBERS if getattr(own, name) is not None]
    told += [] if own.layer is None else [f"layer {own.layer}"]
    told += [f"attached to {' and '.join(own.attach)}"] if own.attach else []
    told += [f"not attached to {' and '.join(own.detach)}"] if own.detach else []
    return ", ".join([role, *told])


def print_met(console: Console, totals: Mapping[str, Any], *, checked: bool = False) -> None:
    """Print what met what, by the totals of a report; checked: whether nothing was repaired.

    Of a single mesh, and with -v, which of its connected parts, and where.
    """
    print_contacts(console, totals["contacts"], checked=checked)
    if "faults" in totals and (not totals["contacts"] or console.verbosity > 0):
        found, single = PartPairs.from_document(totals["faults"]), not totals["contacts"]
        print_faults(console, found, single=single, checked=checked)


def print_contacts(
    console: Console, contacts: Sequence[Mapping[str, Any]], *, checked: bool = False
) -> None:
    """Print what met what, with most first; checked: whether nothing was repaired.

    What meets more than before is marked.
    """
    if not contacts:
        return
    rows = []
    for found in sorted(contacts, key=lambda own: (-own["after"], -own["before"])):
        counts = PairCounts(pairs_before=found["before"], pairs_after=found["after"])
        rows.append([*pairs_told(counts, checked=checked), found["first"], found["second"]])
    console.result("what met what, in all frames together:")
    header = ["pairs"] if checked else ["pairs before", "after"]
    console.table([*header, "of", "and"], rows)


def _print_moves(console: Console, records: tuple[FrameRecord, ...]) -> None:
    """Print who of several objects was moved, the farthest first."""
    moves = []
    for path, motions in motions_of(records).items():
        largest = max(((own.displacement_max, size) for own, size in motions), key=_span)
        rigid = max(((own.rigid_rms, size) for own, size in motions), key=_span)
        change = max(motion.edge_change for motion, _ in motions)
        moves.append((_span(largest), [length(*largest), length(*rigid), f"{change:.4f}", path]))
    if moves:
        rows = [row for _, row in sorted(moves, key=lambda move: -move[0])]
        console.result("how far meshes moved, the most in any frame:")
        console.table(["largest move", "as a whole", "edges changed", "mesh"], rows)


def motions_of(
    records: tuple[FrameRecord, ...],
) -> dict[str, list[tuple[MotionRecord, float | None]]]:
    """How each mesh that was moved, of several ones, moved in the frames, and its size there."""
    found: dict[str, list[tuple[MotionRecord, float | None]]] = {}
    for prim in (prim for record in records for prim in record.prims):
        if prim.motion is not None:
            found.setdefault(prim.path, []).append((prim.motion, prim.size))
    return found


def largest_move(record: FrameRecord) -> str:
    """The largest move of a frame, with its share of the size of the mesh that moved so far."""
    return "0" if record.displacement_max == 0.0 else length(*_farthest(record)[:2])


def _farthest(record: FrameRecord) -> tuple[float, float | None, str]:
    """How far a frame moved what moved farthest, as a fraction of its size, that size, its path."""
    moved = [
        (prim.motion.displacement_max, prim.size, prim.path)
        for prim in record.prims
        if prim.motion is not None
    ]
    only = record.prims[0]
    return max(moved, key=_span, default=(record.displacement_max, only.size, only.path))


def _span(own: tuple[float, float | None] | tuple[float, float | None, str]) -> float:
    """A fraction of a size in stage units, where the size is known."""
    return own[0] * (own[1] or 1.0)


def print_table(console: Console, records: tuple[FrameRecord, ...], output: str) -> None:
    """Print one row for each frame that was not clean from the start, and the totals."""
    rows = []
    for record in records:
        label = time_label(record.time)
        if record.before is None or record.after is None:
            rows.append([label, "", "", "", record.status])
        elif record.before.pairs:
            numbers = [str(record.before.triangles), str(record.after.triangles)]
            rows.append([label, *numbers, largest_move(record), record.status])
    if rows:
        console.table(["frame", "before", "after", "largest move", "status"], rows)
    if moved := moved_line(records):
        console.result(moved)
    totals = summarize(records)
    print_met(console, totals)
    _print_moves(console, records)
    modelled = totals["modelled_pairs_after"]
    but = " of all but modelled contacts" if modelled else ""
    console.result(
        f"{totals['clean']} of {counted(totals['frames'], 'frame')} clean{but}: "
        f"{totals['triangles_before']} -> {totals['triangles_after']} intersecting triangles"
    )
    if modelled:
        console.result(
            f"taken as modelled: {totals['modelled_pairs_before']} -> {counted(modelled, 'pair')} "
            "between attached parts, which overlap on purpose"
        )
    if totals["strained"]:
        console.result(strained_line(records))
    if close := clearance_line(records):
        console.result(close)
    for line in (*strain_lines(records), *advice_lines(records)):
        console.result(line)
    same = all(record.displacement_max == 0.0 for record in records)
    console.result(f"written: {output}{'; no point of it moved' if same else ''}")


def moved_line(records: Sequence[FrameRecord]) -> str:
    """Which frames of a clip move though nothing intersects in them; empty if none does."""
    eased = [
        own
        for own in records
        if own.before is not None and own.before.pairs == 0 and own.displacement_max > 0.0
    ]
    if not (where := frames_of(eased)):
        return ""
    worst = max(eased, key=lambda own: _span(_farthest(own)))
    share, size, path = _farthest(worst)
    farthest = f"{length(share, size)} in {frames_of([worst])}, {path}"
    return f"moved, though nothing intersects there: {where}; by up to {farthest}"


def clearance_line(records: Sequence[FrameRecord]) -> str:
    """In how many frames pairs stay closer than the clearance; empty if in none."""
    close = sum(record.left.too_close > 0 for record in records)
    every = counted(len(records), "frame")
    return f"--clearance is not reached in {close} of {every}" if close else ""


def strained_line(records: Sequence[FrameRecord]) -> str:
    """How many frames are strained, and how many of them are left as they came."""
    strained = [own for own in records if own.status == Status.STRAINED]
    still = sum(own.displacement_max == 0.0 for own in strained)
    left = f", of which {still} {'is' if still == 1 else 'are'} left as before" if still else ""
    return f"{counted(len(strained), 'frame')} strained{left}: see the lines below"


def in_frames(records: Sequence[FrameRecord]) -> str:
    """In which frames something is; nothing for a pose without a time."""
    where = frames_of(records)
    return f"in {where} " if where else ""


def advice_lines(records: Sequence[FrameRecord]) -> Iterator[str]:
    """What is left and what to do about it: one line for each kind, with its frames."""
    frames: dict[str, list[FrameRecord]] = {}
    objects: dict[str, Counter[str]] = {}
    for record in records:
        found = concerns(record.left, Status(record.status), remedies=REMEDIES)
        for advice, concerned in found.items():
            frames.setdefault(advice, []).append(record)
            objects.setdefault(advice, Counter()).update(concerned)
    for advice, own in sorted(frames.items(), key=lambda item: -len(item[1])):
        told = [text for text, _ in objects[advice].most_common()]
        more = f" and {len(told) - _NAMED} more" if told[_NAMED:] else ""
        where = in_frames(own) if len(records) > 1 else ""
        end = f": {advice}" if advice else ""
        yield f"advice: {where}{'; '.join(told[:_NAMED])}{more}{end}"
