"""Sections of transfers and key poses: values in, checked documents out."""

from __future__ import annotations

import json
from dataclasses import replace
from math import nan

import pytest

from dtrepair.report.record import Report
from dtrepair.report.schema import ReportError
from dtrepair.report.sections import (
    KeyposesRecord,
    MarkersRecord,
    SamplesRecord,
    SpanRecord,
    TransferRecord,
)

TRANSFER = TransferRecord(
    correspondence="markers",
    target="/A",
    pairs=7,
    unmatched=1,
    unmatched_area=0.1,
    largest_hole=1,
    source_used=0.5,
    root_scale=1.5,
    markers=MarkersRecord(count=9, distance_median=0.01, distance_max=0.4, swapped=((3, 5),)),
)
SPAN = SpanRecord(
    start=1.0,
    end=2.0,
    before=SamplesRecord(samples=4, dirty=2, pairs=7),
    after=SamplesRecord(samples=4, dirty=0, pairs=0),
    added=(1.5,),
)


def report(
    transfer: TransferRecord | None = None, keyposes: KeyposesRecord | None = None
) -> Report:
    return Report(command="x", version="1", input="a", transfer=transfer, keyposes=keyposes)


def test_sections_are_plain_values() -> None:
    section = report(transfer=TRANSFER).document()["transfer"]
    assert section == TRANSFER.document() == json.loads(json.dumps(section))
    assert section["markers"]["swapped"] == [[3, 5]] and section["residual_median"] is None
    keyposes = KeyposesRecord(interpolation="cubic", spans=(SPAN,))
    document = report(keyposes=keyposes).document()
    assert document["keyposes"]["spans"][0]["added"] == [1.5]
    assert document["keyposes"]["skipped"] == 0 and "transfer" not in document


@pytest.mark.parametrize(
    ("section", "words"),
    [
        (replace(TRANSFER, correspondence="guess"), "expected one of topology, markers, file"),
        (replace(TRANSFER, unmatched=-1), r"transfer\.unmatched: expected at least 0"),
        (replace(TRANSFER, root_scale=nan), "finite plain values"),
    ],
)
def test_transfers_are_checked(section: TransferRecord, words: str) -> None:
    with pytest.raises(ReportError, match=words):
        report(transfer=section).document()


def test_spans_are_checked() -> None:
    wrong = KeyposesRecord(interpolation="held", spans=(SPAN,))
    with pytest.raises(ReportError, match="expected one of linear, cubic"):
        report(keyposes=wrong).document()
