"""A hidden mesh neither counts nor changes, meets nothing, and holds on to what it is held by."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from dtrepair import RepairOptions
from dtrepair.pipeline import check_stage, repair_stage
from dtrepair.pipeline.repair.chunks import _read
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.frames import read_frame
from dtrepair.pipeline.stages.sources import open_source
from dtrepair.pipeline.stages.world_mesh import WorldScene
from dtrepair.repair.clip.layout import motion_between
from tests.command_line import read_samples
from tests.meshes import elbow, icosphere
from usd_io import AuthoredMesh, write_animation

EVERY = RepairOptions(rest_contacts="repair")
ALONG, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
TIMES = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
ROD, FACES = icosphere(3, 0.12)[0] * [0.5, 6.0, 0.5], icosphere(3)[1]
ARM, PROP = "/Shot/Arm", "/Shot/Rod/Rod"


def shot(path: Path, hidden: tuple[float, ...], by: str) -> Path:
    """A still arm, and a rod that goes through it in all frames; hidden in some."""
    arm, faces = elbow(0.3)
    side = float(arm[np.abs(arm[:, 2] - 0.6) < 0.1, 0].max())
    shift = np.repeat(np.eye(4)[None], len(TIMES), axis=0)
    shift[:, 3, 0] = side + np.array([0.01, 0.015, 0.02, 0.02, 0.015, 0.01])
    shift[:, 3, 2] = 0.6
    if by == "scale":
        shift[np.isin(TIMES, hidden), :3, :3] = 0.0
    poses = np.stack([arm] * len(TIMES))
    rod = AuthoredMesh(PROP, FACES, rest=ROD, transforms=shift)
    write_animation(path, [AuthoredMesh(ARM, faces, poses, rest=arm), rod], times=TIMES)
    if by == "visibility":
        stage = Usd.Stage.Open(str(path))
        seen = UsdGeom.Imageable(stage.GetPrimAtPath(PROP)).CreateVisibilityAttr()
        for time in TIMES:
            seen.Set("invisible" if time in hidden else "inherited", time)
        stage.Save()
    return path


@pytest.mark.parametrize("by", ["scale", "visibility"])
def test_what_is_hidden_is_neither_counted_nor_met(tmp_path: Path, by: str) -> None:
    path, output = shot(tmp_path / "a.usda", (4.0, 5.0, 6.0), by), tmp_path / "out.usda"
    whole = shot(tmp_path / "b.usda", (), by)
    before = [
        record.before for record in check_stage(path, selection=Selection(strict=True)).frames
    ]
    assert [own is not None and own.pairs > 0 for own in before] == [True] * 3 + [False] * 3
    report = repair_stage(path, output, jobs=1, options=EVERY)
    assert [record.status for record in report.frames] == ["clean"] * 6
    assert f"{PROP} in frames 4:6" in next(t for t in report.warnings if t.startswith("hidden"))
    seen = repair_stage(whole, tmp_path / "whole.usda", jobs=1, options=EVERY)
    moved = [record.displacement_max for record in report.frames]
    # The arm eases back where nobody sees what it made room for.
    assert 0.0 < moved[3] < moved[2] and moved[5] < 0.2 * moved[1]
    assert seen.frames[5].displacement_max > 0.5 * moved[1]
    written = read_samples(output, PROP)
    assert all(np.array_equal(written[time], ROD.astype(np.float32)) for time in (4.0, 5.0, 6.0))


def test_include_invisible_takes_it_at_all_times(tmp_path: Path) -> None:
    path = shot(tmp_path / "a.usda", (4.0, 5.0, 6.0), "visibility")
    report = check_stage(path, selection=Selection(strict=True, include_invisible=True))
    assert all(record.before is not None and record.before.pairs for record in report.frames)


def test_motion_leaves_it_out(tmp_path: Path) -> None:
    source = open_source(str(shot(tmp_path / "a.usda", (4.0,), "visibility")), Selection())
    assert read_frame(source, 4.0).hidden == {1} and not read_frame(source, 3.0).hidden
    motions = _read(source)[1]
    assert motions[2] == motions[3] == 0.0 < min(motions[[0, 1, 4]])
    nan = np.full((2, 3), np.nan)
    assert motion_between(nan, nan) == 0.0


def test_pictures_do_not_show_it(tmp_path: Path) -> None:
    source = open_source(str(shot(tmp_path / "a.usda", (4.0,), "visibility")), Selection())
    shown, hidden = (WorldScene(source).points(time)[-len(ROD) :] for time in (3.0, 4.0))
    assert np.ptp(shown, axis=0).max() > 1.0 and not np.ptp(hidden, axis=0).any()


def test_what_holds_it_is_modelled_though_a_scale_hides_it(tmp_path: Path) -> None:
    kept = partial(check_stage, shot(tmp_path / "a.usda", (1.0, 2.0, 6.0), "scale"))
    report = kept()
    assert all(record.before is not None and not record.before.pairs for record in report.frames)
    assert [
        record.before is not None and record.before.modelled_pairs > 0 for record in report.frames
    ] == [False, False, True, True, True, False]


@pytest.mark.parametrize("chosen", [{"alone": True}, {"selection": Selection(frames="5")}])
def test_frames_by_themselves_leave_it_out(tmp_path: Path, chosen: dict[str, Any]) -> None:
    path = shot(tmp_path / "a.usda", (4.0, 5.0, 6.0), "visibility")
    report = repair_stage(path, tmp_path / "out.usda", jobs=1, options=EVERY, **chosen)
    assert all(record.status == "clean" for record in report.frames)
    assert report.frames[-1].displacement_max == 0.0


def test_there_and_back_where_a_scale_hides_it(tmp_path: Path) -> None:
    source = open_source(str(shot(tmp_path / "a.usda", (4.0,), "scale")), Selection())
    rod = source.meshes[1]
    back = source.to_local(rod, 4.0, source.to_world(rod, 4.0, rod.rest))
    assert np.allclose(back, rod.rest, atol=1e-12)


@pytest.mark.parametrize("held", [True, False])
def test_points_at_one_place_stay_where_they_are_held(tmp_path: Path, held: bool) -> None:
    """An arm that goes far with its rod, and a ball where the rod was at rest."""
    arm, faces = elbow(0.3)
    side = float(arm[np.abs(arm[:, 2] - 0.6) < 0.1, 0].max()) + 0.01 + (0.5 if not held else 0.0)
    rod = ROD + side * ALONG + 0.6 * UP
    poses = np.stack([arm + 2.0 * time * ALONG for time in TIMES])
    rods = np.stack([rod + 2.0 * time * ALONG for time in TIMES])
    rods[3:] = rods[3:, :1]
    ball = icosphere(2, 0.2)[0] + side * ALONG + 0.6 * UP
    meshes = [
        AuthoredMesh(ARM, faces, poses, rest=arm),
        AuthoredMesh(PROP, FACES, rods, rest=rod),
        AuthoredMesh(
            "/Shot/Ball", icosphere(2)[1], np.stack([ball] * len(TIMES)), rest=ball + 5.0 * UP
        ),
    ]
    write_animation(tmp_path / "a.usda", meshes, times=TIMES)
    report = repair_stage(tmp_path / "a.usda", tmp_path / "out.usda", jobs=1)
    assert [record.status for record in report.frames] == ["clean"] * 6
    assert max(record.displacement_max for record in report.frames) < 1e-3
    assert any("frames 4:6" in text for text in report.warnings)
