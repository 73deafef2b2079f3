"""Frames of a single skin that took another way agree with those around them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from dtrepair import Body, RepairOptions
from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import jitter
from dtrepair.repair.clip import steady_frames
from dtrepair.repair.clip.steady_frames import agreed
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh, WeldedMeshes
from tests.meshes import icosphere
from tests.repair.clip.test_clip_repairer import Poses, swing

COUNT, ODD = 21, 10
TIMES = np.arange(float(COUNT))


class Clip(NamedTuple):
    """Pincers that meet in the middle of a clip, and the poses of single frames."""

    scene: Scene
    mesh: WeldedMesh
    frames: list[OpenedPose]
    found: list[FloatArray]

    def in_step(self, poses: list[FloatArray], jobs: int = 1) -> list[FloatArray]:
        return agreed(self.scene, self.mesh, self.frames, self.found, poses, TIMES, jobs=jobs)

    @property
    def original(self) -> Poses:
        return np.stack([frame.centred for frame in self.frames])


@pytest.fixture
def clip() -> Clip:
    """All frames are opened by as much, along their axis; they touch nothing."""
    rest, faces, poses = swing(COUNT)
    scene = make_scene([Body(rest, faces)], RepairOptions())
    frames = [detected(scene, gathered(scene, [pose])) for pose in poses]
    mesh = WeldedMeshes(scene)([frame.weld for frame in frames])
    away = frames[0].centred - frames[ODD].centred
    found = [frame.centred + away for frame in frames]
    return Clip(scene, mesh, frames, found)


def odd(clip: Clip) -> list[FloatArray]:
    """The same, but for one frame that was opened farther."""
    poses = list(clip.found)
    before = clip.frames[ODD].centred
    poses[ODD] = before + 1.3 * (poses[ODD] - before)
    assert not len(clip.scene.pairs(poses[ODD], clip.frames[ODD].weld))
    return poses


def test_a_frame_that_stands_out_comes_into_step(clip: Clip) -> None:
    poses = odd(clip)
    result = clip.in_step(poses)
    assert jitter(clip.original, np.stack(result)) < 0.3 * jitter(clip.original, np.stack(poses))
    for frame, points in zip(clip.frames, result, strict=True):
        assert len(clip.scene.pairs(points, frame.weld)) <= len(frame.pairs)
    assert not len(clip.scene.pairs(result[ODD], clip.frames[ODD].weld))
    # Frames farther off in time are what they were.
    assert all(result[index] is poses[index] for index in (0, 1, COUNT - 1))


def test_two_workers_find_the_same(clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    poses = odd(clip)
    alone = clip.in_step(poses)
    monkeypatch.setattr(steady_frames, "worthwhile_jobs", lambda jobs, *_: jobs)
    np.testing.assert_array_equal(clip.in_step(poses, jobs=2), alone)


def test_where_all_went_the_same_way_nothing_happens(clip: Clip) -> None:
    assert all(a is b for a, b in zip(clip.in_step(clip.found), clip.found, strict=True))


def test_where_none_went_far_nothing_moves(clip: Clip) -> None:
    poses = list(clip.found)
    poses[ODD] = poses[ODD] + 1e-5
    for points, result in zip(poses, clip.in_step(poses), strict=True):
        np.testing.assert_allclose(result, points, atol=1e-12)


def test_frames_between_two_that_went_another_way_stay(clip: Clip) -> None:
    poses = list(clip.found)
    for index in (0, COUNT - 1):
        poses[index] = poses[index] + 0.2 * (clip.found[ODD] - clip.frames[ODD].centred)
    result = clip.in_step(poses)
    assert np.abs(result[0] - poses[0]).max() > 0.0
    np.testing.assert_allclose(result[ODD], poses[ODD], atol=1e-12)


def test_what_would_be_strained_stays(clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    poses = odd(clip)
    known = {id(points) for points in poses}
    monkeypatch.setattr(
        steady_frames, "strain_of", lambda _, before, points: id(points) not in known
    )
    assert all(a is b for a, b in zip(clip.in_step(poses), poses, strict=True))


def test_frames_of_several_parts_are_left_alone() -> None:
    ball, faces = icosphere(2)
    bodies = [Body(ball, faces), Body(ball + 3.0, faces)]
    scene = make_scene(bodies, RepairOptions())
    points = scene.centred_rest
    frames = [detected(scene, gathered(scene, [body.rest for body in bodies]))] * 3
    mesh = WeldedMeshes(scene)([frame.weld for frame in frames])
    poses = [points, points + 0.1, points]
    result = agreed(scene, mesh, frames, [points] * 3, poses, TIMES[:3])
    assert all(a is b for a, b in zip(result, poses, strict=True))


def test_frames_that_still_intersect_stay(clip: Clip) -> None:
    poses = odd(clip)
    beside = poses[ODD + 1] = clip.frames[ODD + 1].centred
    assert len(clip.frames[ODD + 1].pairs)
    np.testing.assert_allclose(clip.in_step(poses)[ODD + 1], beside, atol=1e-12)
