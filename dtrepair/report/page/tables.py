"""The tables of a page: objects, pairs of objects, strains, what was modelled, frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from dtrepair.report.page.advice import Frames, frame_links, only_counts
from dtrepair.report.page.content import Contact, pair_name
from dtrepair.report.page.lengths import largest_move, length_of
from dtrepair.report.page.sections import keyposes_table, transfer_table
from dtrepair.report.page.table import Cell, Markup, html_table
from dtrepair.report.parts import PairCounts, PartPairs, WornRecord, parts_of, place

# Of tables by pairs of parts.
_EACH = "A triangle counts with each pair of parts that it is in."
Colours = Sequence[tuple[float, float, float]]


def tables(report: Mapping[str, Any], colours: Colours = ()) -> str:
    """Return all tables of a report; colours: of the objects, as pictures have them."""
    frames, checked = report["frames"], only_counts(report)
    return "\n".join(
        (
            _objects(report, colours),
            _pairs(report),
            _strains(frames),
            _faults(report["summary"].get("faults"), checked=checked),
            _modelled(report["summary"].get("modelled"), checked=checked),
            _worn(report.get("worn", ())),
            transfer_table(report.get("transfer")),
            keyposes_table(report.get("keyposes"), checked=checked),
            _frames(frames, checked=checked),
        )
    )


def smaller_contacts(frames: Frames, contacts: Sequence[Contact]) -> str:
    """Return a table of the contacts that have no picture, folded up."""
    smaller = [contact for contact in contacts if not (contact.png or contact.view)]
    # Of one pose there is one number.
    both = any(contact.triangles[1] is not None for contact in smaller)
    rows: list[list[Cell]] = []
    for contact in smaller:
        first, last, worst = contact.frames
        links = [frame_links(frames, range(first, last + 1)), frame_links(frames, [worst])]
        counts = ["" if count is None else str(count) for count in contact.triangles]
        counts = counts if both else counts[:1]
        rows.append([*counts, *(Markup(each) for each in links), contact.between])
    if not rows:
        return ""
    counted = ["triangles before", "after"] if both else ["triangles"]
    table = html_table([*counted, "frames", "worst", "between"], rows)
    title = f"Smaller contacts ({len(rows)})"
    return f"<details><summary><h2>{title}</h2></summary>{table}</details>"


def _objects(report: Mapping[str, Any], colours: Colours) -> str:
    """Each object: its size, what intersected in all frames, how far it was moved at most."""
    frames = report["frames"]
    moved = any(prim.get("motion") for frame in frames for prim in frame["prims"])
    lengths, changes = ("displacement_max", "rigid_rms"), ("edge_change", "edge_distortion")
    looks = _looks(report)
    header = ["vertices", "triangles", "intersecting at rest"]
    header += ["in all frames"] if len(looks) == 1 else ["in all frames before", "after"]
    if moved:
        header += ["largest move", "as a whole (rms)", "edges against input", "against rest"]
    rows: list[list[Cell]] = []
    for number, prim in enumerate(report["prims"]):
        own = [p for frame in frames for p in frame["prims"] if p["path"] == prim["path"]]
        counts = [sum(p[w]["triangles"] for p in own if p[w]) for w in looks]
        rest = "" if prim["rest_intersections"] is None else str(prim["rest_intersections"])
        row: list[Cell] = [str(prim["vertices"]), str(prim["triangles"]), rest]
        row += [str(count) if own else "" for count in counts]
        if moved:
            motions = [p["motion"] for p in own if p.get("motion")]
            row += [length_of(own, name) for name in lengths]
            row += [f"{max(m[n] for m in motions):.2%}" if motions else "" for n in changes]
        rows.append([*row, Markup(_key(colours, number) + escape(prim["path"]))])
    return "<h2>Objects</h2>" + html_table([*header, "object"], rows)


def _looks(report: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what a report has counts of: before and after, or of a check the first alone."""
    return ("before",) if only_counts(report) else ("before", "after")


def _key(colours: Colours, number: int) -> str:
    """Return a patch of the colour that an object has in pictures."""
    if number >= len(colours):
        return ""
    red, green, blue = (round(255 * part) for part in colours[number])
    return f'<span class=key style="background:rgb({red},{green},{blue})"></span>'


def _pairs(report: Mapping[str, Any]) -> str:
    """Each pair of objects that met: pairs of triangles over all frames, the frames, the worst."""
    if len(report["prims"]) < 2:
        return ""
    frames, checked = report["frames"], only_counts(report)
    rows: list[list[Cell]] = []
    for met in report["summary"].get("contacts", ()):
        both = (met["first"], met["second"])
        found = {
            number: contact
            for number, frame in enumerate(frames)
            for contact in frame.get("contacts", ())
            if (contact["first"], contact["second"]) == both
        }
        worst = max(found, key=lambda k: (found[k]["after"], found[k]["before"]))
        left = [number for number, contact in found.items() if contact["after"]]
        more = ", more than before" if met["after"] > met["before"] else ""
        counts = [str(met["before"])] if checked else [str(met["before"]), f"{met['after']}{more}"]
        where = (found, [worst]) if checked else (found, left, [worst])
        links = [Markup(frame_links(frames, numbers)) for numbers in where]
        rows.append([*counts, *links, pair_name(*both)])
    ignored = report["settings"].get("ignore") or ()
    note = f"<p>Not counted: contacts of {escape('; '.join(ignored))}</p>" if ignored else ""
    header = ["pairs of triangles before", "after", "frames", "frames left", "worst", "between"]
    header = ["pairs of triangles", "frames", "worst", "between"] if checked else header
    # Captions of contacts count the triangles themselves.
    told = (
        "<p>Each triangle counts once for each triangle that it meets, summed over all frames.</p>"
    )
    table = told + html_table(header, rows) if rows else "<p>No contacts.</p>"
    return f"<h2>Pairs of objects</h2>{table}{note}"


def _strains(frames: Frames) -> str:
    """What is beyond the bounds, or would have been, frame by frame."""
    rows: list[list[Cell]] = []
    for number, frame in enumerate(frames):
        for strain in frame.get("left", {}).get("strains", ()):
            where = ", ".join(f"{each:.4g}" for each in strain["place"])
            values = [f"{strain[name]:.4g}" for name in ("value", "bound")]
            part = f"{strain['part']} of {strain['parts']}"
            link = Markup(frame_links(frames, [number]))
            told = [strain["kind"], *values, part, str(strain["vertex"]), where, strain["body"]]
            rows.append([link, *told])
    if not rows:
        return ""
    header = ["frame", "measure", "value", "bound", "part", "vertex", "place", "object"]
    return "<h2>Strained beyond the bounds</h2>" + html_table(header, rows)


def _faults(section: Mapping[str, Any] | None, *, checked: bool) -> str:
    """Return a table of the contacts that count, by pairs of parts, over all frames."""
    if section is None:
        return ""
    told = "<p>Which connected parts met, in all frames together; where, in the worst of them. "
    table = _part_pairs(section, checked=checked)
    return f"<h2>Pairs of parts</h2>{told}{_EACH}</p>{table}"


def _modelled(section: Mapping[str, Any] | None, *, checked: bool) -> str:
    """Return a table of the contacts that were modelled, by pairs of parts, over all frames."""
    if section is None:
        return ""
    told = (
        "<p>The parts stay where they meet; the numbers change as their surfaces slide in each "
        f"other. {_EACH}</p>"
    )
    table = _part_pairs(section, checked=checked)
    return f"<h2>Modelled contacts, which stay</h2>{told}{table}"


def _part_pairs(section: Mapping[str, Any], *, checked: bool) -> str:
    """Return a table of contacts by pairs of parts."""
    every = PartPairs.from_document(section)

    def numbers(counts: PairCounts) -> list[Cell]:
        before, after = counts.pairs_before, counts.pairs_after
        more = ", more than before" if after > before else ""
        triangles = counts.triangles_before, counts.triangles_after
        every = str(before), f"{after}{more}", *map(str, triangles)
        return list(every[::2] if checked else every)

    rows: list[list[Cell]] = [
        [
            *numbers(record.counts),
            place(record.centre),
            pair_name(str(record.first), str(record.second)),
        ]
        for record in every.listed
    ]
    if every.others.counts.pairs_before or every.others.counts.pairs_after:
        rows.append([*numbers(every.others.counts), "", "others"])
    header = ["pairs before", "after", "triangles before", "after"]
    header = [*(["pairs", "triangles"] if checked else header), "around", "between"]
    return html_table(header, rows)


def _worn(documents: Sequence[Mapping[str, Any]]) -> str:
    """Return a table of the parts that are taken as worn, each over another."""
    records = [WornRecord(**parts_of(own)) for own in documents]
    if not records:
        return ""
    rows = [[str(record.over), str(record.under)] for record in records]
    return f"<h2>Taken as worn</h2>{html_table(['over', 'under'], rows)}"


def _frames(frames: Frames, *, checked: bool) -> str:
    """Return a table of the frames; of those of a check what it found alone."""
    moved = [] if checked else ["largest move"]
    counted = ["triangles"] if checked else ["triangles before", "after"]
    header = ["frame", *counted, *moved, "seconds", "status"]
    rows: list[list[Cell]] = []
    for number, frame in enumerate(frames):
        looks = ("before", "after")[: len(counted)]
        counts = [str(frame[k]["triangles"]) if frame[k] else "" for k in looks]
        status = frame["status"]
        status = "intersects" if checked and status == "unchanged" else status
        state = status + (f": {frame['message']}" if frame["message"] else "")
        link = Markup(frame_links(frames, [number]))
        moves = [] if checked else [largest_move(frame)]
        rows.append([link, *counts, *moves, f"{frame['seconds']:.2f}", state])
    table = html_table(header, rows, numbered=True)
    return f"<details open><summary><h2>Frames</h2></summary>{table}</details>"
