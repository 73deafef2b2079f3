"""Errors of a run: what the libraries raise gets a code, and a report has one."""

from __future__ import annotations

import pickle
from dataclasses import replace

import pytest

from dtrepair.files.polygon_mesh import MeshFileError
from dtrepair.pipeline import InputError, OutputError, PipelineError, UsageError, exit_code
from dtrepair.pipeline.errors import (
    ALONE,
    CLEAN,
    FRAMES,
    INPUT,
    INTERNAL,
    REMAINING,
    WorkersError,
    plain_error,
    plain_errors,
)
from dtrepair.repair.parallel.process_pool import WorkerLost
from dtrepair.report.joining import join_reports
from dtrepair.report.record import CountRecord, FrameRecord, Report
from dtrepair.report.sections import KeyposesRecord, SamplesRecord, SpanRecord
from usd_io import OutputError as LayerError
from usd_io import SelectionError, StageError


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (SelectionError("matches nothing"), UsageError),
        (StageError("no such file"), InputError),
        (MeshFileError("no polygons"), InputError),
        (LayerError("disk full"), OutputError),
        (WorkerLost(), WorkersError),
    ],
)
def test_errors_on_purpose_become_those_of_a_run(
    error: Exception, kind: type[PipelineError]
) -> None:
    with pytest.raises(kind, match=str(error)) as caught, plain_errors():
        raise error
    assert caught.value.__cause__ is error
    assert caught.value.exit_code == kind.exit_code


def test_others_are_defects_that_keep_their_kind() -> None:
    with pytest.raises(KeyError), plain_errors():
        raise KeyError("nothing")
    told = plain_error(RuntimeError("wires crossed"))
    assert told.exit_code == INTERNAL and "RuntimeError: wires crossed" in str(told)
    assert "choose fewer frames" in str(plain_error(MemoryError()))


def test_an_error_travels_between_processes_with_its_code() -> None:
    error = pickle.loads(pickle.dumps(PipelineError("a worker failed", INPUT)))
    assert error.exit_code == INPUT and str(error) == "a worker failed"


@pytest.mark.parametrize(
    ("command", "status", "pairs", "code"),
    [
        ("repair", "clean", 0, CLEAN),
        ("repair", "improved", 1, REMAINING),
        ("repair", "unchanged", 0, REMAINING),  # something lies wholly inside something else
        ("repair", "strained", 0, REMAINING),
        ("keyposes", "strained", 0, REMAINING),
        ("transfer", "strained", 0, REMAINING),
        ("check", "clean", 0, CLEAN),
        ("check", "unchanged", 3, REMAINING),
        ("repair", "failed", 0, FRAMES),
        ("transfer", "failed", 2, FRAMES),
        ("transfer", "unchanged", 0, CLEAN),
    ],
)
def test_a_report_has_an_exit_code(command: str, status: str, pairs: int, code: int) -> None:
    count = CountRecord(triangles=pairs, pairs=pairs)
    fine = FrameRecord(time=1.0, status="clean", before=CountRecord(), after=CountRecord())
    frame = FrameRecord(time=2.0, status=status, before=count, after=count)
    assert exit_code(Report(command=command, version="", input="a", frames=(fine, frame))) == code


def test_frames_that_were_not_repaired_together_have_a_code() -> None:
    report = Report(command="repair", version="", input="a", alone_from=3.0)
    assert exit_code(report) == ALONE
    failed = replace(report, frames=(FrameRecord(time=2.0, status="failed"),))
    assert exit_code(failed) == FRAMES
    parts = [replace(report, alone_from=None).document(), report.document()]
    assert join_reports(parts).alone_from == 3.0


def test_in_betweens_that_are_left_count() -> None:
    none = SamplesRecord(samples=1, dirty=0, pairs=0)
    clean = SpanRecord(start=1.0, end=2.0, before=none, after=none)
    for spans, code in (((clean,), CLEAN), ((clean, replace(clean, left=(1.5,))), REMAINING)):
        section = KeyposesRecord(interpolation="linear", spans=spans)
        report = Report(command="keyposes", version="", input="a", keyposes=section)
        assert exit_code(report) == code
