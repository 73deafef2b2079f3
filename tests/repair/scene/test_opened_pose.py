"""Opened poses: centred where they are far away, detected once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dtrepair import Body, RepairOptions, SceneRepairer, find_intersections
from dtrepair.numerics.attachments import Reference
from dtrepair.repair.scene.bodies import Absent
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import detected, gathered
from tests.meshes import icosphere

BALL, FACES = icosphere(1)
SCENE = make_scene(
    [Body(BALL, FACES), Body(0.2 * BALL + 5.0, FACES), Body(BALL - 9.0, FACES)], RepairOptions()
)
ALONG = np.array([1.0, 0.0, 0.0])
BESIDE = BALL + 1.6 * ALONG
POSE = [BALL, 0.2 * BALL, BALL + 0.7]


def test_a_pose_is_opened_in_steps() -> None:
    opened = gathered(SCENE, POSE)
    assert not opened.detected and opened.wrong == 0
    assert np.array_equal(opened.original, np.concatenate(POSE))
    found = detected(SCENE, opened)
    assert found.detected and len(found.pairs) > 0 and len(found.enclosed) == 1
    assert found.wrong == len(found.pairs) + 1
    assert detected(SCENE, found) is found


def test_a_pose_far_from_the_origin_is_centred() -> None:
    away = np.array([1e6, -2e6, 0.0])
    near, far = gathered(SCENE, POSE), gathered(SCENE, [points + away for points in POSE])
    assert np.array_equal(near.centred, near.original) and near.centre == 0.0
    assert np.abs(far.centred).max() < 3.0
    assert np.allclose(far.centred + far.centre, far.original, rtol=0.0, atol=1e-9)
    assert np.array_equal(detected(SCENE, far).pairs, detected(SCENE, near).pairs)


def test_more_triangles_in_fewer_pairs_are_no_better() -> None:
    one = np.stack([np.arange(20), 20 + np.arange(20) % 2], axis=1).astype(np.int32)
    pose = replace(gathered(SCENE, POSE), pairs=one)  # 22 triangles in 20 pairs
    assert pose.wrong == pose.wrong_with(one, 0) == 20 and pose.wrong_with(one[:5], 2) == 7
    # Up to a tenth more of them, and ten, may be in fewer pairs.
    wider, wide = (np.arange(2 * n, dtype=np.int32).reshape(-1, 2) for n in (17, 19))
    assert pose.wrong_with(wider, 0) == 17 and pose.wrong_with(wide, 0) == 20 + 38 - 34
    # Not where parts were led out of others.
    inside = replace(pose, enclosed=np.zeros((2, 2), np.int32))
    assert inside.wrong_with(wide, 1) == 20 and inside.wrong_with(wide, 2) == 22 + 38 - 34


def test_absent_bodies_meet_nothing_and_come_back() -> None:
    flat = BALL * [0.0, 1.0, 1.0]
    scene = make_scene(
        [Body(BALL, FACES), Body(BALL + 5.0, FACES), Body(flat, FACES)], RepairOptions()
    )
    pose = [BALL, Absent(BALL + 0.7), Absent(flat + 0.6 * ALONG)]
    opened = detected(scene, gathered(scene, pose))
    assert opened.wrong == 0 and opened.absent is not None
    assert np.array_equal(opened.absent, scene.body_of_vertex > 0)
    boxes = [opened.original[scene.vertices_of(body)][:, 0] for body in range(3)]
    assert boxes[0].max() < boxes[1].min() and boxes[1].max() < boxes[2].min()
    assert detected(scene, gathered(scene, [BALL, BALL + 0.7, flat + 9.0])).wrong > 0
    repairer = SceneRepairer([Body(BALL, FACES), Body(BALL + 5.0, FACES)])
    first, second = repairer([BALL, Absent(BALL + 0.7)])
    assert np.array_equal(first.points, BALL) and np.array_equal(second.points, BALL + 0.7)


def test_absent_bodies_stay_where_others_hold_on_to_them() -> None:
    rest = np.concatenate([BALL, BESIDE])
    faces = np.concatenate([FACES, FACES + len(BALL)])
    held = Reference(rest, find_intersections(rest, faces))
    bodies = [Body(BALL, FACES), Body(BESIDE, FACES)]
    scene = make_scene(bodies, RepairOptions(), references=[held])
    opened = gathered(scene, [BALL, Absent(BESIDE)])
    assert np.array_equal(opened.original, rest)
