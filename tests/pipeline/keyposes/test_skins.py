"""Key poses of skins and of baked animation: what lies between the keys stays as it bends."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from dtrepair.pipeline.check import check_stage
from dtrepair.pipeline.keyposes.stage import repair_keyposes
from dtrepair.pipeline.selection import Selection
from dtrepair.report.findings import FindingKind
from dtrepair.report.record import Report
from tests.command_line import read_samples, run, tube_stage
from tests.meshes import icosphere
from tests.rigged_tube import MESH, rigged_tube, skinned_points
from usd_io import AuthoredMesh, write_animation

KEYS = [0.0, 8.0, 16.0, 24.0]
WALL = "/Root/Wall"
OFFSET = np.array([3.0, 0.0, 1.0])  # where `rigged_tube` puts the mesh


def baked(path: Path) -> Path:
    """Copy the rotations of the joints to each whole frame."""
    stage = Usd.Stage.Open(str(path))
    turns = stage.GetPrimAtPath("/Root/Animation").GetAttribute("rotations")
    values = {float(time): turns.Get(time) for time in range(25)}
    for time, value in values.items():
        turns.Set(value, time)
    stage.GetRootLayer().Save()
    return path


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """A tube that bends through itself at the two keys in the middle, eight frames apart."""
    return rigged_tube(tmp_path / "rig.usda", (0.0, 120.0, 160.0, 0.0), every=8.0)


def spans_of(report: Report) -> list[tuple[float, float]]:
    assert report.keyposes is not None
    return [(span.start, span.end) for span in report.keyposes.spans]


def test_the_keys_of_the_joints_are_the_keys(rig: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.usda"
    report = repair_keyposes(rig, out)
    assert [frame.time for frame in report.frames if frame.message != "added key"] == KEYS
    assert spans_of(report) == [(0.0, 8.0), (8.0, 16.0), (16.0, 24.0)]
    # The frames themselves are clean, as those that look at the layer see them.
    assert run("check", out).code == 0
    samples = read_samples(out, MESH)
    assert set(samples) >= set(range(25))


def test_a_skin_keeps_its_arc_between_the_keys(rig: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.usda"
    report = repair_keyposes(rig, out)
    samples = read_samples(out, MESH)
    moved = {
        time: samples[time].astype(np.float64) + OFFSET - skinned_points(rig, time)
        for time in map(float, range(25))
    }
    keys = [float(frame.time or 0.0) for frame in report.frames]  # given and added
    assert np.abs(moved[0.0]).max() < 1e-5 and np.abs(moved[16.0]).max() > 0.05
    for time in (5.0, 10.0, 13.0):
        start = max(key for key in keys if key <= time)
        end = min(key for key in keys if key > time)
        share = (time - start) / (end - start)
        expected = (1.0 - share) * moved[start] + share * moved[end]
        assert np.abs(moved[time] - expected).max() < 1e-4


def test_named_frames_of_baked_joints_are_the_keys(rig: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.usda"
    baked(rig)
    report = repair_keyposes(rig, out, selection=Selection(frames="0,8,16,24"))
    assert spans_of(report) == [(0.0, 8.0), (8.0, 16.0), (16.0, 24.0)]
    assert run("check", out).code == 0
    assert run("keyposes", rig, "--verify-only", "--frames", "0:24x8").code == 1
    every = run("keyposes", rig, "--verify-only")
    assert "every whole frame from 0 to 24 has a sample" in every.err


def test_frames_that_nobody_looks_at_stay_as_they_are(rig: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.usda"
    repair_keyposes(rig, out, selection=Selection(frames="0,8"))
    samples = read_samples(out, MESH)
    moved = [
        np.abs(samples[time].astype(np.float64) + OFFSET - skinned_points(rig, time)).max()
        for time in map(float, range(25))
    ]
    assert min(moved[1:9]) > 1e-3 and max(moved[9:]) < 1e-5


def test_a_mesh_that_stands_still_is_held_beside_a_skin(rig: Path, tmp_path: Path) -> None:
    tip = skinned_points(rig, 8.0)[-10:].mean(axis=0)
    still = [tuple(map(float, tip + step)) for step in 0.6 * np.roll(np.eye(3), 1, axis=0) - 0.2]
    stage = Usd.Stage.Open(str(rig))
    wall = UsdGeom.Mesh.Define(stage, WALL)
    wall.GetPointsAttr().Set(still)
    wall.GetFaceVertexCountsAttr().Set([3])
    wall.GetFaceVertexIndicesAttr().Set([0, 1, 2])
    stage.Save()
    out = tmp_path / "out.usda"
    report = repair_keyposes(rig, out, selection=Selection(frames="0,8"))
    (gave,) = (own for own in report.findings if own.kind is FindingKind.MOVED)
    assert gave.path == WALL and 8.0 in gave.times
    held = {time: np.abs(pose - still).max() for time, pose in read_samples(out, WALL).items()}
    assert held[8.0] > 1e-3 and held[4.0] > 1e-4
    assert max(held[float(time)] for time in (0, *range(9, 25))) < 1e-6


def test_a_correction_that_breaks_off_is_told(rig: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.usda"
    whole = repair_keyposes(rig, out)
    assert whole.findings == ()
    for path in (rig, baked(rig)):
        report = repair_keyposes(path, out, selection=Selection(frames="0,8"))
        (found,) = report.findings
        assert (found.kind, found.times) == (FindingKind.BREAKS_OFF, (8.0,))
        assert any("breaks off" in line and "frame 8" in line for line in report.warnings)
    done = run("keyposes", rig, "-o", out, "--frames", "0,8")
    assert "breaks off" in done.err


def test_named_frames_of_baked_points_are_the_keys(tmp_path: Path) -> None:
    angles = [5.0 + 0.2 * min(frame, 16 - frame) for frame in range(17)]
    path = tube_stage(tmp_path / "a.usda", angles)
    report = repair_keyposes(path, tmp_path / "b.usdc", selection=Selection(frames="1,9,17"))
    assert spans_of(report) == [(1.0, 9.0), (9.0, 17.0)]
    before, after = read_samples(path), read_samples(tmp_path / "b.usdc")
    assert set(before) <= set(after)
    assert run("check", tmp_path / "b.usdc").code == 0
    assert np.array_equal(before[1.0], after[1.0]) and not np.array_equal(before[7.0], after[7.0])


def test_a_span_with_an_unusable_frame_is_left(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", [5.0] * 9)
    stage = Usd.Stage.Open(str(path))
    points = stage.GetPrimAtPath("/Root/Tube").GetAttribute("points")
    points.Set([(float("nan"), 0, 0)] * len(points.Get(1)), 3)
    stage.Save()
    report = repair_keyposes(path, selection=Selection(frames="1,5,9"))
    assert report.keyposes is not None and report.keyposes.skipped == 1
    assert spans_of(report) == [(5.0, 9.0)]
    words = "frame 3 between keys cannot be used, so that its span is not looked at: /Root/Tube at "
    assert any(line.startswith(f"{words}frame 3: ") for line in report.warnings)
    assert run("keyposes", path, "--verify-only", "--frames", "1,5,9").err.count(words) == 1
    del points, stage


def test_what_was_modelled_is_learnt_from_the_whole_clip(tmp_path: Path) -> None:
    """Two balls without a rest overlap least in a frame that is no key."""
    ball, faces = icosphere(2, 0.2)
    path, along = tmp_path / "a.usda", 0.01 * np.arange(11.0)
    meshes = []
    for name, aside in (("A", np.zeros(11)), ("B", 0.3 - np.abs(along - 0.05))):
        places = np.stack([aside, np.zeros(11), along], axis=1)
        meshes.append(AuthoredMesh(f"/Root/{name}", faces, [ball + place for place in places]))
    write_animation(path, meshes, times=np.arange(11.0))
    counts = [
        [frame.before for frame in report.frames]
        for report in (
            repair_keyposes(path, selection=Selection(frames="0,10")),
            check_stage(path, selection=Selection(frames="0,10")),
        )
    ]
    assert counts[0] == counts[1] and counts[0][0] is not None and counts[0][0].modelled_pairs
