"""Frames in which corrections jump are told once, with their meshes."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from dtrepair.numerics.metrics import JumpMeter, JumpOptions
from dtrepair.pipeline import ObjectOptions, Selection, repair_stage
from dtrepair.pipeline.repair import motion
from dtrepair.pipeline.repair.motion import Motion
from dtrepair.pipeline.stages.sources import open_source
from tests.meshes import icosphere
from usd_io import AuthoredMesh, write_animation

WALL = "/Set/Wall"


def stage_of(folder: Path, places: list[float]) -> Path:
    """A ball that is at these places beside another, which does not move."""
    ball, faces = icosphere(2, radius=0.5)
    moves = np.tile(np.eye(4), (len(places), 1, 1))
    moves[:, 3, 0] = places
    meshes = [
        AuthoredMesh("/Set/Ball", faces, rest=ball, transforms=moves),
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
    stage = stage_of(tmp_path, [1.3, 1.2, 0.8, 1.2, 1.3])
    assert told(stage) == []
    sharp = partial(JumpMeter, options=JumpOptions(farther=-1.0))
    monkeypatch.setattr(motion, "JumpMeter", sharp)
    (text,) = told(stage)
    assert text.startswith("corrections that jump: /Set/Ball in frame 2:4 (by up to ")
    assert told(stage, alone=True) == []


def test_the_meshes_that_jump_farthest_come_first(tmp_path: Path) -> None:
    source = open_source(str(stage_of(tmp_path, [1.3])), Selection())
    ball = icosphere(2, radius=0.5)[0]
    found = Motion(source)
    for time, far in enumerate([0.0, 0.0, 0.1, 0.0, 0.0, 0.2, 0.0]):
        found.add(float(time), [ball, ball], [ball + 0.5 * far, ball + far])
    found.add(7.0, [], [])  # a frame that failed
    (text,) = found.warnings
    assert text.startswith(f"corrections that jump: {WALL} in frame 2, 5 (by up to 20 %")
    assert "; " in text and "/Set/Ball in frame 2, 5 (by up to 10 %" in text
    assert found.jitter is not None and found.jitter > 0.01
