"""What is taken as worn is told once for a run, where anything is repaired, and in the report."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from dtrepair.pipeline import (
    CheckSettings,
    ObjectOptions,
    ObjectSettings,
    PrimTable,
    Selection,
    WornFound,
    check_stage,
    repair_keyposes,
    repair_stage,
)
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.scene import make_scene
from dtrepair.report.parts import WornRecord, parts_of
from tests.command_line import run
from tests.meshes import joined, tube
from tests.pipeline.hosts import Listener
from usd_io import AuthoredMesh, write_animation

ARM, SLEEVE = tube(24, 40, 0.2, 4.0), tube(24, 12, 0.23, 1.0)
GROWTH = (0.0, 0.0, 0.3, 0.4, 0.4)

FOUND = [("/Hero/Sleeve", "/Hero/Arm")]

BELL = np.exp(-((ARM[0][:, 2:] / 0.4) ** 2)) * (1.0, 1.0, 0.0)


@pytest.fixture
def sleeve(tmp_path: Path) -> Path:
    """An arm that swells through its sleeve from frame 3 on."""
    path = tmp_path / "sleeve.usda"
    poses = [ARM[0] * (1.0 + growth * BELL) for growth in GROWTH]
    meshes = [
        AuthoredMesh("/Hero/Arm", ARM[1], points=poses, rest=ARM[0]),
        AuthoredMesh("/Hero/Sleeve", SLEEVE[1], rest=SLEEVE[0]),
    ]
    write_animation(path, meshes, times=np.arange(1.0, 6.0))
    return path


def worn(host: Listener) -> list[tuple[str, str]]:
    """What was told, which must be once at most, by the names of the parts."""
    told = [remark.worn for remark in host.remarks if isinstance(remark, WornFound)]
    assert len(told) < 2
    return [names for each in told for names in named(each)]


def named(records: tuple[WornRecord, ...]) -> list[tuple[str, str]]:
    """The names of the parts, each (over, under)."""
    return [(record.over.name, record.under.name) for record in records]


@pytest.mark.parametrize("alone", [False, True])
def test_it_is_told_once_which_part_lies_over_which(
    sleeve: Path, tmp_path: Path, alone: bool
) -> None:
    host = Listener()
    report = repair_stage(sleeve, tmp_path / "b.usda", alone=alone, observer=host)
    assert worn(host) == named(report.worn) == FOUND and host.warnings == []
    (document,) = report.document()["worn"]
    assert WornRecord(**parts_of(document)) == report.worn[0]


@pytest.mark.parametrize("how", ["frames", "layer", "ignore", "paper"])
def test_nothing_is_told_of_what_is_clean_told_or_not_known(
    sleeve: Path, tmp_path: Path, how: str
) -> None:
    host = Listener()
    report = repair_stage(
        sleeve,
        tmp_path / "b.usda",
        selection=Selection(frames="1:2" if how == "frames" else "3"),
        objects=ObjectOptions(
            layer=("/Hero/Sleeve=1",) if how == "layer" else (),
            ignore=("/Hero/Sleeve,/Hero/Arm",) if how == "ignore" else (),
        ),
        options=RepairOptions(method="paper", iterations=1) if how == "paper" else RepairOptions(),
        observer=host,
    )
    assert worn(host) == [] and report.worn == () and "worn" not in report.document()


# Of the cluster's own event loops, at their end.
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning")
def test_several_workers_tell_the_same_as_one_run(sleeve: Path, tmp_path: Path) -> None:
    """Of two chunks one is clean, and knows of nothing."""
    one, several = Listener(), Listener()
    whole = repair_stage(sleeve, tmp_path / "a.usda", alone=True, observer=one)
    report = repair_stage(
        sleeve, tmp_path / "b.usda", alone=True, distributed="local", jobs=2, observer=several
    )
    assert worn(several) == worn(one) == FOUND and report.worn == whole.worn


def test_key_poses_tell_it_where_they_are_repaired(sleeve: Path, tmp_path: Path) -> None:
    heard, silent = Listener(), Listener()
    reports = [
        repair_keyposes(sleeve, tmp_path / "b.usda", observer=heard),
        repair_keyposes(sleeve, observer=silent),
    ]
    assert worn(heard) == named(reports[0].worn) == FOUND
    assert worn(silent) == named(reports[1].worn) == []


def test_a_check_finds_it_where_it_is_asked_to(
    sleeve: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also in frames that are clean, and by a scene that is not built otherwise."""
    repaired = repair_stage(sleeve, tmp_path / "b.usda")
    first = Selection(frames="1")
    report = check_stage(sleeve, selection=first, find_worn=True)
    assert report.worn == repaired.worn and report.settings["find_worn"]
    assert CheckSettings.from_report(report.document()["settings"]).find_worn
    built: list[object] = []
    monkeypatch.setattr(make_scene, "make_scene", lambda *_, **__: built.append(1))
    plain = check_stage(sleeve, selection=first)
    assert plain.worn == () and not built and "find_worn" not in plain.settings


@pytest.mark.parametrize("how", ["ignore", "table", "primvar"])
def test_a_check_does_not_repeat_what_was_told(sleeve: Path, how: str) -> None:
    table = PrimTable("/Hero/Sleeve", ObjectSettings(layer=1))
    if how == "primvar":
        stage = Usd.Stage.Open(str(sleeve))
        prim = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/Hero/Sleeve"))
        prim.CreatePrimvar("dtrepair:layer", Sdf.ValueTypeNames.Int).Set(1)
        stage.Save()
    report = check_stage(
        sleeve,
        find_worn=True,
        ignore=("/Hero/Sleeve,/Hero/Arm",) if how == "ignore" else (),
        tables=(table,) if how == "table" else (),
    )
    assert report.worn == ()


def test_the_command_lists_what_would_be_worn(sleeve: Path) -> None:
    lines = run("check", sleeve, "--modelled").out.splitlines()
    assert "worn: /Hero/Sleeve over /Hero/Arm" in lines
    assert "nothing is taken as modelled" in lines
    told = run("check", sleeve, "--modelled", "--ignore", "/Hero/Sleeve,/Hero/Arm").out
    assert (
        "no open sheet would be taken as worn; what is closed, as rings or coats, is led too"
        in told.splitlines()
    )
    (record,) = run("check", sleeve, "--modelled", "--json", "-").json["worn"]
    assert record["over"]["path"] == "/Hero/Sleeve" and record["under"]["path"] == "/Hero/Arm"
    assert "worn" not in run("check", sleeve, "--json", "-").json


def test_the_command_says_it_and_what_changes_it(sleeve: Path, tmp_path: Path) -> None:
    arguments = ("repair", sleeve, "--frames", "3", "-o", tmp_path / "b.usda")
    line, end = run(*arguments).err.splitlines()
    told = "taken as worn: /Hero/Sleeve over /Hero/Arm; another order with --layer"
    assert line == f"dtrepair: {told}" and "--frames is a trial" in end
    assert run(*arguments, "-q").err == ""


@pytest.mark.parametrize("command", ["repair", "keyposes"])
def test_a_dry_run_says_what_the_run_says(sleeve: Path, tmp_path: Path, command: str) -> None:
    arguments = (command, sleeve, "-o", tmp_path / "b.usda")
    planned = run(*arguments, "--dry-run").err
    assert planned.startswith("dtrepair: taken as worn: /Hero/Sleeve over /Hero/Arm;")
    assert not (tmp_path / "b.usda").exists()
    # A warning of what was moved comes at the end, of a run only.
    assert run(*arguments).err.startswith(planned)


def test_two_warnings_do_not_name_the_same_cure(tmp_path: Path) -> None:
    """Parts of one mesh that meet in all of two frames, without a bind pose."""
    path, (points, faces) = tmp_path / "a.usda", joined(ARM, SLEEVE)
    points[: len(ARM[0])] *= 1.0 + 0.3 * BELL
    mesh = AuthoredMesh("/Hero/Dressed", faces, points=[points, points])
    write_animation(path, mesh, times=[1.0, 2.0])
    rest, parts = run("repair", path, "-o", tmp_path / "b.usda").err.splitlines()[:2]
    assert "rest poses that intersect themselves: /Hero/Dressed (" in rest
    assert "with --rest" not in rest and "with --rest" in parts
