"""The report of a whole run out of the reports of its chunks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from dtrepair.diagnosis import Diagnosis
from dtrepair.report.findings import joined
from dtrepair.report.parts import AttachedList, PartPairs, PassingRecord, WornRecord, parts_of
from dtrepair.report.record import (
    ContactRecord,
    CountRecord,
    FramePrimRecord,
    FrameRecord,
    MotionRecord,
    PrimRecord,
    Report,
    StageRecord,
)

Document = Mapping[str, Any]


def join_reports(documents: Sequence[Document]) -> Report:
    """Join reports of chunks of one run, as `read_report` returns them, in any order.

    Frames are sorted by time; seconds are added; input, settings, prims, attached and
    passing parts are the first one's. What is worn is told by any chunk that had something to
    repair. The jitter is None: it cannot be told from that of the chunks.
    """
    first = documents[0]
    frames = [read_frame(frame) for document in documents for frame in document["frames"]]
    names = list(dict.fromkeys(name for document in documents for name in document["seconds"]))
    warnings = dict.fromkeys(text for document in documents for text in document["warnings"])
    alone = [document["alone_from"] for document in documents if "alone_from" in document]
    attached = first.get("attached")
    worn = [WornRecord(**parts_of(own)) for d in documents for own in d.get("worn", ())]
    return Report(
        **{name: first[name] for name in ("command", "version", "input", "device")},
        settings={name: value for name, value in first["settings"].items() if name != "chunk"},
        seconds={name: sum(d["seconds"].get(name, 0.0) for d in documents) for name in names},
        prims=tuple(PrimRecord(**prim) for prim in first["prims"]),
        frames=tuple(sorted(frames, key=lambda frame: frame.time or 0.0)),
        warnings=tuple(warnings),
        attached=AttachedList.from_document(attached) if attached else AttachedList(),
        passing=tuple(PassingRecord(**parts_of(own)) for own in first.get("passing", ())),
        worn=tuple(dict.fromkeys(worn)),
        findings=joined([found for d in documents for found in d.get("findings", ())]),
        alone_from=min(alone, default=None),
    )


def read_frame(frame: Document) -> FrameRecord:
    """Return the record that a frame of a report was made of."""
    prims = (
        FramePrimRecord(**{**prim, **_counts(prim), "motion": _motion(prim)})
        for prim in frame["prims"]
    )
    contacts = tuple(ContactRecord(**contact) for contact in frame.get("contacts", ()))
    stages = (StageRecord(**stage) for stage in frame["stages"])
    record = FrameRecord(**{**frame, **_counts(frame)})
    left = Diagnosis.from_document(frame["left"]) if "left" in frame else Diagnosis()
    return replace(
        record,
        prims=tuple(prims),
        contacts=contacts,
        stages=tuple(stages),
        modelled=_part_pairs(frame, "modelled"),
        faults=_part_pairs(frame, "faults"),
        left=left,
    )


def _motion(prim: Document) -> MotionRecord | None:
    return MotionRecord(**prim["motion"]) if prim.get("motion") else None


def _part_pairs(frame: Document, name: str) -> PartPairs:
    return PartPairs.from_document(frame[name]) if name in frame else PartPairs()


def _counts(item: Document) -> dict[str, CountRecord | None]:
    return {
        name: None if item[name] is None else CountRecord(**item[name])
        for name in ("before", "after")
    }
