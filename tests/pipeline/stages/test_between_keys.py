"""Frames between sparse samples are checked and repaired, and what is written reads back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from dtrepair.pipeline import (
    Cancelled,
    Observer,
    Selection,
    check_stage,
    join_layers,
    plan_repair,
    repair_stage,
)
from dtrepair.pipeline.observer import FrameDone
from dtrepair.pipeline.repair.journal import Journal
from tests.cgal_reference import cgal_pairs
from tests.command_line import run, tube_obj
from tests.meshes import icosphere, joined
from tests.present import present

POINTS, FACES = icosphere(1)


def ball(stage: Usd.Stage, path: str, points: NDArray[np.floating] = POINTS) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr([3] * len(FACES))
    mesh.CreateFaceVertexIndicesAttr(FACES.reshape(-1).tolist())
    mesh.CreateSubdivisionSchemeAttr("none")
    return mesh


def passing_balls(path: Path, keys: tuple[float, float] = (0.0, 10.0)) -> Path:
    """A still ball and one that a transform with two keys leads past it: they meet in between."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.Xform.Define(stage, "/Root")
    ball(stage, "/Root/Still")
    slide = ball(stage, "/Root/Moved", 0.5 * POINTS).AddTranslateOp()
    for key, x in zip(keys, (-4.0, 4.0), strict=True):
        slide.Set((x, 1.2, 0.0), key)
    stage.GetRootLayer().Save()
    return path


def morphing_balls(path: Path) -> Path:
    """The same of one mesh, whose points have the keys."""
    stage = Usd.Stage.CreateNew(str(path))
    still, moved = POINTS, 0.5 * POINTS + np.array([0.0, 1.2, 0.0])
    faces = np.concatenate([FACES, FACES + len(POINTS)])
    mesh = UsdGeom.Mesh.Define(stage, "/Balls")
    mesh.CreateFaceVertexCountsAttr([3] * len(faces))
    mesh.CreateFaceVertexIndicesAttr(faces.reshape(-1).tolist())
    mesh.CreateSubdivisionSchemeAttr("none")
    for key, x in ((0.0, -4.0), (10.0, 4.0)):
        points, _ = joined((still, FACES), (moved + np.array([x, 0, 0]), FACES))
        mesh.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)), key)
    stage.GetRootLayer().Save()
    return path


def world(path: Path, time: float) -> NDArray[np.float64]:
    """World points of all meshes, as USD itself composes and interpolates them."""
    stage = Usd.Stage.Open(str(path))
    placed = []
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh):
            points = np.asarray(UsdGeom.Mesh(prim).GetPointsAttr().Get(time), dtype=np.float64)
            matrix = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(time))
            placed.append(points @ matrix[:3, :3] + matrix[3, :3])
    return np.concatenate(placed)


def counted(path: Path, time: float) -> int:
    points = world(path, time)
    faces = np.concatenate([FACES, FACES + len(POINTS)]).astype(np.int32)
    return len(cgal_pairs(points.astype(np.float32), faces))


def samples(path: Path, prim: str, name: str = "points") -> list[float]:
    layer = Sdf.Layer.FindOrOpen(str(path))
    return list(layer.ListTimeSamplesForPath(f"{prim}.{name}"))


@pytest.mark.parametrize("make", [passing_balls, morphing_balls])
def test_what_meets_between_two_keys_is_found_and_repaired(
    tmp_path: Path, make: Callable[[Path], Path]
) -> None:
    stage, output = make(tmp_path / "in.usda"), tmp_path / "out.usdc"
    report = check_stage(stage)
    dirty = [present(frame.time) for frame in report.frames if frame.status != "clean"]
    assert [frame.time for frame in report.frames] == np.arange(11.0).tolist()
    assert dirty == [time for time in np.arange(2.0, 9.0) if counted(stage, time)] and dirty
    assert {0.0, 10.0}.isdisjoint(dirty)
    repair_stage(stage, output, jobs=1)
    for time in dirty:
        assert counted(output, time) == 0, time


def test_untouched_frames_and_in_betweens_read_as_before(tmp_path: Path) -> None:
    stage, output = morphing_balls(tmp_path / "in.usda"), tmp_path / "out.usdc"
    report = repair_stage(stage, output, jobs=1, alone=True)
    changed = {present(frame.time) for frame in report.frames if frame.displacement_max}
    assert changed and max(changed) - min(changed) < 8.0
    # A float32 rounding at each end of an interpolation.
    for time in np.arange(0.0, 10.01, 0.25):
        near = {np.floor(time), np.ceil(time)}
        if near & changed:
            continue
        np.testing.assert_allclose(world(output, time), world(stage, time), atol=1e-6)
    for key in (0.0, 10.0):
        np.testing.assert_array_equal(world(output, key), world(stage, key))
    written = samples(output, "/Balls")
    assert written == samples(output, "/Balls", "extent")
    beside = {min(changed) - 1.0, max(changed) + 1.0}
    assert set(written) == changed | beside | {0.0, 10.0}
    layer = Sdf.Layer.FindOrOpen(str(output))
    record = layer.customLayerData["dtrepair"]
    assert set(record["frames"]) == changed


def test_points_that_end_between_keys_end_where_they_did(tmp_path: Path) -> None:
    stage, output = passing_balls(tmp_path / "in.usda"), tmp_path / "out.usdc"
    edited = Usd.Stage.Open(str(stage))
    points = UsdGeom.Mesh(edited.GetPrimAtPath("/Root/Still")).GetPointsAttr()
    points.Set(points.Get(), 0.0)
    points.Set(Sdf.ValueBlock(), 7.5)
    edited.Save()
    report = repair_stage(stage, output, jobs=1, alone=True)
    skipped = [frame.time for frame in report.frames if frame.status == "skipped"]
    assert skipped == [7.5, 8.0, 9.0, 10.0]
    result = Usd.Stage.Open(str(output))
    after = UsdGeom.Mesh(result.GetPrimAtPath("/Root/Still")).GetPointsAttr()
    held = np.asarray(points.Get(7.4))
    np.testing.assert_array_equal(after.Get(7.4), held)
    assert after.Get(7.5) is None and after.Get(9.0) is None
    assert any(frame.displacement_max for frame in report.frames)


def looped_balls(folder: Path) -> Path:
    """The balls of one mesh in a value clip that is played twice: at frame 10 it jumps back."""
    morphing_balls(folder / "clip.usda")
    stage = Usd.Stage.CreateNew(str(folder / "in.usda"))
    mesh = UsdGeom.Mesh.Define(stage, "/Balls")
    faces = np.concatenate([FACES, FACES + len(POINTS)])
    mesh.CreateFaceVertexCountsAttr([3] * len(faces))
    mesh.CreateFaceVertexIndicesAttr(faces.reshape(-1).tolist())
    clips = Usd.ClipsAPI(mesh.GetPrim())
    clips.SetClipAssetPaths([Sdf.AssetPath("./clip.usda")])
    clips.SetClipPrimPath("/Balls")
    clips.SetClipActive([(0, 0)])
    clips.SetClipTimes([(0, 0), (10, 10), (10, 0), (20, 10)])
    clips.SetClipManifestAssetPath(Sdf.AssetPath("./clip.usda"))
    stage.GetRootLayer().Save()
    return folder / "in.usda"


def test_value_clips_jump_where_they_did(tmp_path: Path) -> None:
    stage, output = looped_balls(tmp_path), tmp_path / "out.usdc"
    report = repair_stage(stage, output, jobs=1, alone=True)
    changed = {present(frame.time) for frame in report.frames if frame.displacement_max}
    assert {5.0, 15.0} <= changed < set(range(21))
    # A line from key to key, 0 to 10, would stand still.
    assert np.abs(world(stage, 9.0) - world(stage, 0.0)).max() > 7.0
    for time in set(np.arange(21.0)) - changed:
        np.testing.assert_array_equal(world(output, time), world(stage, time))


def test_a_frame_between_keys_can_be_named(tmp_path: Path) -> None:
    stage, output = passing_balls(tmp_path / "in.usda"), tmp_path / "out.usdc"
    done = run("check", stage, "--frames", "5")
    assert done.code == 1
    assert run("repair", stage, "--frames", "5", "-o", output).code == 0
    assert counted(output, 5.0) == 0
    for time in (4.0, 6.0):
        assert counted(output, time) == counted(stage, time) > 0


def test_samples_are_the_authored_ones(tmp_path: Path) -> None:
    stage = passing_balls(tmp_path / "in.usda")
    found = run("check", stage, "--samples", "--json", "-")
    assert found.code == 0 and [f["time"] for f in found.json["frames"]] == [0.0, 10.0]
    assert found.json["settings"]["samples_only"] is True
    plan = plan_repair(stage, tmp_path / "out.usdc", selection=Selection(samples_only=True))
    assert plan.times == (0.0, 10.0)
    config = tmp_path / "c.toml"
    config.write_text("samples-only = true\n[keyposes]\nsamples = 4\n")
    assert run("check", stage, "--config", config).code == 0
    assert "samples" in run("check", "--help").out


def test_mesh_files_have_no_samples(tmp_path: Path) -> None:
    done = run("check", tube_obj(tmp_path / "a.obj"), "--samples")
    assert done.code == 2 and "--samples" in done.err


def test_a_key_far_off_is_told(tmp_path: Path) -> None:
    stage = passing_balls(tmp_path / "in.usda", (0.0, 1e9))
    done = run("check", stage)
    assert done.code == 0 and "only the 2 keys are looked at" in done.err
    named = run("check", stage, "--frames", "499999999:500000001")
    assert named.code == 1 and "keys" not in named.err


def test_chunks_of_sparse_samples_join_to_one_run(tmp_path: Path) -> None:
    stage = passing_balls(tmp_path / "in.usda")
    parts = [tmp_path / f"{number}.usdc" for number in (1, 2, 3)]
    for number, part in enumerate(parts, 1):
        repair_stage(stage, part, jobs=1, alone=True, chunk=f"{number}/3")
    whole, output = tmp_path / "whole.usdc", tmp_path / "joined.usdc"
    repair_stage(stage, whole, jobs=1, alone=True)
    join_layers([str(part) for part in parts], str(output))
    for prim in ("/Root/Still", "/Root/Moved"):
        assert samples(output, prim) == samples(whole, prim)
        assert samples(output, prim, "extent") == samples(whole, prim, "extent")
    for time in np.arange(0.0, 10.01, 0.5):
        np.testing.assert_array_equal(world(output, time), world(whole, time))


class Impatient(Observer):
    """Ends a run as soon as a frame beyond half of it is written."""

    ended = False

    def remark(self, remark: object) -> None:
        self.ended |= isinstance(remark, FrameDone) and remark.record.time == 6.0

    def cancelled(self) -> bool:
        return self.ended


@pytest.mark.parametrize("alone", [False, True])
def test_sparse_samples_are_resumed_to_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, alone: bool
) -> None:
    stage = passing_balls(tmp_path / "in.usda")
    whole, output = tmp_path / "whole.usdc", tmp_path / "out.usdc"
    repair_stage(stage, whole, jobs=1, alone=alone)
    with pytest.raises(Cancelled):
        repair_stage(stage, output, jobs=1, alone=alone, observer=Impatient())
    found: list[bool] = []
    recall = Journal.recall

    def counted(self: Journal, key: str) -> Any:
        arrays = recall(self, key)
        found.append(arrays is not None)
        return arrays

    monkeypatch.setattr(Journal, "recall", counted)
    repair_stage(stage, output, jobs=1, alone=alone, resume=True)
    if alone:  # together, the balls are led apart before any window is solved
        assert sum(found) >= 6
    assert output.read_bytes() == whole.read_bytes()
