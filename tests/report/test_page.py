"""The HTML page: self-contained, escaped, with the numbers of the report."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from typing import Any

import pytest

from dtrepair.report.modelled import LISTED, bounded
from dtrepair.report.page import Picture, make_page
from dtrepair.report.record import CountRecord, FrameRecord, PrimRecord, Report
from dtrepair.report.sections import MarkersRecord, TransferRecord
from tests.report.modelled_records import record


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


class Tags(HTMLParser):
    """Collects start tags, and checks that what is opened is closed."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[tuple[str, dict[str, str]]] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attributes)
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, {name: value or "" for name, value in attributes}))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def parsed(page: str) -> list[tuple[str, dict[str, str]]]:
    tags = Tags()
    tags.feed(page)
    assert tags.open == []
    return tags.seen


def test_page_is_well_formed_and_needs_nothing_else() -> None:
    page = make_page(document(), [Picture("before", b"\x89PNG")])
    tags = parsed(page)
    assert not [tag for tag, _ in tags if tag in ("script", "link", "iframe")]
    assert "http" not in page
    images = [attributes["src"] for tag, attributes in tags if tag == "img"]
    assert images == ["data:image/png;base64,iVBORw=="]


def test_names_and_messages_are_escaped() -> None:
    page = make_page(document())
    assert "a &lt;b&gt; &amp; c.usd" in page and "<b> &" not in page
    assert "bad &lt;points&gt;" in page


def test_one_bar_each_and_heights_in_proportion() -> None:
    bars = [a for tag, a in parsed(make_page(document())) if tag == "rect"]
    before = [float(bar["height"]) for bar in bars if bar["class"] == "before"]
    assert len(before) == 41
    assert before[19] == pytest.approx(before[39] / 2, abs=0.1)
    assert before[40] == 0  # the failed frame
    assert all(float(bar["y"]) >= 0 and float(bar["x"]) <= 900 for bar in bars)


def test_totals_and_table() -> None:
    page = make_page(document())
    assert "40 of 41" in page and "<b>8200</b>triangles before" in page
    assert "frames failed" in page
    rows = re.findall(r"<tr><td>(.*?)</td>", page)
    assert rows[0] == "1" and rows[40] == "default"
    assert "<td>3</td><td>/A</td>" in page


@pytest.mark.parametrize("count", [0, 1])
def test_small_reports(count: int) -> None:
    parsed(make_page(document(count, frames=document_frames(count))))


def document_frames(count: int) -> tuple[FrameRecord, ...]:
    return tuple(FrameRecord(time=None, status="skipped") for _ in range(count))


def transfer_section() -> TransferRecord:
    return TransferRecord(
        correspondence="markers",
        target="/A",
        pairs=7,
        unmatched=7,
        unmatched_area=0.1,
        largest_hole=7,
        source_used=0.5,
        root_scale=1.5,
        residual_median=0.25,
        markers=MarkersRecord(
            count=9, distance_median=0.01, distance_max=0.4, suspects=(3, 5), swapped=((3, 5),)
        ),
    )


def test_a_transfer_has_a_table_of_its_own() -> None:
    assert "<h2>Transfer</h2>" not in make_page(document())
    page = make_page(document(transfer=transfer_section()))
    parsed(page)
    assert "<td>3, 5</td><td>markers to look at</td>" in page
    assert "<td>0.25</td><td>residual, median</td>" in page
    assert "<td></td><td>residual, 95 % below</td>" in page
    assert "<td>50.0%</td>" in page and "1.0%, 40.0%" in page


def test_modelled_contacts_have_a_table_of_their_own() -> None:
    assert "<h2>Modelled" not in make_page(document())
    listed = bounded([record(1 + number, 50 - number) for number in range(LISTED + 1)])
    frames = (FrameRecord(time=1.0, status="clean", modelled=listed),)
    page = make_page(document(frames=frames))
    parsed(page)
    assert "<td>50 0 0</td><td>/Hero/Body part 1 (412 triangles" in page
    others = 50 - LISTED
    assert f"<td>{others}</td><td>0</td><td>{2 * others}</td><td>0</td><td></td>" in page
