"""What the user calls attached: by an option, a table or a primvar of the stage; and where."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.pipeline import (
    CheckSettings,
    KeyposeSettings,
    ModelledFound,
    ObjectOptions,
    ObjectSettings,
    PrimTable,
    RepairSettings,
    UsageError,
    check_stage,
    plan_repair,
    repair_keyposes,
    repair_stage,
)
from dtrepair.pipeline.errors import InputError
from dtrepair.pipeline.modelled.references import modelled_parts
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.matching import CalledPairs, Side
from dtrepair.pipeline.stages.sources import Source, open_source
from dtrepair.repair.options import RepairOptions
from dtrepair.report.joining import join_reports
from dtrepair.report.record import Report
from tests.command_line import assert_fails, run
from tests.jointed_arm import FORE, UPPER, arm, arm_stage
from tests.pipeline.hosts import Listener

BOTH = "/Root/Upper,/Root/Fore"
COUNT = len(UPPER[0])
# The forearm reaches into the upper arm in two of seven frames, deeper in the last one.
REACHES = (4.0, 4.0, 4.0, 4.0, 4.0, 1.9, 1.8)


def two_meshes(path: Path, reaches: Sequence[float] = REACHES, *, rest: float | None = 4.0) -> Path:
    """Both parts as meshes of their own; the rest pose is the arm with another reach."""
    from usd_io import AuthoredMesh, write_animation

    poses = [arm(0.0, reach) for reach in reaches]
    pose: NDArray[np.float64] | None = None if rest is None else arm(0.0, rest)
    meshes = [
        AuthoredMesh(
            path=f"/Root/{name}",
            faces=faces,
            points=[points[own] for points in poses],
            rest=None if pose is None else pose[own],
        )
        for name, faces, own in (
            ("Upper", UPPER[1], slice(0, COUNT)),
            ("Fore", FORE[1], slice(COUNT, None)),
        )
    ]
    write_animation(path, meshes, times=1.0 + np.arange(len(reaches)))
    return path


@pytest.fixture
def apart(tmp_path: Path) -> Path:
    """Meshes that meet in a few frames only: nothing of it counts as modelled by itself."""
    return two_meshes(tmp_path / "a.usda")


def pairs(report: Report) -> list[tuple[int, int]]:
    """Of each frame the pairs that count, and those that were modelled."""
    return [
        (frame.before.pairs, frame.before.modelled_pairs)
        for frame in report.frames
        if frame.before is not None
    ]


def add_primvar(path: Path, prim: str, kind: str, value: object) -> None:
    """Author primvars:dtrepair:attach with pxr, as a pipeline would."""
    from pxr import Sdf, Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(prim))
    primvar = primvars.CreatePrimvar(
        "dtrepair:attach", getattr(Sdf.ValueTypeNames, kind), UsdGeom.Tokens.constant
    )
    assert primvar.Set(value)
    stage.Save()


def test_without_a_word_they_are_faults(apart: Path) -> None:
    found = pairs(check_stage(apart))
    assert all(modelled == 0 for _, modelled in found) and found[-1][0] and found[-2][0]


def test_attached_where_they_overlap_least(apart: Path) -> None:
    before, after = check_stage(apart), check_stage(apart, attach=(BOTH,))
    (attached,) = after.attached.listed
    assert attached.pose in ("frame 6", "frame 7")
    frame = int(attached.pose.split()[1])
    least = min((p for p, _ in pairs(before) if p), default=0)
    assert attached.pairs == pairs(before)[frame - 1][0] == least
    for (one, none), (left, modelled) in zip(pairs(before), pairs(after), strict=True):
        assert none == 0 and left + modelled == one
    assert pairs(after)[frame - 1] == (0, least)


def test_attached_as_in_the_bind_pose(tmp_path: Path) -> None:
    path = two_meshes(tmp_path / "a.usda", rest=1.8)
    (by_itself,) = check_stage(path).attached.listed
    (asked,) = check_stage(path, attach=(BOTH,)).attached.listed
    assert asked == by_itself and asked.pose == "bind pose"
    # Taken for a fault like all others, but for what is asked for.
    assert not check_stage(path, rest_contacts="repair").attached
    both = check_stage(path, rest_contacts="repair", attach=(BOTH,))
    assert both.attached.listed == (asked,)
    assert pairs(both) == pairs(check_stage(path))


def test_what_is_modelled_anyway_stays_so(tmp_path: Path) -> None:
    """Asked for or not, the same frame shows where: asking takes nothing away."""
    bends = np.linspace(0.1, 0.5, 40)
    path = arm_stage(tmp_path / "a.usda", bends[np.argsort(np.sin(7.0 * bends))], rest=False)
    by_itself, asked = check_stage(path), check_stage(path, attach=("/Root/Arm,/Root/Arm",))
    assert by_itself.attached == asked.attached and len(asked.attached) == 1
    assert pairs(by_itself) == pairs(asked)


def test_attached_parts_of_one_mesh(tmp_path: Path) -> None:
    """A single clip of few frames tells nothing; the user knows that its parts belong together."""
    path = arm_stage(tmp_path / "a.usda", np.array([0.1, 0.2]), rest=False)
    assert not check_stage(path).attached
    assert len(check_stage(path, attach=("/Root/Arm,/Root/Arm",)).attached) == 1


@pytest.mark.parametrize("kind", ["TokenArray", "StringArray", "Token", "String"])
def test_a_primvar_says_what_a_prim_is_attached_to(apart: Path, kind: str) -> None:
    several = kind.endswith("Array")
    add_primvar(apart, "/Root/Fore", kind, ["/Root/Upper"] if several else "/Root/Upper")
    report = check_stage(apart)
    assert pairs(report) == pairs(check_stage(apart, attach=(BOTH,)))
    asked = {"/Root/Fore": {"attach": ["/Root/Upper"]}}
    assert report.document()["settings"]["objects"] == asked
    again = CheckSettings.from_report(report.document()["settings"])
    assert again.tables[0].settings == ObjectSettings(attach=("/Root/Upper",))


def test_a_table_takes_a_primvar_back(apart: Path) -> None:
    add_primvar(apart, "/Root/Fore", "Token", "/Root/Upper")
    assert check_stage(apart).attached
    table = PrimTable("/Root/Fore", ObjectSettings(attach=()))
    report = check_stage(apart, tables=(table,))
    assert not report.attached
    again = CheckSettings.from_report(report.document()["settings"])
    assert not check_stage(apart, again).attached


def test_several_patterns_of_a_primvar(apart: Path) -> None:
    add_primvar(apart, "/Root/Fore", "TokenArray", ["/Root/Upp*", "/Root/Missing"])
    host = Listener()
    report = check_stage(apart, observer=host)
    assert len(report.attached) == 1
    (warning,) = host.warnings
    assert "/Root/Fore: attach /Root/Missing: matches none of the selected meshes" in warning


def test_what_is_attached_and_detached_is_told(apart: Path) -> None:
    host = Listener()
    report = check_stage(apart, attach=(BOTH,), detach=(BOTH,), observer=host)
    assert not report.attached
    told = f"{BOTH}: called both attached and detached: it is detached"
    assert [own for own in host.warnings if "called both" in own] == [told]


def test_values_that_name_nothing_are_refused(apart: Path) -> None:
    add_primvar(apart, "/Root/Fore", "IntArray", [1, 2])
    with pytest.raises(InputError, match="attach should be path expressions"):
        check_stage(apart)


def test_a_table_of_the_config_file_and_the_option_in_it(apart: Path, tmp_path: Path) -> None:
    expected = run("check", apart, "--attach", BOTH, "--json", "-").json["frames"]
    texts = (
        f'attach = ["{BOTH}"]',
        '[[prim]]\npath = "/Root/Fore"\nattach = ["/Root/Upper"]',
        '[[prim]]\npath = "/Root/Fore"\nattach = "/Root/Upper"',
    )
    for text in texts:
        config = tmp_path / "c.toml"
        config.write_text(text)
        found = run("check", apart, "--config", config, "--json", "-").json["frames"]
        assert [frame["before"] for frame in found] == [frame["before"] for frame in expected]
    config.write_text('[[prim]]\npath = "/Root/Fore"\nattach = [3]')
    assert_fails(run("check", apart, "--config", config), 2, "attach should be path expressions")


def test_repair_leaves_what_is_attached_and_its_report_says_it_again(
    apart: Path, tmp_path: Path
) -> None:
    settings = RepairSettings(
        objects=ObjectOptions(attach=(BOTH,)), selection=Selection(frames="7")
    )
    host = Listener()
    # An older count without the option moves them apart; with it they are clean as they are.
    assert (
        repair_stage(apart, tmp_path / "b.usda", selection=Selection(frames="7"))
        .frames[0]
        .displacement_max
    )
    report = repair_stage(apart, tmp_path / "b.usda", settings, observer=host)
    (frame,) = report.frames
    assert frame.status == "clean" and frame.after is not None and frame.after.modelled_pairs
    assert not frame.displacement_max
    (told,) = (remark for remark in host.remarks if isinstance(remark, ModelledFound))
    assert told.attached == report.attached and host.warnings == []
    plan_repair(apart, tmp_path / "b.usda", settings, observer=(planned := Listener()))
    assert planned.remarks == [told] and planned.warnings == []
    recorded = report.document()["settings"]
    assert RepairSettings.from_report(recorded) == settings
    assert KeyposeSettings.from_report(recorded).objects == settings.objects
    every = RepairOptions(rest_contacts="repair")
    kept = repair_stage(apart, tmp_path / "c.usda", settings, options=every)
    assert kept.frames[0].after == frame.after


def test_a_distributed_run_tells_it_too(
    apart: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The workers say nothing; what they found is in the report of the whole."""

    def repaired(
        repair: Any, source: Source, output: str, settings: RepairSettings, *others: Any
    ) -> Report:
        return join_reports([repair(source.name, output, settings).document()])

    monkeypatch.setattr("dtrepair.pipeline.repair.stage.repair_distributed", repaired)
    host, objects = Listener(), ObjectOptions(attach=(BOTH,))
    selection = Selection(frames="6:7")
    report = repair_stage(
        apart,
        tmp_path / "b.usda",
        selection=selection,
        objects=objects,
        distributed="local",
        observer=host,
    )
    (told,) = (remark for remark in host.remarks if isinstance(remark, ModelledFound))
    assert told.attached == report.attached and len(report.attached) == 1


def test_key_poses_know_what_is_attached(apart: Path, tmp_path: Path) -> None:
    objects = ObjectOptions(attach=(BOTH,))
    report = repair_keyposes(apart, objects=objects, selection=Selection(frames="6:7"))
    assert all(frame.status == "clean" for frame in report.frames)
    assert len(report.attached) == 1


def test_what_never_meets_is_told(tmp_path: Path) -> None:
    path = two_meshes(tmp_path / "a.usda", (4.0, 5.0))
    host = Listener()
    assert not check_stage(path, attach=(BOTH,), observer=host).attached
    assert (
        len(host.warnings) == 1
        and "meet neither in the bind pose nor in a frame" in host.warnings[0]
    )
    alone = Listener()
    check_stage(path, attach=("/Root/Fore,/Root/Fore",), observer=alone)
    assert "different parts of /Root/Fore meet neither" in alone.warnings[0]


def test_ignored_pairs_are_not_attached(apart: Path) -> None:
    report = check_stage(apart, attach=(BOTH,), ignore=(BOTH,))
    assert not report.attached and not any(sum(counts) for counts in pairs(report))


def test_wrong_texts_and_methods_are_refused(apart: Path, tmp_path: Path) -> None:
    for text in ("/Root/Upper", "/Root/Upper,", "/Root/Upper,/Root/Fore,/Root/Fore"):
        with pytest.raises(UsageError, match=f"--attach {text}: expected two prims"):
            check_stage(apart, attach=(text,))
    # It says which of the two.
    with pytest.raises(UsageError, match="/Root/Nothing: /Root/Nothing: matches none of the sel"):
        check_stage(apart, attach=("/Root/Upper,/Root/Nothing",))
    with pytest.raises(UsageError, match=r"selected meshes \(.*\); is /Root/Upper meant\?"):
        check_stage(apart, attach=("/Root/Fore,/Root/Uper",))
    paper = RepairOptions(method="paper")
    with pytest.raises(UsageError, match="--attach: has no effect with --method paper"):
        RepairSettings(options=paper, objects=ObjectOptions(attach=(BOTH,)))
    table = PrimTable("/Root/Fore", ObjectSettings(attach=("/Root/[",)))
    with pytest.raises(UsageError, match="attach /Root/"):
        plan_repair(apart, tmp_path / "b.usda", tables=(table,))


def test_parts_of_a_farm_agree(apart: Path) -> None:
    """The whole clip is looked at, whichever frames are selected."""
    whole, part = (
        modelled_parts(
            open_source(str(apart), Selection(frames=frames)),
            told=CalledPairs(attached=((Side(0), Side(1)),)),
        ).attached
        for frames in (None, "1:2")
    )
    assert whole == part and len(whole) == 1
