"""Frames in which corrections jump, or bend props, are told once, with their meshes."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import JumpMeter, JumpOptions
from dtrepair.pipeline import ObjectOptions, Selection, repair_stage
from dtrepair.pipeline.repair import motion
from dtrepair.pipeline.repair.motion import BendMeter, BendOptions, Motion, StillMeter
from dtrepair.pipeline.repair.settings import OutputOptions
from dtrepair.pipeline.stages.sources import open_source
from dtrepair.report.findings import FindingKind, warnings_of
from tests.meshes import bent_tube, icosphere, joined
from tests.pipeline.hosts import Listener
from usd_io import AuthoredMesh, write_animation

# Transforms are written to the parents: each mesh has one of its own.
MOVED, WALL = "/Set/Ball/Mesh", "/Set/Wall/Mesh"
TIMES = (1.0, 2.0, 3.0)


def stage_of(folder: Path, places: list[float]) -> Path:
    """A ball that is at these places beside another, which does not move."""
    ball, faces = icosphere(2, radius=0.5)
    moves = np.tile(np.eye(4), (len(places), 1, 1))
    moves[:, 3, 0] = places
    meshes = [
        AuthoredMesh(MOVED, faces, rest=ball, transforms=moves),
        AuthoredMesh(WALL, faces, rest=ball, transforms=np.tile(np.eye(4), (len(places), 1, 1))),
    ]
    path = folder / "a.usda"
    write_animation(path, meshes, times=np.arange(1.0, len(places) + 1.0))
    return path


def told(stage: Path, *, alone: bool = False) -> list[str]:
    objects = ObjectOptions(collider=WALL)
    report = repair_stage(stage, stage.with_name("b.usda"), objects=objects, alone=alone)
    assert [frame.status for frame in report.frames] == ["clean"] * len(report.frames)
    return [text for text in report.warnings if "jump" in text]


def test_what_jumps_is_told_but_not_where_frames_are_solved_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = stage_of(tmp_path, [1.1, 1.0, 0.95, 0.92, 0.95, 1.0, 1.1])
    assert told(stage) == []
    sharp = partial(JumpMeter, options=JumpOptions(farther=-1.0))
    monkeypatch.setattr(motion, "JumpMeter", sharp)
    (text,) = told(stage)
    assert text.startswith(f"corrections that jump: {MOVED} in frames 2:6 (by up to ")
    assert told(stage, alone=True) == []


@pytest.mark.parametrize(
    ("frames", "cut", "told"), [(None, 0.0, 1), ("1:6x2", 0.0, 0), (None, 0.4, 0), (None, 9.0, 0)]
)
def test_neither_frames_far_apart_nor_shots_are_neighbours(
    tmp_path: Path, frames: str | None, cut: float, told: int
) -> None:
    points, faces = icosphere(3)
    every = np.arange(1.0, 7.0)
    poses = np.stack([points + 0.01 * time + cut * (time > 3.0) for time in every])
    write_animation(tmp_path / "a.usda", [AuthoredMesh("/Set/Hero", faces, poses)], times=every)
    source = open_source(str(tmp_path / "a.usda"), Selection(frames=frames))
    corrections = Motion(source)
    for time, pose in zip(every, poses, strict=True):
        if time in source.times:
            side = 0.3 if time <= 3.0 else -0.3
            corrections.add(time, [pose], [pose + np.eye(3)[0] * side])
    jumps = [found for found in corrections.findings() if found.kind is FindingKind.JUMPS]
    assert [found.times for found in jumps] == [(4.0,)] * told


def test_a_part_of_a_mesh_that_jumps_is_told(tmp_path: Path) -> None:
    small = icosphere(0, radius=0.05)
    points, faces = joined(icosphere(4), (small[0] + 2.0, small[1]))
    pose = np.stack([points] * 3)
    write_animation(tmp_path / "a.usda", [AuthoredMesh("/Set/Hero", faces, pose)], times=TIMES)
    corrections = Motion(open_source(str(tmp_path / "a.usda"), Selection()))
    for time, far in zip(TIMES, (0.0, 0.3, 0.0), strict=True):
        after = points.copy()
        after[-len(small[0]) :, 0] += far
        corrections.add(time, [points], [after])
    (found,) = corrections.findings()
    assert str(found).startswith("/Set/Hero in frame 2 (by up to ")


def test_the_meshes_that_jump_farthest_come_first(tmp_path: Path) -> None:
    source = open_source(str(stage_of(tmp_path, [1.3] * 8)), Selection())
    ball = icosphere(2, radius=0.5)[0]
    found = Motion(source)
    for time, far in zip(source.times, [0.0, 0.0, 0.1, 0.0, 0.0, 0.2, 0.0], strict=False):
        found.add(time, [ball, ball], [ball + 0.5 * far, ball + far])
    found.add(source.times[-1], [], [])  # a frame that failed
    findings = found.findings()
    assert [own.kind for own in findings] == ["jumps"] * 2
    assert findings[1].times == (source.times[2], source.times[5])
    (text,) = warnings_of(findings)
    assert text.startswith(f"corrections that jump: {WALL} in frames 3, 6 (by up to 20 %")
    assert "; " in text and f"{MOVED} in frames 3, 6 (by up to 10 %" in text
    assert found.jitter is not None and found.jitter > 0.01


def test_a_range_of_frames_breaks_off_where_it_ends(tmp_path: Path) -> None:
    stage = stage_of(tmp_path, [1.3, 1.1, 0.95, 0.9, 0.95, 1.1, 1.3])
    out = tmp_path / "b.usda"

    def broken(frames: str, **choices: Any) -> list[tuple[str, tuple[float, ...]]]:
        selection = Selection(frames=frames)
        report = repair_stage(stage, out, selection=selection, **choices)
        found = [own for own in report.findings if own.kind == "breaks_off"]
        assert any("breaks off" in text for text in report.warnings) == bool(found)
        listed = report.document().get("findings", [])
        assert [own for own in listed if own["kind"] == "breaks_off"] == [
            {"kind": own.kind, "path": own.path, "largest": own.largest, "times": list(own.times)}
            for own in found
        ]
        assert all(0.002 < own.largest < 0.2 for own in found)
        return [(own.path, own.times) for own in found]

    objects = ObjectOptions(collider=WALL)
    assert broken("1:7", objects=objects) == []
    assert broken("4:7", objects=objects) == [(MOVED, (4.0,))]
    assert broken("3:5", objects=objects) == [(MOVED, (3.0, 5.0))]
    assert broken("3:5", objects=objects, alone=True) == []
    only = OutputOptions(only_frames=True)
    assert broken("3:5", objects=objects, writing=only) == []


BALL = icosphere(2, radius=0.5)[0]
DENTED = BALL * np.where(BALL[:, :1] > 0.0, [0.6, 1.0, 1.0], 1.0)


def turned(points: FloatArray, angle: float) -> FloatArray:
    across = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.hstack([points[:, :2] @ across.T, points[:, 2:]])


@pytest.mark.parametrize(
    ("poses", "told"),
    [
        ([BALL, turned(BALL, 0.5), BALL + 1.0], True),
        ([BALL, BALL, BALL], False),  # a scene that does not move tells nothing
        ([BALL, turned(BALL, 0.5), BALL * [1.0, 1.0, 0.9]], False),  # it deforms by itself
    ],
)
def test_what_moves_as_a_whole_and_is_bent_is_found(poses: list[FloatArray], told: bool) -> None:
    meter = BendMeter()
    for time, pose in enumerate(poses):
        dented = pose - BALL + DENTED if time == 2 else turned(pose, 0.1) + 0.2
        meter.add(float(time), pose, dented)
    assert list(meter.bends) == ([2.0] if told else [])
    whole = BendMeter(options=BendOptions(farther=1e-6))
    for time, pose in enumerate(poses):
        whole.add(float(time), pose, turned(pose, 0.3) + 1.0)
    assert not whole.bends


@pytest.mark.parametrize(("bend", "told"), [(0.015, False), (0.03, True)])
def test_a_bend_is_told_from_two_per_cent_of_the_size_on(bend: float, told: bool) -> None:
    meter, size = BendMeter(), float(np.linalg.norm(np.ptp(BALL, axis=0)))
    for time in range(3):
        after = BALL + np.array([0.3 * time, 0.0, 0.0])
        before = after.copy()
        after[np.argmax(BALL[:, 2]), 2] += bend * size
        meter.add(float(time), before, after)
    assert bool(meter.bends) == told


@pytest.mark.parametrize(("wide", "told"), [(0.1, True), (0.5, False)])
def test_of_a_long_prop_less_is_seen(wide: float, told: bool) -> None:
    sword = BALL * [wide, 0.1, 2.0]
    meter = BendMeter()
    for time in range(3):
        pose = sword + np.array([0.3 * time, 0.0, 0.0])
        bow = 0.03 * np.cos(2.0 * pose[:, 2:]) * [1.0, 0.0, 0.0]
        meter.add(float(time), pose, pose + bow)
    assert bool(meter.bends) == told


def test_bent_props_are_told_with_what_keeps_them(tmp_path: Path) -> None:
    stage = stage_of(tmp_path, [1.3, 1.2, 0.8, 1.2, 1.3])

    def bent(rigid: str | None) -> list[str]:
        objects = ObjectOptions(collider=WALL, rigid=rigid)
        report = repair_stage(stage, tmp_path / f"{rigid is None}.usda", objects=objects)
        return [text for text in report.warnings if text.startswith("bent")]

    (text,) = bent(None)
    assert f"{MOVED} in frames " in text and WALL not in text and "--rigid" in text
    assert bent(MOVED) == []


@pytest.mark.parametrize(("by", "told"), [(0.005, False), (0.02, True)])
@pytest.mark.parametrize("moves", [False, True])
def test_what_stands_still_and_is_moved_is_found(by: float, told: bool, moves: bool) -> None:
    meter, size = StillMeter(), float(np.linalg.norm(np.ptp(BALL, axis=0)))
    for time in range(3):
        pose = BALL + (1e-6 * time if moves else 0.0)
        meter.add(float(time), pose, pose + np.array([by * size * (time == 1), 0.0, 0.0]))
    assert list(meter.gives) == ([1.0] if told and not moves else [])


def test_what_gave_way_though_it_stands_still_is_told(tmp_path: Path) -> None:
    stage = stage_of(tmp_path, [1.3, 1.2, 0.8, 1.2, 1.3])

    def moved(collider: str | None = None) -> list[str]:
        objects = ObjectOptions(collider=collider)
        report = repair_stage(stage, tmp_path / f"{collider is None}.usda", objects=objects)
        return [text for text in report.warnings if text.startswith("moved, though")]

    (text,) = moved()
    assert f"{WALL} in frames " in text and MOVED not in text and "--collider" in text
    assert moved(collider=WALL) == []


def test_what_a_rigid_thing_has_with_itself_is_told_and_left(tmp_path: Path) -> None:
    ball, faces = bent_tube(7.0)
    moves = np.tile(np.eye(4), (3, 1, 1))
    moves[:, 3, 0] = (9.0, 8.0, 7.0)
    other = icosphere(1)
    meshes = [
        AuthoredMesh(MOVED, faces, rest=ball, transforms=moves),
        AuthoredMesh(WALL, other[1], rest=other[0], transforms=moves[::-1]),
    ]
    stage, told = tmp_path / "a.usda", "rigid, and intersect themselves"
    write_animation(stage, meshes, times=np.arange(1.0, 4.0))
    for rigid in (None, MOVED):
        out = tmp_path / f"{rigid is None}.usda"
        host = Listener()
        report = repair_stage(stage, out, objects=ObjectOptions(rigid=rigid), observer=host)
        before = [frame.before.pairs for frame in report.frames if frame.before is not None]
        assert (sum(before) > 0) == (rigid is None) and len(before) == 3
        (text,) = [own for own in host.warnings if "intersect themselves" in own]
        assert text.startswith(told) == (rigid is not None) and MOVED in text and WALL not in text
