"""Of clothed bodies in single poses the body is led out first, and takes its clothes along."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dtrepair import Body, RepairOptions
from dtrepair.numerics.attached.garments import room_between
from dtrepair.numerics.attachments import NO_TIES
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.relief import bodies_first
from dtrepair.repair.relief.bodies_first import with_bodies_first
from dtrepair.repair.relief.opening import opened_frames
from dtrepair.repair.scene import sub_scene
from dtrepair.repair.scene.bodies import widest_clearance
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.sub_scene import inner_parts, room_over
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from tests.meshes import icosphere
from tests.repair.clip.test_dressed_clips import Dressed, clean

SHIRT = Dressed(40, 12, 33, 0.03)
SHIFT = np.array([0.0, 0.0, 0.7])

Taken = Callable[[WeldedMeshes, OpenedPose, FloatArray], FloatArray]


def opened(scene: Scene, curl: float) -> OpenedPose:
    return detected(scene, gathered(scene, SHIRT.pose(curl)))


def solve(way: WeldedMeshes, pose: OpenedPose) -> FloatArray:
    """The body by itself."""
    return way([pose.sewn]).solve([pose.centred])[0][0]


def test_the_sleeve_goes_along_with_its_arm_without_a_push_of_both(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = make_scene(SHIRT.bodies, RepairOptions())
    pose, rooms = opened(scene, 4.3), list[float]()

    def noted(way: WeldedMeshes, own: OpenedPose) -> FloatArray:
        assert len(own.centred) == len(SHIRT.pose(0.0)[0])
        return solve(way, own)

    def with_room(inner: Scene, *rest: Any, **named: Any) -> list[Judged]:
        rooms.append(inner.options.clearance)
        return opened_frames(inner, *rest, **named)

    monkeypatch.setattr(bodies_first, "opened_frames", with_room)
    found = with_bodies_first(WeldedMeshes(scene), pose, noted)
    assert found is not None and pose.wrong > 10
    poses = np.split(found, [len(SHIRT.pose(0.0)[0])])
    assert clean(poses, SHIRT.faces) and SHIRT.beside(poses).max() < 0.6
    # One layer of cloth on either side, and about half of that is how far each is off.
    assert len(rooms) == 1 and 0.5 * SHIRT.off < rooms[0] < 1.5 * SHIRT.off


@pytest.fixture
def taken(monkeypatch: pytest.MonkeyPatch) -> Taken:
    """A function that returns by what (V, 3) a pose is led on, its body shifted besides."""

    def moved(meshes: WeldedMeshes, pose: OpenedPose, shift: FloatArray) -> FloatArray:
        starts = list[FloatArray]()

        def solved_from(_: object, before: FloatArray, start: FloatArray, **__: object) -> object:
            starts.append(start - before)
            return before, 0.0

        monkeypatch.setattr(bodies_first, "solved_from", solved_from)
        with_bodies_first(meshes, pose, lambda way, own: solve(way, own) + shift)
        (found,) = starts
        return meshes([pose.sewn]).surface.size * found

    return moved


def test_it_is_led_from_there_by_what_the_garment_takes_along(taken: Taken) -> None:
    scene = make_scene(SHIRT.bodies, RepairOptions())
    meshes, pose, body = WeldedMeshes(scene), opened(scene, 4.3), len(SHIRT.pose(0.0)[0])
    assert len(np.unique(scene.garments.vertices)) == len(scene.rest) - body
    led = taken(meshes, pose, 0.0 * SHIFT)
    assert np.allclose(taken(meshes, pose, SHIFT) - led, SHIFT)
    # A sleeve is led off as far as the arm in it.
    farthest = [np.linalg.norm(own, axis=1).max() for own in np.split(led, [body])]
    assert 0.5 * farthest[0] < farthest[1] <= farthest[0]


@pytest.mark.parametrize("why", ["bare", "apart", "in vain", "pinned"])
def test_nothing_is_where_it_cannot_help(why: str) -> None:
    bodies = SHIRT.bodies
    if why == "bare":
        bodies = [bodies[0], Body(*icosphere(2, 0.1))]
    scene = make_scene(bodies, RepairOptions())
    if why == "pinned":
        scene.mobility[-5:] = 0.0
    points = SHIRT.pose(3.0 if why == "apart" else 4.3)
    if why == "bare":
        points[1] = icosphere(2, 0.1)[0]
    pose = detected(scene, gathered(scene, points))

    def in_vain(way: WeldedMeshes, own: OpenedPose) -> FloatArray:
        assert why == "in vain"
        return own.centred

    assert with_bodies_first(WeldedMeshes(scene), pose, in_vain) is None


def test_the_room_is_that_of_most_of_the_cloth_and_of_all_layers() -> None:
    scene = make_scene(SHIRT.bodies, RepairOptions())
    ties, faces = scene.garments, scene.enclosures.faces
    one, two = (room_between(ties, scene.rest, faces, layers) for layers in (1, 2))
    assert two == 2.0 * one and 0.5 * SHIRT.off < one < 1.5 * SHIRT.off
    assert room_between(NO_TIES, scene.rest, faces, 1) == 0.0
    far = scene.rest.copy()
    far[ties.vertices[: len(ties.vertices) // 20]] += 1.0
    assert room_between(ties, far, faces, 1) == pytest.approx(one, rel=0.2)


def test_the_room_is_no_wider_than_a_clearance_may_be(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sub_scene, "room_between", lambda *_: 1e6)
    inner = inner_parts(make_scene(SHIRT.bodies, RepairOptions()))
    assert inner is not None
    assert room_over(inner) == widest_clearance(inner.scene.rest) < 1.0


def test_a_coat_over_the_shirt_goes_along_too(taken: Taken) -> None:
    coat = Dressed(40, 14, 31, 0.05)
    bodies = [*SHIRT.bodies, coat.bodies[1]]
    scene = make_scene(bodies, RepairOptions())
    pose = detected(scene, gathered(scene, [*SHIRT.pose(4.3), coat.pose(4.3)[1]]))
    meshes = WeldedMeshes(scene)
    led = taken(meshes, pose, SHIFT) - taken(meshes, pose, 0.0 * SHIFT)
    assert np.allclose(led[scene.vertices_of(2)], SHIFT)
    # Two layers on either side need twice the room.
    inner = map(inner_parts, (make_scene(SHIRT.bodies, RepairOptions()), scene))
    one, two = (room_over(parts) for parts in inner if parts is not None)
    assert one is not None and two is not None and two > 1.5 * one
