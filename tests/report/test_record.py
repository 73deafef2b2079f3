"""The JSON report: what is written follows the schema; what does not is refused."""

from __future__ import annotations

import copy
import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from dtrepair.diagnosis import Diagnosis, Strain, StrainKind
from dtrepair.report.parts import bounded
from dtrepair.report.record import (
    SCHEMA,
    CountRecord,
    FramePrimRecord,
    FrameRecord,
    PrimRecord,
    Report,
    read_report,
    render_report,
    summarize,
    write_report,
)
from dtrepair.report.schema import SCHEMA_NAME, STATUSES, ReportError, validate
from tests.report.part_records import record

Document = dict[str, Any]


def make_report(**changes: Any) -> Report:
    frames = (
        FrameRecord(
            time=1.0,
            status="clean",
            before=CountRecord(triangles=10, pairs=7, inter_pairs=2),
            after=CountRecord(),
            iterations=14,
            seconds=0.2,
            displacement_max=0.03,
            displacement_mean=0.002,
            prims=(FramePrimRecord(path="/A", before=CountRecord(triangles=4), after=None),),
            modelled=bounded([record(1, 7)]),
        ),
        FrameRecord(time=None, status="failed", message="points are not finite"),
        FrameRecord(
            time=2.5,
            status="improved",
            before=CountRecord(triangles=6, pairs=5),
            after=CountRecord(triangles=2, pairs=1),
            displacement_max=0.05,
            displacement_mean=0.004,
        ),
    )
    values = {
        "command": "repair",
        "version": "0.1",
        "input": "shot.usd",
        "output": "fixed.usdc",
        "settings": {"iterations": 60},
        "seconds": {"total": 1.2},
        "prims": (PrimRecord(path="/A", vertices=8, triangles=12, rest_intersections=0),),
        "frames": frames,
    }
    return Report(**{**values, **changes})


def test_document_carries_the_schema_name_and_the_totals() -> None:
    document = make_report().document()
    assert document["schema"] == SCHEMA_NAME == "dtrepair.report/1"
    summary = document["summary"]
    assert (summary["frames"], summary["clean"], summary["failed"]) == (3, 1, 1)
    assert (summary["triangles_before"], summary["triangles_after"]) == (16, 2)
    assert (summary["pairs_before"], summary["inter_pairs_before"]) == (12, 2)
    assert summary["displacement_max"] == 0.05
    assert summary["displacement_mean"] == pytest.approx(0.003)
    assert summary["jitter"] is None


def test_strains_are_written_and_counted_and_older_reports_have_none() -> None:
    strain = Strain(
        body="/A",
        part=1,
        parts=2,
        kind=StrainKind.DRIFT,
        value=0.03,
        bound=0.02,
        vertex=5,
        place=(1.0, 2.0, 3.0),
        other="/B, part 1 of 4",
    )
    frame = FrameRecord(time=1.0, status="strained", left=Diagnosis(strains=(strain,)))
    document = make_report(frames=(frame,)).document()
    assert document["summary"]["strained"] == 1
    written = document["frames"][0]["left"]["strains"]
    assert Strain.from_document(written[0]) == strain
    written[0]["kind"] = "charm"
    with pytest.raises(ReportError, match=r"strains\[0\]\.kind: expected one of edges"):
        validate(document)
    del document["summary"]["strained"], document["frames"][0]["left"]["strains"]
    validate(document)


def test_failed_frames_have_a_null_time_and_no_counts() -> None:
    frame = make_report().document()["frames"][1]
    assert frame["time"] is None and frame["before"] is None and frame["after"] is None


def test_no_frames_is_a_valid_report() -> None:
    document = make_report(frames=()).document()
    assert document["summary"]["frames"] == 0
    assert summarize(())["displacement_mean"] == 0.0


def test_schema_agrees_with_an_independent_validator() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(SCHEMA)
    document = make_report().document()
    assert list(validator.iter_errors(document)) == []
    for broken in broken_documents(document):
        assert list(validator.iter_errors(broken))
        with pytest.raises(ReportError):
            validate(broken)


def broken_documents(document: Document) -> Iterator[Any]:
    def change(edit: Callable[[Document], object]) -> Document:
        copied = copy.deepcopy(document)
        edit(copied)
        return copied

    yield change(lambda d: d.pop("summary"))
    yield change(lambda d: d.update(schema="dtrepair.report/2"))
    yield change(lambda d: d.update(other=1))
    yield change(lambda d: d["frames"][0].update(status="fine"))
    yield change(lambda d: d["frames"][0]["before"].update(triangles=-1))
    yield change(lambda d: d["frames"][0]["before"].update(triangles=1.5))
    yield change(lambda d: d["frames"][0].update(iterations=True))
    yield change(lambda d: d["frames"][0].update(time="1"))
    yield change(lambda d: d["prims"][0].pop("path"))
    yield change(lambda d: d["seconds"].update(total=-1.0))
    yield change(lambda d: d.update(frames={}))
    yield change(lambda d: d.update(attached={}))
    yield change(lambda d: d["frames"][0].update(modelled={"listed": []}))
    yield change(lambda d: d["frames"][0]["modelled"]["others"].update(parts=-1))
    yield change(lambda d: d["frames"][0]["modelled"]["listed"][0]["first"].update(number=0))
    yield change(lambda d: d["summary"]["modelled"]["listed"][0].pop("centre"))
    yield []


@pytest.mark.parametrize(
    ("edit", "place"),
    [
        (
            lambda d: d["frames"][0].update(status="fine"),
            r"report\.frames\[0\]\.status: expected one",
        ),
        (
            lambda d: d["frames"][2]["after"].update(pairs=-3),
            r"frames\[2\]\.after\.pairs.*at least 0",
        ),
        (lambda d: d["prims"][0].update(extra=1), r"prims\[0\]: got the unknown property 'extra'"),
        (lambda d: d.pop("device"), r"report: expected the property 'device'"),
    ],
)
def test_errors_name_the_place(edit: Callable[[Document], object], place: str) -> None:
    document = make_report().document()
    edit(document)
    with pytest.raises(ReportError, match=place):
        validate(document)


@pytest.mark.parametrize("status", STATUSES)
def test_every_status_is_accepted(status: Any) -> None:
    make_report(frames=(FrameRecord(time=1.0, status=status),)).document()


def test_values_that_are_not_json_are_refused() -> None:
    with pytest.raises(ReportError, match="finite"):
        make_report(seconds={"total": float("nan")}).document()
    with pytest.raises(ReportError, match="plain values"):
        make_report(settings={"a": object()}).document()


def test_write_and_read_back(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    write_report(make_report(), path)
    assert read_report(path) == make_report().document()
    assert path.read_text() == render_report(make_report())
    assert path.read_text().endswith("}\n")


def test_refused_report_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    path.write_text("old")
    with pytest.raises(ReportError):
        write_report(make_report(frames=(FrameRecord(time=1.0, status="fine"),)), path)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["report.json"]


def test_missing_directory_is_an_os_error(tmp_path: Path) -> None:
    with pytest.raises(OSError):
        write_report(make_report(), tmp_path / "none" / "report.json")


def test_reading_something_else_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    path.write_text("{")
    with pytest.raises(ReportError, match="expected a JSON report"):
        read_report(path)
    path.write_text(json.dumps({"schema": SCHEMA_NAME}))
    with pytest.raises(ReportError, match=r"report\.json: report: expected the property"):
        read_report(path)


def test_stages_of_a_frame_are_written_and_checked() -> None:
    from dtrepair.report.record import StageRecord

    stage = StageRecord("push 20", 12, 3, 0.08, 5, 0.2)
    frame = FrameRecord(time=1.0, status="clean", stages=(stage,))
    report = Report(command="repair", version="1", input="a.usd", frames=(frame,))
    assert report.document()["frames"][0]["stages"][0]["name"] == "push 20"
    wrong = FrameRecord(time=1.0, status="clean", stages=(StageRecord("fill", -1, 0, 0.1, 0, 0.0),))
    with pytest.raises(ReportError, match="crossings"):
        Report(command="repair", version="1", input="a.usd", frames=(wrong,)).document()


@pytest.mark.parametrize(
    "text", ["[" * 200_000, '{"schema": ' + "9" * 5000 + "}", '{"a": [' + '{"b": [' * 50_000]
)
def test_nesting_and_numbers_without_end_are_no_report(tmp_path: Path, text: str) -> None:
    path = tmp_path / "report.json"
    path.write_text(text)
    with pytest.raises(ReportError, match=r"report\.json: expected a JSON report, got"):
        read_report(path)


def test_counts_beyond_what_programs_agree_on_are_refused() -> None:
    document = make_report().document()
    document["prims"][0]["vertices"] = 2**53
    validate(document)
    document["prims"][0]["vertices"] = 10**400
    with pytest.raises(ReportError, match=r"vertices: expected at most 9007199254740992"):
        validate(document)
