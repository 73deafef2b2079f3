"""A JSON report as one self-contained HTML page: advice, timeline, contacts in space, tables."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from hashlib import sha256
from html import escape
from importlib.resources import files
from typing import Any

from dtrepair.diagnosis import REMEDIES
from dtrepair.report.page.advice import Remedies, advice_box, frame_links, label, only_counts
from dtrepair.report.page.content import Contact, PageContent
from dtrepair.report.page.lengths import farthest, largest_move
from dtrepair.report.page.libraries import Library, LibraryError, chart_library, space_library
from dtrepair.report.page.meaning import meaning
from dtrepair.report.page.tables import smaller_contacts, tables
from dtrepair.report.page.timeline import chart_data

_ASSETS = files("dtrepair.report.page").joinpath("assets")


def make_page(
    report: Mapping[str, Any],
    content: PageContent = PageContent(),
    *,
    remedies: Remedies = REMEDIES,
    notes: Sequence[str] = (),
) -> str:
    """Return the HTML page of a checked report (`record.read_report`).

    Nothing in it reaches out of the page, and only its own scripts run.

    Args:
        report: Its document.
        content: Contacts and measures; the page is complete without, but has less to look at.
        remedies: What a host calls what its user may do.
        notes: What else to warn of.
    """
    libraries, missing = _libraries(content)
    title = f"dtrepair {report['command']}: {report['input']}"
    scripts = [*(library.script for library in libraries), _own_script()]
    body = [
        f"<h1>{escape(title)}</h1>",
        f"<p class=soft>{escape(_origin(report))}</p>",
        _totals(report),
        advice_box(report, remedies, [*notes, *missing]),
        "<h2>All frames</h2>",
        "<p class=soft>Click a frame to look at it; drag to zoom, double-click to zoom out; "
        "names below switch lines on and off. Shaded: the frames of the contact below.</p>",
        "<div id=chart></div>",
        "<p id=told></p>",
        _contacts(report, content),
        smaller_contacts(report["frames"], content.contacts),
        tables(report, content.colours),
        meaning(),
        f'<script type="application/json" id=data>{_json(_data(report, content))}</script>',
        *(f"<script>{script}</script>" for script in scripts),
    ]
    styles = [*(library.style for library in libraries), _asset("page.css")]
    return (
        "<!doctype html>\n<html lang=en>\n<meta charset=utf-8>\n"
        '<meta name=viewport content="width=device-width">\n'
        f'<meta http-equiv=content-security-policy content="{_policy(scripts)}">\n'
        f"<title>{escape(title)}</title>\n<style>{''.join(styles)}</style>\n"
        + "\n".join(body)
        + "\n</html>\n"
    )


def _libraries(content: PageContent) -> tuple[list[Library], list[str]]:
    """The libraries that the page needs, and what to tell of those that are not there."""
    wanted = [chart_library]
    if any(contact.view for contact in content.contacts):
        wanted.append(space_library)
    found, missing = [], []
    for library in wanted:
        try:
            found.append(library())
        except LibraryError as error:
            missing.append(str(error))
    return found, missing


def _asset(name: str) -> str:
    return _ASSETS.joinpath(name).read_text(encoding="utf-8")


def _own_script() -> str:
    parts = "\n".join(_asset(f"{name}.js") for name in ("timeline", "viewer", "page"))
    return f'(() => {{ "use strict";\n{parts}}})();'


def _policy(scripts: Sequence[str]) -> str:
    """Return a content security policy: these scripts by their hashes, and nothing from outside."""
    hashes = (base64.b64encode(sha256(text.encode()).digest()).decode() for text in scripts)
    allowed = " ".join(f"'sha256-{each}'" for each in hashes)
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )


def _json(document: Mapping[str, Any]) -> str:
    """Return JSON that cannot end the element it is in."""
    text = json.dumps(document, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _data(report: Mapping[str, Any], content: PageContent) -> dict[str, Any]:
    contacts = [
        {
            "first": contact.frames[0],
            "last": contact.frames[1],
            "worst": contact.frames[2],
            "view": contact.view,
        }
        for contact in content.contacts
    ]
    colours = [list(colour) for colour in content.colours]
    return {**chart_data(report, content.measures), "contacts": contacts, "colours": colours}


def _origin(report: Mapping[str, Any]) -> str:
    output = f", output {report['output']}" if report["output"] else ""
    total = report["seconds"].get("total", 0.0)
    return f"version {report['version']}, {report['device']}, {total:.1f} s{output}"


def _totals(report: Mapping[str, Any]) -> str:
    summary = report["summary"]
    most = max(report["frames"], key=farthest, default=None)
    values = [("frames clean", f"{summary['clean']} of {summary['frames']}")]
    if only_counts(report):
        values.append(("intersecting triangles", f"{summary['triangles_before']}"))
    else:
        values += [
            ("triangles before", f"{summary['triangles_before']}"),
            ("triangles after", f"{summary['triangles_after']}"),
            ("largest move", "0" if most is None else largest_move(most)),
        ]
    if summary.get("strained"):
        values.append(("frames strained", str(summary["strained"])))
    if summary.get("too_close"):
        values.append(("frames closer than --clearance", str(summary["too_close"])))
    if summary["failed"]:
        values.append(("frames failed", str(summary["failed"])))
    if summary["jitter"] is not None:
        values.append(("jitter, of the size", f"{summary['jitter']:.3%}"))
    tiles = "".join(f"<div><b>{escape(v)}</b>{escape(n)}</div>" for n, v in values)
    return f"<div class=totals>{tiles}</div>"


def _contacts(report: Mapping[str, Any], content: PageContent) -> str:
    """Return the viewer, a picture of each contact, and how many have none."""
    if not content.contacts:
        return ""
    frames = report["frames"]
    shown = [contact for contact in content.contacts if contact.png or contact.view]
    choices = "".join(
        f'<option value="{number}">{escape(_name(frames, contact))}</option>'
        for number, contact in enumerate(shown)
        if contact.view
    )
    viewer = _asset("viewer.html").replace("{choices}", choices)
    figures = "".join(_figure(frames, k, contact) for k, contact in enumerate(shown))
    return f"<h2>Contacts</h2>{viewer}<div class=contacts>{figures}</div>"


def _figure(frames: Sequence[Mapping[str, Any]], number: int, contact: Contact) -> str:
    name = escape(_name(frames, contact))
    image = ""
    if contact.png:
        data = base64.b64encode(contact.png).decode()
        image = f'<img alt="{name}" src="data:image/png;base64,{data}">'
    links = frame_links(frames, range(contact.frames[0], contact.frames[1] + 1))
    worst = f'<button class=frame data-go="{contact.frames[2]}">'
    worst += f"{escape(label(frames[contact.frames[2]]))}</button>"
    look = f'<button data-contact="{number}">Look at it</button>' if contact.view else ""
    return (
        f'<figure data-contact="{number}">{image}<figcaption>{name}<br>'
        f"frames {links}, picture: frame {worst} {look}</figcaption></figure>"
    )


def _name(frames: Sequence[Mapping[str, Any]], contact: Contact) -> str:
    """Return what a contact is called: its objects, its worst frame, its triangles."""
    who = contact.between
    before, after = contact.triangles
    count = f"{before} → {after}" if after is not None else f"{before}"
    return f"{who}, frame {label(frames[contact.frames[2]])}: {count} intersecting triangles"
