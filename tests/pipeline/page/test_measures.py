"""Measures of frames against motions whose measures are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dtrepair.pipeline.page.measures import frame_measures
from dtrepair.pipeline.page.posed_run import PosedRun
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.sources import open_source
from dtrepair.pipeline.stages.world_mesh import WorldScene
from tests.meshes import icosphere
from usd_io import AuthoredMesh, write_animation


def scene(path: Path, scales: list[float], shifts: list[float]) -> WorldScene:
    """A sphere that grows and moves, a frame for each number."""
    points, faces = icosphere(1)
    poses = [
        (scale * points + np.array([shift, 0, 0])).astype(np.float32)
        for scale, shift in zip(scales, shifts, strict=True)
    ]
    mesh = AuthoredMesh(path="/Ball", faces=[list(map(int, f)) for f in faces], points=poses)
    write_animation(path, mesh, times=np.arange(len(poses), dtype=float))
    return WorldScene(open_source(str(path), Selection()))


def test_volume_and_jitter(tmp_path: Path) -> None:
    before = scene(tmp_path / "a.usda", [1.0] * 4, [0.0] * 4)
    after = scene(tmp_path / "b.usda", [1.0, 1.1, 1.0, 1.0], [0.0, 0.0, 0.0, 0.5])
    run = PosedRun({"before": before, "after": after}, np.arange(4.0), (0, 1, 2, 4))
    measures = frame_measures(run, 5)
    grown = 1.1**3 - 1
    assert measures["volume"] == pytest.approx([0, grown, 0, None, 0], abs=1e-5)
    # Around the second frame every vertex jumps by a tenth of the radius, out and back.
    size = float(np.linalg.norm(np.ptp(icosphere(1)[0], axis=0)))
    assert measures["jitter"] == pytest.approx([None, 0.2 / size, None, None, None], abs=1e-5)


def test_one_pose_has_none(tmp_path: Path) -> None:
    only = scene(tmp_path / "a.usda", [1.0] * 3, [0.0] * 3)
    assert frame_measures(PosedRun({"before": only}, np.arange(3.0), (0, 1, 2)), 3) == {}
