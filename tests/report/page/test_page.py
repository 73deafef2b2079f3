"""The HTML page: self-contained, closed to the outside, with the numbers of the report."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from hashlib import sha256
from typing import Any

import pytest

from dtrepair.diagnosis import Diagnosis, RemainingContact, Strain, StrainKind
from dtrepair.report.page.advice import only_counts
from dtrepair.report.page.content import Contact, PageContent
from dtrepair.report.page.page import make_page
from dtrepair.report.record import (
    ContactRecord,
    CountRecord,
    FramePrimRecord,
    FrameRecord,
    PrimRecord,
    Report,
)
from tests.report.page.tags import parsed


def document(count: int = 40, **changes: Any) -> dict[str, Any]:
    frames = [
        FrameRecord(
            time=float(k),
            status="clean",
            before=CountRecord(triangles=10 * k, pairs=k),
            after=CountRecord(),
            displacement_max=0.001 * k,
        )
        for k in range(1, count + 1)
    ]
    values = {
        "command": "repair",
        "version": "1",
        "input": "a <b> & c.usd",
        "output": "out.usdc",
        "seconds": {"total": 2.0},
        "prims": (PrimRecord(path="/A", vertices=8, triangles=12, rest_intersections=3),),
        "frames": (*frames, FrameRecord(time=None, status="failed", message="bad <points>")),
    }
    return Report(**{**values, **changes}).document()


CONTACT = Contact(
    first="/A",
    second="/B",
    frames=(2, 6, 4),
    triangles=(12, 3),
    png=b"\x89PNG",
    view={"frames": [3, 4], "worst": 1, "arrays": [], "data": ""},
)
CONTENT = PageContent(
    contacts=(CONTACT, replace(CONTACT, png=b"", view=None, second="/A")),
    measures={"volume": [None, *[-0.01] * 40], "jitter": [None] * 41},
    colours=[(1.0, 0.5, 0.0)],
)


def test_page_is_well_formed_and_needs_nothing_else() -> None:
    page = make_page(document(), CONTENT)
    tags = parsed(page)
    assert not [tag for tag, _ in tags if tag in ("link", "iframe", "object", "base", "form")]
    assert not [a for _, a in tags if {"src", "href"} & set(a) and not a["src"].startswith("data:")]
    images = [attributes["src"] for tag, attributes in tags if tag == "img"]
    assert images == ["data:image/png;base64,iVBORw=="]


def test_only_its_own_scripts_run_and_nothing_is_loaded() -> None:
    page = make_page(document(), CONTENT)
    (policy,) = [a["content"] for tag, a in parsed(page) if "http-equiv" in a]
    assert "default-src 'none'" in policy and "connect-src" not in policy
    scripts = re.findall(r"<script>(.*?)</script>", page, flags=re.DOTALL)
    hashes = [base64.b64encode(sha256(s.encode()).digest()).decode() for s in scripts]
    assert re.findall(r"'sha256-([^']*)'", policy) == hashes
    assert [name in scripts[k] for k, name in enumerate(("uPlot", "THREE", "goTo"))] == [True] * 3


def test_without_contacts_there_is_no_viewer() -> None:
    page = make_page(document())
    assert page.count("<script>") == 2 and "TrackballControls=" not in page
    assert "<div id=viewer>" not in page


def test_names_and_messages_are_escaped() -> None:
    page = make_page(document())
    assert "a &lt;b&gt; &amp; c.usd" in page and "<b> &" not in page
    assert "bad &lt;points&gt;" in page


HOSTILE = (
    "</script><script>hacked=1</script>",
    '"><img src=x onerror=hacked=1>',
    "' onmouseover='hacked=1",
    "<!--<script>",
    "{choices}\u2028</title>",
)


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_names_stay_text(name: str) -> None:
    plain = hostile_page("name")
    page = hostile_page(name)
    tags, expected = (
        [(tag, sorted(attributes)) for tag, attributes in parsed(text)] for text in (page, plain)
    )
    assert tags == expected
    assert content_of(page)["told"][1] == f"Frame default: failed: {name}"


def hostile_page(name: str) -> str:
    """A page in which every text that comes from outside is the name."""
    strain = Strain(
        body=name,
        part=1,
        parts=1,
        kind=StrainKind.EDGES,
        value=9.0,
        bound=1.0,
        vertex=0,
        place=(0.0, 0.0, 0.0),
    )
    left = Diagnosis(contacts=(RemainingContact(name, name, 3),), strains=(strain,))
    count = CountRecord(triangles=2, pairs=1)
    frames = (
        FrameRecord(
            time=1.0,
            status="strained",
            message=name,
            before=count,
            after=count,
            left=left,
            contacts=(ContactRecord(name, name, 1, 1),),
            prims=(FramePrimRecord(path=name, before=count, after=count),),
        ),
        FrameRecord(time=None, status="failed", message=name),
    )
    prims = [
        PrimRecord(path=path, vertices=1, triangles=1, rest_intersections=None)
        for path in (name, "/B")
    ]
    report = Report(
        command="repair",
        version=name,
        input=name,
        output=name,
        device=name,
        warnings=(name,),
        settings={"ignore": [name]},
        prims=tuple(prims),
        frames=frames,
    ).document()
    contact = replace(CONTACT, first=name, second=name, frames=(0, 0, 0))
    content = PageContent(contacts=(contact, replace(contact, png=b"", view=None)))
    return make_page(report, content, notes=[name])


def content_of(page: str) -> dict[str, Any]:
    """What the scripts of a page read."""
    found = re.search(r'<script type="application/json" id=data>(.*?)</script>', page, re.DOTALL)
    assert found is not None
    content: dict[str, Any] = json.loads(found[1])
    return content


def test_the_chart_has_every_frame() -> None:
    content = content_of(make_page(document(), CONTENT))
    lines = {line["name"]: line["values"] for line in content["series"]}
    assert lines["before"] == [10 * k for k in range(1, 41)] + [None]
    assert lines["largest move"][19] == pytest.approx(2.0)  # per cent
    assert lines["change of volume"] == [None] + [1.0] * 40
    assert lines["failed"] == [None] * 40 + [0.9]
    assert "jitter" not in lines and "modelled" not in lines and "strained" not in lines
    # The default time has no place among numbers: frames are numbered through.
    assert content["x"] == list(range(41)) and content["labels"][-1] == "default"
    assert content["contacts"][0]["worst"] == 4 and content["contacts"][0]["view"]["worst"] == 1


def test_times_are_the_places_of_frames() -> None:
    frames = tuple(FrameRecord(time=t, status="skipped") for t in (-1.5, 3.0, 10.0))
    content = content_of(make_page(document(frames=frames)))
    assert content["x"] == [-1.5, 3.0, 10.0] and content["labels"] == ["-1.5", "3", "10"]


def test_contacts_have_a_picture_or_a_row() -> None:
    page = make_page(document(), CONTENT)
    assert page.count("<figure") == 1
    assert "/A and /B, frame 5: 12 → 3 intersecting triangles" in page
    assert "Smaller contacts (1)" in page and "<td>/A with itself</td>" in page
    assert '<button class=frame data-go="2">3 to 7</button>' in page
    assert "background:rgb(255,128,0)" in page
    # Of one pose there is one number of triangles.
    assert "<th>triangles before</th><th>after</th><th>frames</th>" in page
    one = replace(CONTENT.contacts[1], triangles=(12, None))
    page = make_page(document(), replace(CONTENT, contacts=(one,)))
    assert "<th>triangles</th><th>frames</th>" in page


def test_totals_and_table() -> None:
    page = make_page(document())
    assert "40 of 41" in page and "<b>8200</b>triangles before" in page
    assert "frames failed" in page
    rows = re.findall(r'<tr data-frame="(\d+)"><td><button [^>]*>(.*?)</button>', page)
    assert rows[0] == ("0", "1") and rows[40] == ("40", "default")
    assert "<td>3</td><td></td><td></td><td>/A</td>" in page


@pytest.mark.parametrize("count", [0, 1])
def test_small_reports(count: int) -> None:
    parsed(make_page(document(count, frames=document_frames(count))))


def document_frames(count: int) -> tuple[FrameRecord, ...]:
    return tuple(FrameRecord(time=None, status="skipped") for _ in range(count))


def test_frames_that_miss_the_clearance_are_a_total() -> None:
    missed = FrameRecord(time=1.0, status="clean", left=Diagnosis(too_close=4))
    kept = FrameRecord(time=2.0, status="clean")
    told = "<b>1</b>frames closer than --clearance"
    assert told in make_page(document(frames=(missed, kept)))
    assert "closer than --clearance" not in make_page(document(frames=(kept,)))


def test_a_page_of_joined_reports_is_that_of_a_repair() -> None:
    assert not only_counts({"command": "repair", "output": None})
    assert only_counts({"command": "check", "output": None})
    assert only_counts({"command": "keyposes", "output": None})
    assert not only_counts({"command": "keyposes", "output": "shot.usda"})
