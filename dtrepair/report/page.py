"""A JSON report as one self-contained HTML page: totals, charts per frame, pictures, table."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from dtrepair.report.modelled import ModelledList, place

_WIDTH, _HEIGHT, _LEFT, _BOTTOM = 900, 170, 64, 22

_STYLE = """
:root { color-scheme: light dark; --ink: #222; --soft: #667; --line: #d8d8de; --paper: #fbfbfd;
  --before: #9a9aa6; --after: #d3201a; --move: #2f6fbf; }
@media (prefers-color-scheme: dark) { :root { --ink: #e8e8ee; --soft: #a0a0ad; --line: #3a3a42;
  --paper: #1b1b1f; --before: #7c7c88; --after: #ff6a5e; --move: #79aef0; } }
body { font: 15px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper);
  max-width: 960px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.1rem; margin-top: 2rem; }
.totals { display: flex; flex-wrap: wrap; gap: .8rem; }
.totals div { border: 1px solid var(--line); border-radius: 8px; padding: .5rem 1rem; }
.totals b { display: block; font-size: 1.3rem; }
.soft { color: var(--soft); } svg text { fill: var(--soft); font-size: 11px; }
svg { width: 100%; height: auto; } .before { fill: var(--before); } .after { fill: var(--after); }
.move { fill: none; stroke: var(--move); stroke-width: 1.5; } .axis { stroke: var(--line); }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .15rem .8rem; text-align: right; border-bottom: 1px solid var(--line); }
th:last-child, td:last-child { text-align: left; }
.pictures { display: flex; flex-wrap: wrap; gap: 1rem; } figure { margin: 0; width: 47%; }
figure img { width: 100%; border-radius: 8px; } figcaption { color: var(--soft); }
"""


@dataclass(frozen=True)
class Picture:
    """A PNG with its caption."""

    caption: str
    png: bytes


def make_page(report: Mapping[str, Any], pictures: Sequence[Picture] = ()) -> str:
    """Return the HTML page of a checked report (`record.read_report`)."""
    title = f"dtrepair {report['command']}: {report['input']}"
    parts = [
        f"<h1>{escape(title)}</h1>",
        f"<p class=soft>{escape(_origin(report))}</p>",
        _totals(report["summary"]),
        *(f"<p>Warning: {escape(text)}</p>" for text in report["warnings"]),
        "<h2>Intersecting triangles per frame, before and after</h2>",
        _bars(report["frames"]),
        "<h2>Largest displacement per frame, of the bounding-box diagonal</h2>",
        _line(report["frames"]),
        _strains(report["frames"]),
        _objects(report),
        _modelled(report["summary"].get("modelled")),
        _transfer(report.get("transfer")),
        _pictures(pictures),
        "<h2>Frames</h2>",
        _table(report["frames"]),
        "<h2>Meshes</h2>",
        _meshes(report["prims"]),
    ]
    return (
        "<!doctype html>\n<html lang=en>\n<meta charset=utf-8>\n"
        '<meta name=viewport content="width=device-width">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n"
        + "\n".join(parts)
        + "\n</html>\n"
    )


def _origin(report: Mapping[str, Any]) -> str:
    output = f", output {report['output']}" if report["output"] else ""
    total = report["seconds"].get("total", 0.0)
    return f"version {report['version']}, {report['device']}, {total:.1f} s{output}"


def _totals(summary: Mapping[str, Any]) -> str:
    values = [
        ("frames clean", f"{summary['clean']} of {summary['frames']}"),
        ("triangles before", f"{summary['triangles_before']}"),
        ("triangles after", f"{summary['triangles_after']}"),
        ("largest displacement", f"{summary['displacement_max']:.2%}"),
    ]
    if summary.get("strained"):
        values.append(("frames strained", str(summary["strained"])))
    if summary["failed"]:
        values.append(("frames failed", str(summary["failed"])))
    if summary["jitter"] is not None:
        values.append(("jitter", f"{summary['jitter']:.2e}"))
    tiles = "".join(f"<div><b>{escape(v)}</b>{escape(n)}</div>" for n, v in values)
    return f"<div class=totals>{tiles}</div>"


def _label(frame: Mapping[str, Any]) -> str:
    return "default" if frame["time"] is None else f"{frame['time']:.10g}"


def _bars(frames: Sequence[Mapping[str, Any]]) -> str:
    counts = [(f["before"] or {}, f["after"] or {}) for f in frames]
    top = max((part.get("triangles", 0) for pair in counts for part in pair), default=0)

    def draw(x: float, width: float, index: int) -> str:
        shapes = []
        for name, part in zip(("before", "after"), counts[index], strict=True):
            height = (_HEIGHT - _BOTTOM - 8) * part.get("triangles", 0) / max(top, 1)
            y = _HEIGHT - _BOTTOM - height
            tip = f"frame {_label(frames[index])}, {name}: {part.get('triangles', 0)}"
            shapes.append(
                f'<rect class={name} x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" '
                f'height="{height:.1f}"><title>{escape(tip)}</title></rect>'
            )
        return "".join(shapes)

    return _chart(frames, f"{top}", draw)


def _line(frames: Sequence[Mapping[str, Any]]) -> str:
    values = [frame["displacement_max"] for frame in frames]
    top = max(values, default=0.0)
    scale = (_HEIGHT - _BOTTOM - 8) / (top or 1.0)
    points: list[str] = []

    def draw(x: float, width: float, index: int) -> str:
        points.append(f"{x + width / 2:.1f},{_HEIGHT - _BOTTOM - values[index] * scale:.1f}")
        last = index == len(frames) - 1
        return f'<polyline class=move points="{" ".join(points)}"/>' if last else ""

    return _chart(frames, f"{top:.2%}", draw)


def _chart(
    frames: Sequence[Mapping[str, Any]], top: str, draw: Callable[[float, float, int], str]
) -> str:
    """Return an SVG with one slot for each frame, filled by `draw(x, width, index)`."""
    slot = (_WIDTH - _LEFT) / max(len(frames), 1)
    every = max(1, -(-len(frames) // 15))
    base = _HEIGHT - _BOTTOM
    shapes = [
        f'<line class=axis x1="{_LEFT}" y1="{base}" x2="{_WIDTH}" y2="{base}"/>',
        f'<text x="{_LEFT - 6}" y="14" text-anchor="end">{escape(top)}</text>',
        f'<text x="{_LEFT - 6}" y="{base}" text-anchor="end">0</text>',
    ]
    for index, frame in enumerate(frames):
        x = _LEFT + index * slot
        shapes.append(draw(x + 0.1 * slot, 0.8 * slot, index))
        if index % every == 0:
            middle = x + slot / 2
            shapes.append(
                f'<text x="{middle:.1f}" y="{_HEIGHT - 6}" text-anchor="middle">'
                f"{escape(_label(frame))}</text>"
            )
    return f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role=img>{"".join(shapes)}</svg>'


def _transfer(section: Mapping[str, Any] | None) -> str:
    """Coverage, residuals and markers of a transfer."""
    if section is None:
        return ""
    markers = section["markers"] or {}
    suspects = ", ".join(str(index) for index in markers.get("suspects", ())) or "none"
    values = {
        "triangle pairs": section["pairs"],
        "paired by": section["correspondence"],
        "target triangles without a partner": section["unmatched"],
        "largest patch of them": section["largest_hole"],
        "part of the source's triangles used": f"{section['source_used']:.1%}",
        "scale of the travel": f"{section['root_scale']:.3g}",
        "residual, median": _rounded(section["residual_median"]),
        "residual, 95 % below": _rounded(section["residual_p95"]),
        "triangles inside out, worst frame": _rounded(section["inside_out"]),
        "size of the poses over the rest": _rounded(section["unit_ratio"]),
        "degrees between the rests": _rounded(section["turn_degrees"]),
    }
    if markers:
        values |= {
            "markers": markers["count"],
            "marker distance, median and largest": f"{markers['distance_median']:.1%}, "
            f"{markers['distance_max']:.1%}",
            "markers to look at": suspects,
        }
    rows = [[str(value), name] for name, value in values.items()]
    return "<h2>Transfer</h2>" + _html_table(["", "of the transfer"], rows)


def _objects(report: Mapping[str, Any]) -> str:
    """Of several objects: what met what, and how far each was moved at most."""
    contacts = report["summary"].get("contacts", ())
    if len(report["prims"]) < 2:
        return ""
    met = [[str(c["before"]), str(c["after"]), f"{c['first']} and {c['second']}"] for c in contacts]
    moved: dict[str, dict[str, float]] = {}
    for frame in report["frames"]:
        for prim in frame["prims"]:
            for name, value in (prim.get("motion") or {}).items():
                largest = moved.setdefault(prim["path"], {})
                largest[name] = max(largest.get(name, 0.0), value)
    names = ("displacement_max", "rigid_rms", "edge_change", "edge_distortion")
    rows = [[*(f"{largest[n]:.4f}" for n in names), path] for path, largest in moved.items()]
    header = ["largest move", "as a whole (rms)", "edges against input", "edges against rest", ""]
    ignored = report["settings"].get("ignore") or ()
    note = f"<p>Not counted: contacts of {escape('; '.join(ignored))}</p>" if ignored else ""
    tables = [_html_table(["pairs before", "after", "between"], met)] if met else []
    tables += [_html_table(header, rows)] if rows else []
    return f"<h2>Objects</h2>{''.join(tables) or '<p>No contacts.</p>'}{note}"


def _modelled(section: Mapping[str, Any] | None) -> str:
    """Return a table of the contacts that were modelled, by pairs of parts, over all frames."""
    if section is None:
        return ""
    every = ModelledList.from_document(section)
    rows = [
        [
            *(str(number) for number in vars(record.counts).values()),
            place(record.centre),
            f"{record.first} and {record.second}",
        ]
        for record in every.listed
    ]
    if every.others.counts.pairs_before or every.others.counts.pairs_after:
        numbers = [str(number) for number in vars(every.others.counts).values()]
        rows.append([*numbers, "", "others"])
    header = ["pairs before", "after", "triangles before", "after", "around", "between"]
    return f"<h2>Modelled contacts, which stay</h2>{_html_table(header, rows)}"


def _strains(frames: Sequence[Mapping[str, Any]]) -> str:
    """What is beyond the bounds, or would have been, frame by frame."""
    rows = []
    for frame in frames:
        for strain in frame.get("left", {}).get("strains", ()):
            place = ", ".join(f"{number:.4g}" for number in strain["place"])
            numbers = [f"{strain[name]:.4g}" for name in ("value", "bound")]
            part = f"{strain['part']} of {strain['parts']}"
            vertex = str(strain["vertex"])
            rows.append(
                [_label(frame), strain["kind"], *numbers, part, vertex, place, strain["body"]]
            )
    if not rows:
        return ""
    header = ["frame", "measure", "value", "bound", "part", "vertex", "place", "object"]
    return "<h2>Strained beyond the bounds</h2>" + _html_table(header, rows)


def _rounded(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


def _pictures(pictures: Sequence[Picture]) -> str:
    if not pictures:
        return ""
    figures = "".join(
        f'<figure><img alt="{escape(picture.caption)}" src="data:image/png;base64,'
        f'{base64.b64encode(picture.png).decode()}"><figcaption>{escape(picture.caption)}'
        "</figcaption></figure>"
        for picture in pictures
    )
    return f"<h2>Pictures</h2><div class=pictures>{figures}</div>"


def _table(frames: Sequence[Mapping[str, Any]]) -> str:
    header = ["frame", "before", "after", "largest move", "seconds", "status"]
    rows = []
    for frame in frames:
        counts = [str(frame[k]["triangles"]) if frame[k] else "" for k in ("before", "after")]
        state = frame["status"] + (f": {frame['message']}" if frame["message"] else "")
        move = f"{frame['displacement_max']:.4f}"
        rows.append([_label(frame), *counts, move, f"{frame['seconds']:.2f}", state])
    return _html_table(header, rows)


def _meshes(prims: Sequence[Mapping[str, Any]]) -> str:
    header = ["vertices", "triangles", "triangles intersecting at rest", "path"]
    names = ("vertices", "triangles", "rest_intersections")
    rows = [["" if p[n] is None else str(p[n]) for n in names] + [p["path"]] for p in prims]
    return _html_table(header, rows)


def _html_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table><tr>{head}</tr>{body}</table>"
