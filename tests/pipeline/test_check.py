"""A check from a script."""

from __future__ import annotations

from collections import Counter
from dataclasses import fields
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest

import usd_io
from dtrepair.pipeline import (
    Cancelled,
    CheckSettings,
    PairsFound,
    Selection,
    UsageError,
    check_stage,
)
from dtrepair.pipeline.check_settings import CheckChoices
from dtrepair.pipeline.stages.sources import StageSource
from dtrepair.repair.surface.containment import Enclosures
from tests.command_line import CLOSED, OPEN, run, tube_stage
from tests.pipeline.hosts import Listener
from tests.pipeline.stages.test_sources import two_tubes
from tests.usd_stages import define_cube, new_stage
from usd_io.read import transforms


def test_a_check_reads_each_matrix_and_each_frame_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of few frames nothing is told of what was modelled, so nobody looks at them before."""
    path, calls = two_tubes(tmp_path / "a.usda", (0, 0, 0)), Counter[tuple[str, str, float]]()

    def count(module: Any, name: str) -> None:
        function = getattr(module, name)

        def counted(mesh: Any, time: float) -> Any:
            calls[name, mesh.path, time] += 1
            return function(mesh, time)

        monkeypatch.setattr(module, name, counted)

    count(transforms, "world_matrix")
    count(usd_io, "read_frame")
    check_stage(str(path), jobs=1)
    both = {
        (name, f"/Root/{mesh}", 2.0)
        for name in ("world_matrix", "read_frame")
        for mesh in ("Tube", "Still")
    }
    assert {key: calls[key] for key in both} == dict.fromkeys(both, 1)


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


def test_an_observer_hears_which_triangles_intersect(clip: Path) -> None:
    heard = Listener()
    report = check_stage(clip, observer=heard)
    found = [remark for remark in heard.remarks if isinstance(remark, PairsFound)]
    assert [each.time for each in found] == [record.time for record in report.frames]
    for each, record in zip(found, report.frames, strict=True):
        assert record.before is not None
        assert len(each.pairs) == record.before.pairs
        assert len(np.unique(each.pairs)) == record.before.triangles
    ignored = Listener()
    check_stage(clip, ignore=("/Root/Tube,/Root/Tube",), observer=ignored)
    assert not any(len(r.pairs) for r in ignored.remarks if isinstance(r, PairsFound))


def test_a_check_is_cancelled(clip: Path) -> None:
    host = Listener(within=1.0)
    with pytest.raises(Cancelled):
        check_stage(str(clip), jobs=1, observer=host)
    assert host.done == [1.0, 2.0]


def test_the_settings_of_a_report_are_those_of_the_run(clip: Path) -> None:
    settings = CheckSettings(
        selection=Selection(frames="2:3"),
        mode="self",
        ignore=("/Root/Tube,/Root/Tube",),
        rest_contacts="auto",
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


def test_small_objects_cost_no_analysis_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, count = tmp_path / "many.usdc", 40
    stage = new_stage(path)
    for number in range(count):
        cube = define_cube(stage, f"/Root/Cube{number}")
        cube.AddTranslateOp().Set((3.0 * number - (number == 7), 0.0, 0.0))
    stage.GetRootLayer().Save()
    calls = {"parts": 0, "transforms": 0}
    analyse, place = Enclosures.__init__, StageSource.to_world

    def analysed(*arguments: Any, **options: Any) -> None:
        calls["parts"] += 1
        analyse(*arguments, **options)

    def placed(*arguments: Any) -> Any:
        calls["transforms"] += 1
        return place(*arguments)

    monkeypatch.setattr(Enclosures, "__init__", analysed)
    monkeypatch.setattr(StageSource, "to_world", placed)
    report = check_stage(path)
    before = report.frames[0].before
    assert before is not None and before.pairs > 0 and len(report.frames[0].prims) == count
    assert calls["parts"] < 5 and calls["transforms"] < 16 * count
