"""Where something would be left within the bounds, looser ones hold of what the input let go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.frame.bounded_frames import bounded_frames
from dtrepair.repair.scene.bounds import Judged, bounded_pose, strain_of
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.strain.bounds import StrainOptions
from tests.repair.relief.test_relief import winged


def turned_wing(loose: float) -> tuple[Scene, OpenedPose, FloatArray]:
    """A wing that the input leads off its place, and a clean pose in which it goes on by .015."""
    scene, frame, mesh = winged(1.6)
    found = mesh.solve([frame.centred])[0][0]
    own = replace(scene, strain=StrainOptions(slide=1.0, drift=0.01, loose=loose))
    assert strain_of(own, frame.centred, found)
    return own, frame, found


@pytest.mark.parametrize("loose", [0.01, 0.02])
def test_what_would_be_left_within_the_bounds_is_not_where_looser_ones_hold(loose: float) -> None:
    scene, frame, found = turned_wing(loose)
    (clip,) = bounded_frames(scene, [frame], [found], np.zeros(1))
    none = np.zeros((0, 2), dtype=np.int32)
    pose, left = bounded_pose(
        scene, frame, Judged(found), none, lambda points: scene.pairs(points, frame.weld)
    )
    held = loose > scene.strain.drift
    for judged in (clip, pose):
        assert (judged.points is found) == held != judged.lowered
        assert bool(judged.excess) != held
    assert (len(left) == 0) == held


@pytest.mark.parametrize("longer", [1.8, 2.5])
def test_what_is_beyond_the_looser_bounds_keeps_the_share_within_them(longer: float) -> None:
    scene, frame, found = turned_wing(0.02)
    far = frame.centred + longer * (found - frame.centred)
    assert strain_of(scene, frame.centred, far, loosely=True)
    none = np.zeros((0, 2), dtype=np.int32)
    (clip,) = bounded_frames(scene, [frame], [far], np.zeros(1))
    pose, left = bounded_pose(
        scene, frame, Judged(far), none, lambda points: scene.pairs(points, frame.weld)
    )
    assert len(left) == 0
    for judged in (clip, pose):
        assert not len(scene.pairs(judged.points, frame.weld)) and not judged.lowered
        assert not strain_of(scene, frame.centred, judged.points, loosely=True)
    # Attached parts were brought back in the clip.
    assert strain_of(scene, frame.centred, pose.points)


def test_at_any_cost_nothing_is_told_that_looser_bounds_hold() -> None:
    scene, frame, found = turned_wing(0.02)
    free = replace(scene, options=replace(scene.options, at_any_cost=True))
    none = np.zeros((0, 2), dtype=np.int32)
    for longer, told in ((1.0, False), (2.0, True)):
        far = frame.centred + longer * (found - frame.centred)
        judged, _ = bounded_pose(free, frame, Judged(far), none, lambda _: none)
        assert judged.points is far and bool(judged.excess) == told


def test_a_frame_that_needs_it_leaves_the_others_within_the_bounds() -> None:
    """The second frame is as strained, and beyond the looser bounds, too."""
    scene, frame, found = turned_wing(0.02)
    farther = frame.centred + 2.0 * (found - frame.centred)
    assert strain_of(scene, frame.centred, farther, loosely=True)
    first, second = bounded_frames(scene, [frame] * 2, [found, farther], np.array([0.0, 20.0]))
    assert first.points is found and not first.excess
    assert not np.array_equal(second.points, farther)
    assert not strain_of(scene, frame.centred, second.points)
