"""No harm: what strains a shape is not kept, is told, and is taken only at any cost."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dtrepair import Body, RepairOptions, RepairResult, SceneRepairer, Status
from dtrepair.diagnosis import Advice, StrainKind
from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.frame.bounded_frames import bounded_frames
from dtrepair.repair.independent_options import IndependentOptions
from dtrepair.repair.result import Solved
from dtrepair.repair.scene.bounds import Judged, blended, bounded_pose, strain_of
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.results import kept, results_of
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.strain.bounds import StrainOptions
from dtrepair.repair.strain.shares import ShareOptions
from tests.meshes import bent_tube, icosphere, joined

BALL, FACES = icosphere(2)
FAR = np.array([0.0, 0.0, 9.0])
NEAR, AWAY = np.array([1.7, 0.1, 0.0]), np.array([2.1, 0.1, 0.0])
BODIES = [Body(BALL, FACES, name="one"), Body(BALL + 2.0 * AWAY, FACES, name="two")]


def scene_of(**values: Any) -> Scene:
    return make_scene(BODIES, RepairOptions(**values))


PLAIN, ANY_COST = scene_of(), scene_of(at_any_cost=True)
CROSSING = detected(PLAIN, gathered(PLAIN, [BALL, BALL + NEAR]))


def flattened() -> FloatArray:
    """Clean, as the second ball is pressed flat at its place: crushed."""
    points = CROSSING.centred.copy()
    second = points[len(BALL) :]
    second[:, 0] = 1.2 + 0.01 * second[:, 0]
    return points


def bounded(
    scene: Scene, points: FloatArray, pose: OpenedPose = CROSSING
) -> tuple[Judged, IntArray]:
    def pairs_of(found: FloatArray) -> IntArray:
        return scene.pairs(found, scene.weld(found))

    return bounded_pose(scene, pose, Judged(points), pairs_of(points), pairs_of)


def answered(scene: Scene, points: FloatArray) -> list[RepairResult]:
    judged, pairs = bounded(scene, points)
    found = kept(scene, CROSSING, judged.points, pairs)
    return results_of(scene, CROSSING, found, Solved(judged.points), {}, judged)


def test_what_is_within_the_bounds_is_kept_with_every_bit() -> None:
    apart = np.concatenate([BALL, BALL + AWAY])
    judged, pairs = bounded(PLAIN, apart)
    assert judged.points is apart and not judged.excess and not judged.lowered and not len(pairs)


def test_the_kept_pose_is_within_the_bounds_and_not_worse_than_the_input() -> None:
    crushed = flattened()
    assert {e.kind for e in strain_of(PLAIN, CROSSING.centred, crushed)} >= {StrainKind.VOLUME}
    judged, pairs = bounded(PLAIN, crushed)
    assert judged.lowered and judged.excess
    assert strain_of(PLAIN, CROSSING.centred, judged.points) == ()
    first, second = answered(PLAIN, crushed)
    assert 0 < second.after.pairs <= len(CROSSING.pairs) and len(pairs) > 0
    assert second.status is Status.STRAINED and second.diagnosis.left_out
    (told, *_) = second.diagnosis.strains
    assert told.body == "two" and told.value > told.bound and told.parts == 1
    assert np.allclose(told.place, CROSSING.original[len(BALL) + told.vertex])
    # The other one is not strained: it only meets what is.
    assert first.status is not Status.CLEAN and not first.diagnosis.strains
    assert Advice.TAKE_AT_ANY_COST in first.diagnosis.advice
    assert str(told) in second.message and "two still intersect" in second.message


def test_at_any_cost_the_clean_pose_is_kept_and_told() -> None:
    crushed = flattened()
    first, second = answered(ANY_COST, crushed)
    assert second.after.pairs == 0 and second.status is Status.STRAINED
    assert np.array_equal(second.points, crushed[len(BALL) :].astype(np.float32))
    assert second.diagnosis.strains and not second.diagnosis.left_out
    assert first.status is Status.CLEAN


def test_the_published_method_is_not_judged() -> None:
    scene = scene_of(method="paper")
    crushed = flattened()
    judged, _ = bounded(scene, crushed)
    assert judged.points is crushed and not judged.excess
    assert {result.status for result in answered(scene, crushed)} == {Status.CLEAN}


def test_where_nothing_is_lost_nothing_is_told() -> None:
    mesh = joined((BALL, FACES), (BALL + FAR, FACES))
    scene = make_scene([BODIES[0], Body(*mesh, name="two")], RepairOptions())
    points = mesh[0]
    pose = detected(scene, gathered(scene, [BALL, points + NEAR]))
    # Led apart, and for no reason the far ball is pressed flat.
    solved = np.concatenate([BALL, points + AWAY])
    solved[2 * len(BALL) :, 2] = 9.0 + 0.1 * (solved[2 * len(BALL) :, 2] - 9.0)
    judged, pairs = bounded(scene, solved, pose)
    assert not len(pairs) and not judged.excess and not judged.lowered
    assert strain_of(scene, pose.centred, judged.points) == ()
    near = slice(0, 2 * len(BALL))
    assert np.array_equal(judged.points[near], solved[near])


def test_no_better_than_the_input_is_not_looked_at() -> None:
    crushed = flattened()
    crushed[len(BALL) :, 0] -= 1.0
    worse = PLAIN.pairs(crushed, PLAIN.weld(crushed))
    pose = replace(CROSSING, pairs=worse[:1])
    judged, pairs = bounded_pose(PLAIN, pose, Judged(crushed), worse, lambda found: worse)
    assert judged.points is crushed and pairs is worse
    assert kept(PLAIN, pose, judged.points, pairs).points is pose.centred


def test_what_is_inside_stays_told_where_leading_it_out_would_ruin_it() -> None:
    bodies = [Body(BALL, FACES, name="head"), Body(0.2 * BALL + AWAY, FACES, name="pea")]
    scene = make_scene(bodies, RepairOptions())
    pose = detected(scene, gathered(scene, [BALL, 0.2 * BALL]))
    flat = np.concatenate([BALL, 0.2 * BALL * [1.0, 1.0, 0.01] + 2.0 * AWAY])
    judged, pairs = bounded(scene, flat, pose)
    found = kept(scene, pose, judged.points, pairs)
    head, pea = results_of(scene, pose, found, Solved(found.points), {}, judged)
    assert strain_of(scene, pose.centred, found.points) == ()
    assert pea.status is Status.STRAINED and pea.diagnosis.enclosures and pea.diagnosis.strains
    assert head.status is not Status.CLEAN and not head.diagnosis.strains


def test_a_share_keeps_bits_seams_and_rigid_bodies() -> None:
    rigid = make_scene([BODIES[0], replace(BODIES[1], rigid=True)], RepairOptions())
    before, after = CROSSING.centred, CROSSING.centred + 0.1
    share = np.ones(len(before))
    share[0], share[-1] = 0.0, 0.5
    mixed = blended(rigid, before, after, share)
    assert np.array_equal(mixed[0], before[0]) and np.array_equal(mixed[1], after[1])
    assert np.allclose(mixed[len(BALL) :], before[len(BALL) :] + 0.05)


def swinging(frames: int, depth: float = 0.6) -> list[OpenedPose]:
    """Two balls of which the second comes near and goes again."""
    shift = depth * np.sin(np.linspace(0.0, np.pi, frames))
    poses = [[BALL, BALL + AWAY - [float(part), 0.0, 0.0]] for part in shift]
    return [detected(PLAIN, gathered(PLAIN, pose)) for pose in poses]


def motion(frames: list[OpenedPose], poses: list[FloatArray]) -> FloatArray:
    """The longest motion in each frame (T,)."""
    both = zip(frames, poses, strict=True)
    return np.array([np.abs(points - frame.centred).max() + 1e-9 for frame, points in both])


def led_off(frames: list[OpenedPose]) -> list[FloatArray]:
    """The second ball led off the first, and pressed flat in five frames in the middle."""
    poses = []
    for index, frame in enumerate(frames):
        points = frame.centred.copy()
        points[len(BALL) :] += [0.62 * np.sin(np.pi * index / 23.0), 0.0, 0.0]
        if 9 <= index <= 13:
            points[len(BALL) :, 1] *= 0.3
        poses.append(points)
    return poses


def test_frames_that_easing_would_spoil_stay_as_they_are() -> None:
    frames = swinging(24)
    poses, times = led_off(frames), np.arange(24.0)
    judged = bounded_frames(PLAIN, frames, poses, times)
    for index, (frame, found) in enumerate(zip(frames, judged, strict=True)):
        assert strain_of(PLAIN, frame.centred, found.points) == ()
        if 9 <= index <= 13:
            assert found.excess and len(PLAIN.pairs(found.points, frame.weld)) <= len(frame.pairs)
        else:
            assert len(PLAIN.pairs(found.points, frame.weld)) <= ShareOptions.spoilt
    assert judged[8].points is poses[8] and judged[14].points is poses[14]
    # What brings no more pairs than that back is eased as before.
    eased = bounded_frames(PLAIN, frames, poses, times, options=ShareOptions(spoilt=10_000))
    assert not np.array_equal(eased[8].points, poses[8])


def test_easing_brings_no_more_pairs_than_the_input_has() -> None:
    frames, times = swinging(24), np.arange(24.0)
    poses, few = led_off(frames), frames[8].pairs[:1]
    frames[8] = replace(frames[8], pairs=few)
    options = ShareOptions(spoilt=10_000)
    judged = bounded_frames(PLAIN, frames, poses, times, options=options)
    assert len(PLAIN.pairs(judged[8].points, frames[8].weld)) <= len(few)


def test_shares_of_a_clip_are_within_the_bounds_smooth_and_not_worse() -> None:
    frames = swinging(24, depth=0.1)
    poses = led_off(frames)
    times = np.arange(24.0)
    judged = bounded_frames(PLAIN, frames, poses, times)
    part = motion(frames, [found.points for found in judged]) / motion(frames, poses)
    assert np.abs(np.diff(part[1:-1])).max() < 0.4 and part.min() < 0.8
    for frame, found in zip(frames, judged, strict=True):
        assert strain_of(PLAIN, frame.centred, found.points) == ()
        assert len(PLAIN.pairs(found.points, frame.weld)) <= len(frame.pairs)
    # What is far from it in time is as it was found.
    assert judged[1].points is poses[1] and judged[-2].points is poses[-2]
    free = bounded_frames(ANY_COST, frames, poses, times)
    assert all(found.points is pose for found, pose in zip(free, poses, strict=True))
    calm = bounded_frames(PLAIN, frames[:5], poses[:5], times[:5])
    assert all(found.points is pose for found, pose in zip(calm, poses, strict=False))


def test_frames_without_a_fault_do_not_move_for_what_is_given_up() -> None:
    frames = [detected(PLAIN, gathered(PLAIN, [BALL, BALL + AWAY])) for _ in range(9)]
    frames[4] = CROSSING
    poses = [frame.centred.copy() for frame in frames]
    for index, points in enumerate(poses):
        points[len(BALL) :, 0] += 0.5 * np.exp(-0.5 * (index - 4.0) ** 2)
    poses[4] = flattened()
    assert strain_of(PLAIN, CROSSING.centred, poses[4])
    judged = bounded_frames(PLAIN, frames, poses, np.arange(9.0))
    moved = motion(frames, [found.points for found in judged])
    assert moved[4] < 0.25 * motion(frames, poses)[4]
    beside = np.array([0, 1, 2, 3, 5, 6, 7, 8])
    assert (moved[beside] <= moved[4]).all() and not judged[3].excess


TIGHT = ClipOptions(
    independent=IndependentOptions(strain=StrainOptions(factor=1.02, edges=0, edges_share=0.0))
)


def tube_scene(options: RepairOptions, clip: ClipOptions | None = None) -> SceneRepairer:
    return SceneRepairer([Body(*bent_tube(4.0))], options=options, clip=clip)


@pytest.mark.parametrize("at_any_cost", [False, True])
def test_a_repair_from_end_to_end(at_any_cost: bool) -> None:
    pose = [bent_tube(6.5)[0]]
    options = RepairOptions(at_any_cost=at_any_cost)
    (plain,) = tube_scene(RepairOptions())(pose)
    (result,) = tube_scene(options, TIGHT)(pose)
    assert plain.status is Status.CLEAN and result.status is Status.STRAINED
    assert result.diagnosis.strains and result.diagnosis.left_out != at_any_cost
    repairer = tube_scene(options, TIGHT)
    strains = repairer.strains(pose, [result.points])
    if at_any_cost:
        assert np.array_equal(result.points, plain.points) and strains
    else:
        assert 0 < result.after.pairs <= plain.before.pairs and not strains


def test_frames_of_a_clip_from_end_to_end() -> None:
    angles = [*np.linspace(5.0, 6.5, 4), *np.linspace(6.5, 5.0, 4)]
    frames = [(float(k), [bent_tube(angle)[0]]) for k, angle in enumerate(angles)]
    results = {}
    for name, options in (("kept", RepairOptions()), ("any", RepairOptions(at_any_cost=True))):
        stream = tube_scene(options, TIGHT).animator.stream(frames, jobs=1)
        results[name] = [frame.results[0] for frame in stream]
    repairer = tube_scene(RepairOptions(), TIGHT)
    for (_, points), result in zip(frames, results["kept"], strict=True):
        assert not repairer.strains(points, [result.points])
        assert result.after.pairs <= result.before.pairs
    strained = [result.status is Status.STRAINED for result in results["any"]]
    assert any(strained) and all(result.after.pairs == 0 for result in results["any"])
    assert any(result.status is Status.STRAINED for result in results["kept"])
