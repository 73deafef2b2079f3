"""A check from a script."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import get_type_hints

import pytest

from dtrepair.pipeline import Cancelled, CheckSettings, Selection, UsageError, check_stage
from dtrepair.pipeline.check import CheckChoices
from tests.command_line import CLOSED, OPEN, run, tube_stage
from tests.pipeline.hosts import Listener


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return tube_stage(tmp_path / "a.usdc", (OPEN, CLOSED, OPEN, CLOSED))


def test_a_check_says_nothing_and_finds_what_the_command_finds(
    clip: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    host = Listener()
    report = check_stage(clip, observer=host)
    assert capfd.readouterr() == ("", "")
    found = [record.before.pairs > 0 for record in report.frames if record.before is not None]
    assert found == [False, True, False, True]
    assert host.phases == [("checking", 4)] and host.done == [1.0, 2.0, 3.0, 4.0]
    told = run("check", clip, "--json", "-").json
    assert told["summary"] == report.document()["summary"]
    assert told["settings"] == report.document()["settings"]


def test_a_check_is_cancelled(clip: Path) -> None:
    host = Listener(within=1.0)
    with pytest.raises(Cancelled):
        check_stage(str(clip), jobs=1, observer=host)
    assert host.done == [1.0, 2.0]


def test_the_settings_of_a_report_are_those_of_the_run(clip: Path) -> None:
    settings = CheckSettings(
        selection=Selection(frames="2:3"), mode="self", ignore=("/Root/Tube,/Root/Tube",)
    )
    report = check_stage(str(clip), settings)
    assert CheckSettings.from_report(report.document()["settings"]) == settings
    assert len(check_stage(str(clip), settings, selection=Selection()).frames) == 4
    hints = get_type_hints(CheckSettings)
    names = [key.name for key in fields(CheckSettings)]
    assert {name: hints[name] for name in names} == get_type_hints(CheckChoices)


def test_a_mode_that_is_none() -> None:
    with pytest.raises(UsageError, match="expected one of self, inter, both, got 'all'"):
        CheckSettings(mode="all")
