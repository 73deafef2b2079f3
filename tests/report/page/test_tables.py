"""The tables of a page: objects, pairs of objects, transfers, modelled contacts, keys."""

from __future__ import annotations

from dataclasses import replace

from dtrepair.report.page.page import make_page
from dtrepair.report.parts import LISTED, WornRecord, bounded
from dtrepair.report.record import (
    ContactRecord,
    CountRecord,
    FramePrimRecord,
    FrameRecord,
    MotionRecord,
    PrimRecord,
)
from dtrepair.report.sections import (
    KeyposesRecord,
    MarkersRecord,
    SamplesRecord,
    SpanRecord,
    TransferRecord,
)
from tests.report.page.tags import parsed
from tests.report.page.test_page import document
from tests.report.part_records import part, record


def test_objects_and_pairs_have_their_numbers() -> None:
    moved = MotionRecord(
        displacement_max=0.02, rigid_rms=0.01, edge_distortion=0.0, edge_change=0.005
    )
    count, none = CountRecord(triangles=4, pairs=2), CountRecord()
    frames = tuple(
        FrameRecord(
            time=float(k),
            status="clean",
            before=count,
            after=none,
            prims=(FramePrimRecord("/A", count, none, moved, size=4.0),),
            displacement_max=0.02,
            contacts=(ContactRecord("/A", "/B", 2 + k, 0),),
        )
        for k in range(3)
    )
    prims = tuple(
        PrimRecord(path=path, vertices=8, triangles=12, rest_intersections=0)
        for path in ("/A", "/B")
    )
    page = make_page(document(frames=frames, prims=prims))
    parsed(page)
    assert (
        "<td>12</td><td>0</td><td>0.08 (2\u00a0%)</td><td>0.04 (1\u00a0%)</td><td>0.50%</td>"
        in page
    )
    assert "<b>0.08 (2\u00a0%)</b>largest move" in page
    assert "moved by 0.08 (2\\u00a0%) at most" in page
    assert '<td>9</td><td>0</td><td><button class=frame data-go="0">0 to 2</button></td>' in page
    assert '<td><button class=frame data-go="2">2</button></td><td>/A and /B</td>' in page


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


def test_parts_that_meet_have_a_table_of_their_own() -> None:
    assert "<h2>Pairs of parts" not in make_page(document())
    found = bounded([record(1, 50, 3), replace(record(2, 40), second=record(2, 0).first)])
    frames = (FrameRecord(time=1.0, status="improved", faults=found),)
    page = make_page(document(frames=frames))
    parsed(page)
    assert "<h2>Pairs of parts" in page and "<td>50</td><td>3</td><td>100</td><td>3</td>" in page
    assert "part 2 (412 triangles, around 0.1 1.5 0) with itself</td>" in page


def test_poses_between_keys_have_a_table_of_their_own() -> None:
    assert "Between the keys" not in make_page(document())
    span = SpanRecord(
        start=1.0,
        end=5.0,
        before=SamplesRecord(samples=8, dirty=3, pairs=20),
        after=SamplesRecord(samples=16, dirty=1, pairs=2),
        left=(2.5,),
        added=(3.0, 4.0),
    )
    section = KeyposesRecord(interpolation="linear", skipped=0, spans=(span,))
    page = make_page(document(keyposes=section))
    parsed(page)
    cells = ["8", "3", "1", "20", "2", "3, 4", "2.5", "1 to 5"]
    assert "".join(f"<td>{cell}</td>" for cell in cells) in page
    assert "<th>intersect with repaired keys</th><th>in the output</th>" in page
    # Where nothing is repaired there is one number of each.
    page = make_page(document(command="keyposes", keyposes=section, output=None))
    cells = ["8", "3", "20", "2.5", "1 to 5"]
    assert f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>" in page


def test_a_check_has_no_columns_of_a_repair() -> None:
    count = CountRecord(triangles=4, pairs=2, inter_pairs=2)
    frame = FrameRecord(
        time=1.0,
        status="unchanged",
        before=count,
        after=count,
        prims=(FramePrimRecord("/A", count, count),),
        contacts=(ContactRecord("/A", "/B", 2, 2),),
        modelled=bounded([record(1, 7, 7)]),
    )
    clean = FrameRecord(time=2.0, status="clean", before=CountRecord(), after=CountRecord())
    prims = tuple(PrimRecord(path=path, vertices=8, triangles=12) for path in ("/A", "/B"))
    frames = (frame, clean)
    page = make_page(document(prims=prims, frames=frames, command="check", output=None))
    parsed(page)
    columns = ("after</th>", "before</th>", "<th>largest move", "frames left</th>")
    for word in ("<td>unchanged", *columns):
        assert word not in page
    assert "<td>4</td><td>0.00</td><td>intersects</td>" in page
    assert "<td>2</td><td>" in page and "<td>7</td><td>14</td>" in page
    assert "<b>4</b>intersecting triangles" in page and "</b>largest move" not in page
    repaired = make_page(document(prims=prims, frames=frames))
    for word in ("<td>unchanged", *columns):
        assert word in repaired


def test_pairs_that_met_more_than_before_are_marked() -> None:
    contacts = (ContactRecord("/A", "/B", 2, 5), ContactRecord("/A", "/C", 3, 3))
    frame = FrameRecord(
        time=1.0, status="improved", before=CountRecord(), after=CountRecord(), contacts=contacts
    )
    prims = tuple(PrimRecord(path=path, vertices=8, triangles=12) for path in ("/A", "/B"))
    page = make_page(document(prims=prims, frames=(frame,)))
    assert "<td>2</td><td>5, more than before</td>" in page and "<td>3</td><td>3</td>" in page


def test_what_is_taken_as_worn_is_listed() -> None:
    worn = WornRecord(over=part(2), under=part(None, "/Hero/Shirt"))
    page = make_page(document(worn=(worn,)))
    parsed(page)
    assert f"<h2>Taken as worn</h2>{'<div class=scroll>'}" in page
    assert f"<td>{part(2)}</td><td>/Hero/Shirt</td>" in page
    assert "Taken as worn" not in make_page(document())
