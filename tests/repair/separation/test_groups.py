"""Bodies that never come near each other, in which groups they are repaired."""

from __future__ import annotations

import numpy as np

from dtrepair import Body, RepairOptions
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.separation.groups import groups_meet, groups_of_bodies
from tests.meshes import icosphere

BALL, FACES = icosphere(1)
ALONG = np.array([1.0, 0.0, 0.0])


def scene_of(*places: float, still: tuple[int, ...] = (), clearance: float = 0.0) -> Scene:
    """Balls of diameter 2 along x, of which some are colliders."""
    bodies = [
        Body(BALL + x * ALONG, FACES, mobility=float(index not in still))
        for index, x in enumerate(places)
    ]
    return make_scene(bodies, RepairOptions(clearance=clearance))


def at(scene: Scene, *places: float) -> FloatArray:
    return np.concatenate([BALL + x * ALONG for x in places])


def test_bodies_are_together_that_are_near_in_any_pose() -> None:
    scene = scene_of(0.0, 10.0, 20.0)
    apart, near = at(scene, 0.0, 10.0, 20.0), at(scene, 0.0, 10.0, 12.1)
    assert groups_of_bodies(scene, [apart]) == [(0,), (1,), (2,)]
    assert groups_of_bodies(scene, [apart, near]) == [(0,), (1, 2)]


def test_near_is_a_tenth_of_the_size_and_the_clearance() -> None:
    places = (0.0, 2.19), (0.0, 2.21), (0.0, 2.31)
    for clearance, expected in ((0.0, [1, 2, 2]), (0.09, [1, 1, 2])):
        scene = scene_of(0.0, 10.0, clearance=clearance)
        assert scene.scale.extent(scene.rest) == np.ptp(BALL, axis=0).max()
        found = [len(groups_of_bodies(scene, [at(scene, *own)])) for own in places]
        assert found == expected


def test_a_collider_is_with_all_that_it_is_near_to_and_joins_none() -> None:
    scene = scene_of(0.0, 2.01, 4.02, 30.0, still=(1, 3))
    assert groups_of_bodies(scene, [scene.rest]) == [(0, 1), (1, 2)]
    # One that stands still has to be nearer than what moves.
    assert groups_of_bodies(scene, [at(scene, 0.0, 2.09, 4.1, 30.0)]) == [(0,), (1, 2)]
    every = scene_of(0.0, 10.0, still=(0, 1))
    assert groups_of_bodies(every, [every.rest]) == [(0, 1)]


def test_what_is_attached_is_together_wherever_it_is() -> None:
    bodies = [Body(BALL + x * ALONG, FACES) for x in (0.0, 1.5, 30.0)]
    scene = make_scene(bodies, RepairOptions())
    reference = Reference(scene.rest, scene.detector(scene.rest, weld=scene.rest_weld))
    scene = make_scene(bodies, RepairOptions(), references=[reference])
    apart = at(scene, 0.0, 10.0, 30.0)
    assert groups_of_bodies(scene, [apart]) == [(0, 1), (2,)]


def test_groups_meet_where_boxes_of_theirs_overlap() -> None:
    scene = scene_of(0.0, 10.0, 20.0, 30.0, still=(2, 3))
    groups = [(0, 2), (1,)]
    assert not groups_meet(scene, groups, [at(scene, 0.0, 10.0, 20.0, 30.0)])
    assert not groups_meet(scene, groups, [at(scene, 0.0, 10.0, 0.5, 30.0)])
    assert groups_meet(scene, groups, [at(scene, 0.0, 10.0, 20.0, 0.5)])
    assert groups_meet(scene, groups, [at(scene, 0.0, 1.9, 20.0, 30.0)])
    assert groups_meet(scene, groups, [at(scene, 0.0, 10.0, 9.0, 30.0)])
    # Colliders among themselves are nobody's concern.
    assert not groups_meet(scene, groups, [at(scene, 0.0, 10.0, 20.0, 21.0)])
