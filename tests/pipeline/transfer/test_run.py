"""A transfer from a script: the command line's bytes, ended by an observer, silent."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from dtrepair.pipeline.errors import Cancelled, OutputError, UsageError, exit_code
from dtrepair.pipeline.observer import FrameDone
from dtrepair.pipeline.selection import ObjectOptions
from dtrepair.pipeline.transfer.options import TransferOptions
from dtrepair.pipeline.transfer.run import plan_transfer, transfer_stage
from dtrepair.pipeline.transfer.settings import TransferSettings
from dtrepair.repair.options import RepairOptions
from dtrepair.report.record import read_report
from tests.command_line import OPEN, run, tube_obj, tube_stage
from tests.observers import Recorder


@pytest.fixture
def inputs(tmp_path: Path) -> tuple[str, str]:
    """An animated tube, whose ends pass through each other twice, and a resting one."""
    source = tube_stage(tmp_path / "source.usda")
    target = tube_stage(tmp_path / "target.usda", (), rest=OPEN)
    return str(source), str(target)


def names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_what_both_sides_have_to_tell_is_told_once(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, OPEN))
    stage = Usd.Stage.Open(str(path))
    UsdGeom.Sphere.Define(stage, "/Root/Ball")
    stage.GetRootLayer().Save()
    report = transfer_stage(path, path, tmp_path / "b.usda")
    (told,) = (line for line in report.warnings if "/Root/Ball" in line)
    assert told.startswith("/Root/Ball (Sphere) is no mesh")
    assert run("transfer", path, path, "-o", tmp_path / "b.usda").err.count("/Root/Ball") == 1


@pytest.mark.parametrize("repaired", [False, True])
def test_a_script_writes_the_bytes_of_the_command_line(
    inputs: tuple[str, str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    repaired: bool,
) -> None:
    outputs = [tmp_path / "a.usda", tmp_path / "b.usda", tmp_path / "c.usda"]
    more = ("--repair", "--tighten", 1) if repaired else ()
    told = tmp_path / "r.json"
    done = run("transfer", *inputs, "-o", outputs[0], "--root-scale", 2, "--report", told, *more)
    capsys.readouterr()
    report = transfer_stage(
        *inputs,
        str(outputs[1]),
        options=TransferOptions(root_scale=2.0),
        repair=RepairOptions(tighten=1) if repaired else None,
    )
    captured = capsys.readouterr()
    assert captured.out == captured.err == ""
    assert exit_code(report) == done.code == (0 if repaired else 1)
    # All choices of a run as one object, out of its report.
    settings = TransferSettings.from_report(read_report(told)["settings"])
    again = transfer_stage(*inputs, str(outputs[2]), settings)
    assert settings == TransferSettings.from_report(report.settings)
    assert outputs[0].read_bytes() == outputs[1].read_bytes() == outputs[2].read_bytes()
    assert [frame.after for frame in again.frames] == [frame.after for frame in report.frames]


@pytest.mark.parametrize("shapes", [False, True])
def test_mesh_files_give_a_new_stage(tmp_path: Path, shapes: bool) -> None:
    rest, first, second = (
        str(tube_obj(tmp_path / f"{name}.obj", angle))
        for name, angle in (("rest", OPEN), ("first", OPEN + 0.1), ("second", OPEN + 0.2))
    )
    poses = (first, second)
    outputs = [tmp_path / "one.usda", tmp_path / "two.usda"]
    more = ("--shapes",) if shapes else ()
    done = run("transfer", rest, rest, "--poses", *poses, "-o", outputs[0], *more)
    options = TransferOptions(shapes=shapes)
    report = transfer_stage(rest, rest, str(outputs[1]), poses=poses, options=options)
    assert done.code == exit_code(report) == 0
    assert outputs[0].read_bytes() == outputs[1].read_bytes()
    assert TransferSettings.from_report(report.settings).poses == poses
    assert ("BlendShape" in outputs[0].read_text()) is shapes


@pytest.mark.parametrize("end_at", [1, 3, 5])
@pytest.mark.parametrize("alone", [None, True, False])
def test_a_cancelled_transfer_leaves_the_old_output(
    inputs: tuple[str, str], tmp_path: Path, end_at: int, alone: bool | None
) -> None:
    output = tmp_path / "out.usda"
    output.write_text("old")
    before = names_in(tmp_path)
    observer = Recorder(end_at)
    with pytest.raises(Cancelled, match="no output was written") as caught:
        transfer_stage(
            *inputs,
            str(output),
            repair=None if alone is None else RepairOptions(tighten=0),
            alone=alone,  # frames are transferred only, repaired each for itself, or together
            observer=observer,
        )
    assert caught.value.exit_code == 130
    assert output.read_text() == "old" and names_in(tmp_path) == before
    assert observer.ends == len(observer.phases)


def test_an_observer_hears_of_frames_and_warnings(inputs: tuple[str, str], tmp_path: Path) -> None:
    observer = Recorder()
    target = tube_stage(tmp_path / "moving.usda", (OPEN, OPEN))
    report = transfer_stage(
        inputs[0], str(target), str(tmp_path / "out.usda"), observer=observer, jobs=1
    )
    assert observer.phases == [("transferring", 3)] and observer.steps[-1] == 3.0
    frames = [remark for remark in observer.remarks if isinstance(remark, FrameDone)]
    assert tuple(done.record for done in frames) == report.frames
    assert observer.warnings == list(report.warnings)
    assert any("the animation of /Root/Tube is replaced" in text for text in observer.warnings)


def test_a_plan_writes_nothing(inputs: tuple[str, str], tmp_path: Path) -> None:
    before = names_in(tmp_path)
    plan = plan_transfer(*inputs, str(tmp_path / "out.usda"))
    assert plan.times == (1.0, 2.0, 3.0) and plan.output == str(tmp_path / "out.usda")
    assert [mesh.path.rpartition(" ")[2] for mesh in plan.meshes] == ["/Root/Tube"] * 2
    assert plan.meshes[0].triangles == plan.meshes[1].triangles > 0
    assert names_in(tmp_path) == before


@pytest.mark.parametrize(
    ("choices", "words"),
    [
        ({"align": "feet"}, "align should be one of axes, rests"),
        ({"source_up": "X"}, "source_up should be one of Y, Z"),
        ({"root_scale": -1.0}, "root_scale should be at least 0"),
        ({"root_scale": np.inf}, "root_scale should be at least 0"),
        ({"markers": "a", "correspondence": "b"}, "give one of them"),
        ({"ground": True, "pin": "p"}, "no effect on pinned frames"),
        ({"shapes": True, "pin": "p"}, "no effect with --shapes"),
    ],
)
def test_options_that_do_not_go_together(choices: dict[str, object], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        TransferOptions(**choices)  # type: ignore[arg-type]


def test_settings_that_do_not_go_together() -> None:
    with pytest.raises(UsageError, match="no effect without --repair"):
        TransferSettings(alone=True)
    with pytest.raises(UsageError, match="shapes are no motion"):
        shapes = TransferOptions(shapes=True)
        TransferSettings(options=shapes, repair=RepairOptions(), alone=False)
    with pytest.raises(UsageError, match="a transfer takes pins of its options"):
        TransferSettings(objects=ObjectOptions(pin="hand"), repair=RepairOptions())
    with pytest.raises(UsageError, match="--rigid: has no effect with --method paper"):
        TransferSettings(objects=ObjectOptions(rigid="/Eye"), repair=RepairOptions(method="paper"))


def test_errors_of_outputs_carry_their_code(inputs: tuple[str, str], tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="is an input of this run"):
        transfer_stage(*inputs, inputs[1])
    with pytest.raises(UsageError, match="another output"):
        both = TransferOptions(save_correspondence="o.usda")
        transfer_stage(*inputs, "o.usda", options=both)
    with pytest.raises(OutputError, match="no directory") as caught:
        transfer_stage(*inputs, str(tmp_path / "no" / "o.usda"))
    assert caught.value.exit_code == 5
