"""Progress moves with the work done ahead, never back, never too far; a run can be ended."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dtrepair.pipeline import (
    Cancelled,
    Observer,
    check_stage,
    repair_keyposes,
    repair_stage,
    transfer_stage,
)
from dtrepair.pipeline.observer import Progress, RecordingObserver, SpansDone, warn
from dtrepair.report.record import Report
from tests.command_line import CLOSED, OPEN, tube_stage
from tests.pipeline.hosts import Listener


def test_items_are_counted_and_the_work_ahead_of_them() -> None:
    host = Listener()
    with Progress(host, "working", 4) as progress:

        def items() -> Iterator[str]:
            yield "first"
            for ahead in (0.5, 2.0, 1.0, 9.0):
                progress.ahead(ahead)
            yield from ("second", "third", "fourth")

        assert len(list(progress.over(items()))) == 4
    assert host.phases == [("working", 4)] and host.ended == 1
    # One item is done; 0.5 and 2 more; it does not go back, nor beyond the four there are.
    assert host.done == [1.0, 1.5, 3.0, 3.0, 4.0, 4.0, 4.0, 4.0]


def test_a_phase_ends_where_its_items_fail() -> None:
    host = Listener()

    def items() -> Iterator[str]:
        yield "first"
        raise ValueError("no second")

    with pytest.raises(ValueError, match="no second"), Progress(host, "working", 2) as progress:
        list(progress.over(items()))
    assert host.ended == 1


def test_a_cancelled_run_hands_out_no_more_items() -> None:
    host = Listener(within=1.0)
    taken = []
    with (
        pytest.raises(Cancelled, match="no output was written") as caught,
        Progress(host, "working", 4) as progress,
    ):
        for item in progress.over("abcd"):
            taken.append(item)
    assert taken == ["a", "b"] and host.ended == 1
    assert caught.value.exit_code == 130


def test_a_phase_does_not_begin_where_the_run_should_end() -> None:
    host = Listener(frames=0)
    with pytest.raises(Cancelled), Progress(host, "working", 1):
        pass
    assert host.phases == [] and host.ended == 0


def test_work_ahead_ends_too() -> None:
    progress = Progress(Listener(within=0.0), "working", 4)
    progress.ahead(0.5)
    with pytest.raises(Cancelled):
        progress.ahead(0.6)


def test_the_default_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    host = Observer()
    with Progress(host, "working", 2) as progress:
        assert list(progress.over("ab")) == ["a", "b"]
    warn(host, ["beware"])
    assert capsys.readouterr() == ("", "")


def test_warnings_are_recorded_once_and_all_is_passed_on() -> None:
    host = Listener(frames=0)
    recording = RecordingObserver(host)
    warn(recording, ["first", "second", "first"])
    assert recording.warnings == ("first", "second")
    assert host.warnings == ["first", "second", "first"]
    recording.start("working", 2)
    recording.advance(1.5)
    recording.end()
    recording.remark(SpansDone(1, 2))
    assert (host.phases, host.done, host.ended) == ([("working", 2)], [1.5], 1)
    assert host.remarks == [SpansDone(1, 2)] and recording.cancelled()


RUNS: dict[str, Callable[[Path, Path, Observer], Report]] = {
    "check": lambda stage, out, host: check_stage(
        stage, mode="inter", attach=("/Root/Tube,/Root/Tube",), observer=host
    ),
    "repair": lambda stage, out, host: repair_stage(stage, out, rest="2", observer=host),
    "keyposes": lambda stage, out, host: repair_keyposes(stage, out, rest="2", observer=host),
    "transfer": lambda stage, out, host: transfer_stage(stage, stage, out, observer=host),
}


@pytest.mark.parametrize("name", RUNS)
def test_a_report_has_all_warnings_of_its_run(name: str, tmp_path: Path) -> None:
    stage = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    host = Listener()
    report = RUNS[name](stage, tmp_path / "b.usda", host)
    assert host.warnings and list(report.warnings) == list(dict.fromkeys(host.warnings))
