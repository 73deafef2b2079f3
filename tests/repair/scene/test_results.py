"""Results: what is no better is not taken, what did not move keeps its bits."""

from __future__ import annotations

import numpy as np

from dtrepair import Body, RepairOptions, Status
from dtrepair.diagnosis import Advice, Deformation, RemainingContact, RemainingEnclosure
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.result import Count, RepairResult, Solved
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.results import kept, results_of
from dtrepair.repair.scene.scene import Scene
from tests.meshes import icosphere

BALL, FACES = icosphere(1)
NEAR, AWAY = np.array([0.7, 0.1, 0.0]), np.array([5.0, 0.0, 0.0])
BODIES = [Body(BALL, FACES, name="one"), Body(BALL + AWAY, FACES, name="two")]
PLAIN = make_scene(BODIES, RepairOptions())


def opened(scene: Scene, *poses: FloatArray) -> OpenedPose:
    return detected(scene, gathered(scene, poses))


def answered(
    scene: Scene, pose: OpenedPose, points: FloatArray, *, left: int = 0
) -> list[RepairResult]:
    found = kept(scene, pose, points, scene.pairs(points, scene.weld(points)))
    return results_of(scene, pose, found, Solved(points, left=left), {"solve": 1.0})


CROSSING = opened(PLAIN, BALL, BALL + NEAR)
APART = np.concatenate([BALL, BALL + AWAY])


def test_a_clean_pose_is_taken_and_unmoved_vertices_keep_their_bits() -> None:
    first, second = answered(PLAIN, CROSSING, APART)
    assert np.array_equal(first.points, BALL)
    assert np.array_equal(second.points, (BALL + AWAY).astype(np.float32))
    assert first.status is second.status is Status.CLEAN and first.message == ""
    assert first.before.inter_pairs == first.before.pairs == len(CROSSING.pairs)
    assert first.after == Count(0, 0, 0)
    assert first.displacement_max == 0.0 < second.displacement_mean


def test_what_is_no_better_is_not_taken() -> None:
    worse = np.concatenate([BALL, BALL + 0.5 * NEAR])
    for points in (worse, CROSSING.centred.copy()):
        found = kept(PLAIN, CROSSING, points, PLAIN.pairs(points, PLAIN.weld(points)))
        assert found.points is CROSSING.centred and found.pairs is CROSSING.pairs
    first, second = answered(PLAIN, CROSSING, worse)
    assert first.status is second.status is Status.UNCHANGED
    assert np.array_equal(second.points, BALL + NEAR)


def test_a_part_that_was_pressed_right_into_another_one_is_told() -> None:
    small = 0.2 * BALL
    scene = make_scene([Body(BALL, FACES), Body(small + AWAY, FACES)], RepairOptions())
    pose = opened(scene, BALL, small + np.array([1.0, 0.0, 0.0]))
    assert len(pose.pairs) > 1 and len(pose.enclosed) == 0
    inside = np.concatenate([BALL, small + np.array([0.1, 0.0, 0.0])])
    first, second = answered(scene, pose, inside)
    assert first.after.pairs == second.after.pairs == 0
    assert second.status is Status.IMPROVED and len(second.diagnosis.enclosures) == 1


def test_contacts_that_are_left_are_values() -> None:
    held = make_scene(
        [BODIES[0], Body(BALL + AWAY, FACES, name="two", mobility=0.0)], RepairOptions()
    )
    better = np.concatenate([BALL - 1.2 * NEAR, BALL + NEAR])
    first, second = answered(held, opened(held, BALL, BALL + NEAR), better)
    pairs = first.after.pairs
    assert first.status is Status.IMPROVED and 0 < pairs < first.before.pairs
    assert first.diagnosis.contacts == (RemainingContact("one", "two", pairs),)
    assert first.diagnosis.advice == (Advice.RAISE_EFFORT, Advice.RAISE_DIFFUSION)
    assert second.diagnosis == first.diagnosis
    assert first.message.startswith(f"one and two still intersect ({pairs} pairs): fewer")


def test_what_is_left_alone_of_the_rest_is_told_by_its_number() -> None:
    bodies = [Body(BALL, FACES), Body(BALL + NEAR, FACES)]
    scene = make_scene(bodies, RepairOptions(rest_contacts="leave"))
    pose = opened(scene, BALL, BALL + NEAR)
    first, _ = answered(scene, pose, pose.centred)
    assert first.diagnosis.rest_pairs == len(pose.pairs) and not first.diagnosis.contacts
    assert "intersects in the rest pose as well" in first.message


def test_what_is_inside_is_not_clean() -> None:
    bodies = [Body(BALL, FACES, name="head"), Body(0.2 * BALL + AWAY, FACES, name="pea")]
    scene = make_scene(bodies, RepairOptions())
    pose = opened(scene, BALL, 0.2 * BALL)
    for result in answered(scene, pose, pose.centred):
        assert result.status is Status.UNCHANGED and result.after.pairs == 0
        assert result.diagnosis.enclosures == (RemainingEnclosure("pea", "head"),)


def test_clean_results_tell_what_is_too_close_or_much_deformed() -> None:
    first, _ = answered(PLAIN, CROSSING, APART, left=3)
    assert first.diagnosis.too_close == 3
    assert first.message == "3 pairs closer than the clearance"
    larger = np.concatenate([BALL, 2.0 * BALL + AWAY])
    first, second = answered(PLAIN, CROSSING, larger)
    assert not first.diagnosis
    (found,) = second.diagnosis.deformations
    assert found == Deformation("two", found.lengths, found.volume)
    assert abs(found.lengths - 2.0) < 1e-3 and found.volume is not None
    assert abs(found.volume - 8.0) < 1e-2
