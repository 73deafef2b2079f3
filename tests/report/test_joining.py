"""Reports of chunks joined to the report of the whole."""

from __future__ import annotations

from dataclasses import replace

from dtrepair.diagnosis import (
    Advice,
    Deformation,
    Diagnosis,
    RemainingContact,
    RemainingEnclosure,
)
from dtrepair.report.findings import FindingKind, MotionFinding
from dtrepair.report.joining import join_reports
from dtrepair.report.parts import AttachedList, AttachedRecord, WornRecord, bounded
from dtrepair.report.record import (
    CountRecord,
    FramePrimRecord,
    FrameRecord,
    PrimRecord,
    Report,
    StageRecord,
)
from tests.report.part_records import part, record


def frame(time: float | None, pairs: int) -> FrameRecord:
    before = CountRecord(triangles=2 * pairs, pairs=pairs)
    return FrameRecord(
        time=time,
        status="clean",
        before=before,
        after=CountRecord(),
        displacement_mean=0.01 * pairs,
        prims=(FramePrimRecord(path="/A", before=before, after=CountRecord()),),
        stages=(StageRecord("push", 3, 0, 0.1, 7, 0.2),),
    )


LEFT = Diagnosis(
    contacts=(RemainingContact("/A", "/A", 3),),
    advice=(Advice.RAISE_DIFFUSION,),
    enclosures=(RemainingEnclosure("/A", "/B"),),
    deformations=(Deformation("/B", 1.5, 0.5),),
)
ATTACHED = AttachedRecord(
    first=part(1), second=part(None, "/A"), pairs=4, pose="bind pose", centre=(0.0, 1.0, 2.0)
)
MODELLED = bounded([record(1, 5), record(2, 3, 2)])
WHOLE = Report(
    command="repair",
    version="1",
    input="a.usd",
    settings={"mode": "both"},
    seconds={"detect": 3.0, "solve": 4.0},
    prims=(PrimRecord(path="/A", vertices=9, triangles=7),),
    frames=(
        frame(1.0, 4),
        replace(frame(2.0, 5), left=LEFT, modelled=MODELLED, faults=bounded([record(4, 2)])),
        FrameRecord(time=3.0, status="failed", message="NaN"),
    ),
    warnings=("one", "two"),
    attached=AttachedList(listed=(ATTACHED,), others=2, other_pairs=5),
    worn=(WornRecord(over=part(None, "/Coat"), under=part(1)),),
)


def test_parts_join_to_the_whole() -> None:
    first = replace(WHOLE, frames=WHOLE.frames[:1], warnings=("one",), seconds={"detect": 3.0})
    second = replace(WHOLE, frames=WHOLE.frames[1:], warnings=("one", "two"))
    second = replace(second, seconds={"detect": 0.0, "solve": 4.0})
    joined = join_reports([first.document(), second.document()])
    assert joined == WHOLE
    backwards = join_reports([second.document(), first.document()])
    assert backwards.document()["frames"] == WHOLE.document()["frames"]


def test_what_is_worn_is_told_by_the_chunks_that_had_to_know() -> None:
    clean = replace(WHOLE, worn=())
    for chunks in ([clean, WHOLE], [WHOLE, WHOLE], [WHOLE, clean]):
        assert join_reports([chunk.document() for chunk in chunks]).worn == WHOLE.worn
    assert join_reports([clean.document(), clean.document()]).worn == ()


def test_findings_of_chunks_are_those_of_the_whole() -> None:
    def chunk(path: str, largest: float, *times: float) -> Report:
        found = MotionFinding(kind=FindingKind.JUMPS, path=path, largest=largest, times=times)
        return replace(WHOLE, findings=(found,))

    bent = replace(chunk("/A", 0.4, 3.0).findings[0], kind=FindingKind.BENT)
    chunks = [chunk("/A", 0.3, 2.0, 7.0), chunk("/A", 0.1, 1.0, 2.0), chunk("/B", 0.2, 5.0)]
    chunks.append(replace(WHOLE, findings=(bent,)))
    joined = join_reports([each.document() for each in chunks])
    assert joined.findings == (
        bent,
        *chunk("/A", 0.3, 1.0, 2.0, 7.0).findings,
        *chunk("/B", 0.2, 5.0).findings,
    )
    assert "findings" not in WHOLE.document()


def test_only_frames_with_something_left_say_so() -> None:
    frames = WHOLE.document()["frames"]
    for name in ("left", "modelled", "faults"):
        assert [name in each for each in frames] == [False, True, False]


def test_frame_without_counts_keeps_its_message() -> None:
    joined = join_reports([WHOLE.document()])
    assert joined.frames[2].before is None and joined.frames[2].message == "NaN"
