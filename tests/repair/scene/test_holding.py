"""Attached parts that a correction led apart are brought back, and only near their joint."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair import Body, RepairOptions
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.frame.bounded_frames import bounded_frames
from dtrepair.repair.relief.relief import relieved_poses
from dtrepair.repair.scene.holding import Holding
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import detected, gathered
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.strain.parts import changes
from dtrepair.repair.strain.shares import ShareOptions
from tests.meshes import joined, tube
from tests.repair.relief.test_relief import pairs_of, winged


def jointed(pinned: bool = False) -> tuple[Scene, FloatArray, FloatArray]:
    """Two tubes that overlap at their ends, and a correction that leads the second one away."""
    first, (points, faces) = tube(12, 60, 0.2, 4.0), tube(12, 60, 0.23, 4.0)
    second = points + np.array([0.05, 0.01, 3.7]), faces
    points, faces = joined(first, second)
    reference = Reference(points, Detector(points, faces)(points))
    later = np.arange(len(points)) >= len(first[0])
    bodies = [Body(*first, mobility=0.0 if pinned else 1.0), Body(*second)]
    scene = make_scene(bodies, RepairOptions(), references=[reference])
    return scene, points, points + later[:, None] * np.array([0.0, 0.2, 0.0])


@pytest.mark.parametrize("pinned", [False, True])
def test_parts_come_together_at_their_joint_and_stay_elsewhere(pinned: bool) -> None:
    scene, before, after = jointed(pinned)
    held = after + Holding(scene)(before, after)
    parts = scene.strain_meter.parts
    places = parts.tie_offsets(before)
    was, still = (changes(places, parts.tie_offsets(points)).max() for points in (after, held))
    assert still < 0.2 * was
    far = np.abs(before[:, 2] - 1.85) > 2.2
    assert np.array_equal(held[far], after[far])
    fixed = scene.mobility == 0.0
    assert fixed.any() == pinned and np.abs(held - after)[fixed].max(initial=0.0) < 1e-4


def test_of_frames_that_came_off_the_way_with_fewer_pairs_is_kept() -> None:
    """Nothing intersects elsewhere, so all that is led back at the joint is within the bounds."""
    scene, before, after = jointed()
    frame = detected(scene, gathered(scene, np.split(before, [len(before) // 2])))
    (judged,) = bounded_frames(scene, [frame], [after], np.zeros(1))
    assert scene.strain_meter(before, after) and not scene.strain_meter(before, judged.points)
    assert not judged.excess and not judged.lowered


@pytest.mark.parametrize("angle", [1.4, 1.6])
def test_a_frame_within_the_bounds_is_not_spoilt_by_its_neighbour(angle: float) -> None:
    scene, frame, mesh = winged(angle)
    strained = mesh.solve([frame.centred])[0][0]
    (clean,) = relieved_poses(scene, mesh, [frame], [strained])
    assert scene.strain_meter(frame.centred, strained)
    assert not scene.strain_meter(frame.centred, clean) and not len(pairs_of(scene, frame, clean))
    # Led back as its neighbour is, it would meet what it was taken off.
    held = clean + Holding(scene)(frame.centred, clean)
    assert len(pairs_of(scene, frame, held)) > 0
    _, judged = bounded_frames(
        scene, [frame, frame], [strained, clean], np.arange(2.0), options=ShareOptions(spoilt=0)
    )
    assert not judged.lowered and not len(pairs_of(scene, frame, judged.points))
