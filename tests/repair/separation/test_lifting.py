"""Layers are lifted off what came through them; what is no layer, or may not move, stays."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.separation.layer_lift import LayerLift, LiftOptions, Sunken
from dtrepair.repair.separation.lifting import lifted_frames, not_worn, parts_that_meet
from tests.meshes import icosphere, joined, torus, tube

ARM = tube(24, 40, 0.2, 4.0)
SLEEVE = tube(24, 12, 0.23, 1.0)
RING = torus(48, 12, 0.24, 0.02)
BOTH = np.array([[0, 1]], dtype=np.int32)


def radius(points: FloatArray) -> FloatArray:
    lengths: FloatArray = np.linalg.norm(points[:, :2], axis=1)
    return lengths


def swollen(points: FloatArray, growth: float) -> FloatArray:
    """The arm, thicker in its middle."""
    factor = 1.0 + growth * np.exp(-((points[:, 2:] / 0.4) ** 2))
    return np.hstack([points[:, :2] * factor, points[:, 2:]])


def scene_of(*meshes: tuple[FloatArray, IntArray], **choices: object) -> Scene:
    bodies = [Body(*ARM), *(Body(*mesh, **choices) for mesh in meshes)]  # type: ignore[arg-type]
    return make_scene(bodies, RepairOptions())


def lifted(scene: Scene, *poses: FloatArray, meet: IntArray = BOTH) -> FloatArray:
    frames = np.arange(len(poses), dtype=np.float64)
    return lifted_frames(scene, np.stack(poses), [meet] * len(poses), frames)


@pytest.mark.parametrize("mesh", [SLEEVE, RING], ids=["sleeve", "ring"])
def test_what_a_limb_swallows_ends_outside_of_it(mesh: tuple[FloatArray, IntArray]) -> None:
    arm = swollen(ARM[0], 0.4)
    before = np.concatenate([arm, mesh[0]])
    assert (radius(mesh[0]) < 0.27).any()
    after = lifted(scene_of(mesh), before)[0]
    assert (after[: len(arm)] == arm).all()
    layer = after[len(arm) :]
    inner = np.abs(layer[:, 2]) < 0.1
    assert (radius(layer)[inner] > 0.2 * 1.35).all()
    # No farther than it has to, and a ring keeps its thickness.
    assert np.linalg.norm(layer - mesh[0], axis=1).max() < 0.12
    if mesh is RING:
        assert np.ptp(radius(layer)) > 0.8 * np.ptp(radius(RING[0]))


def test_a_clean_pose_and_parts_that_do_not_meet_keep_every_bit() -> None:
    scene = scene_of(SLEEVE)
    clean = np.concatenate([ARM[0], SLEEVE[0]])
    deep = np.concatenate([swollen(ARM[0], 0.4), SLEEVE[0]])
    assert (lifted(scene, clean)[0] == clean).all()
    nothing = np.zeros((0, 2), dtype=np.int32)
    assert (lifted(scene, deep, meet=nothing)[0] == deep).all()


@pytest.mark.parametrize(
    "choices",
    [
        {"rigid": True},
        {"pin": np.ones(len(SLEEVE[0]))},
        {"diffusion": 999.0},
        {"direction": np.tile([0.0, 0.0, 1.0], (len(SLEEVE[0]), 1))},
    ],
    ids=["rigid", "pinned", "stiff", "directed"],
)
def test_what_may_not_move_freely_stays(choices: dict[str, object]) -> None:
    deep = np.concatenate([swollen(ARM[0], 0.4), SLEEVE[0]])
    assert (lifted(scene_of(SLEEVE, **choices), deep)[0] == deep).all()


def test_nothing_is_lifted_where_displacements_are_limited() -> None:
    options = RepairOptions(maximum_displacement=0.01)
    scene = make_scene([Body(*ARM), Body(*SLEEVE)], options)
    deep = np.concatenate([swollen(ARM[0], 0.4), SLEEVE[0]])
    assert (lifted(scene, deep)[0] == deep).all()


@pytest.mark.parametrize("choices", [{"maximum_displacement": 0.5}, {"method": "paper"}])
def test_what_is_not_lifted_is_led_out_as_before(choices: dict[str, Any]) -> None:
    enclosed = BOTH[:, ::-1]
    lifts, leads = (
        make_scene([Body(*ARM), Body(*SLEEVE)], options)
        for options in (RepairOptions(), RepairOptions(**choices))
    )
    assert len(not_worn(lifts, enclosed)) == 0
    assert not_worn(leads, enclosed).tolist() == enclosed.tolist()


def test_fixed_vertices_of_a_layer_stay() -> None:
    pin = (SLEEVE[0][:, 2] > 0.3).astype(float)
    deep = np.concatenate([swollen(ARM[0], 0.4), SLEEVE[0]])
    layer = lifted(scene_of(SLEEVE, pin=pin), deep)[0][len(ARM[0]) :]
    assert (layer[pin == 1.0] == SLEEVE[0][pin == 1.0]).all()
    assert (layer != SLEEVE[0]).any()


def test_lifts_come_and_go_smoothly() -> None:
    growth = np.concatenate([np.zeros(6), [0.4], np.zeros(6)])
    poses = [np.concatenate([swollen(ARM[0], g), SLEEVE[0]]) for g in growth]
    moved = lifted(scene_of(SLEEVE), *poses)[:, len(ARM[0]) :] - SLEEVE[0]
    largest = np.linalg.norm(moved, axis=2).max(axis=1)
    assert largest.argmax() == 6 and 0.0 < largest[3] < largest[5] < largest[6]
    steps = np.abs(np.diff(largest))
    assert steps.max() < 0.5 * largest.max()


@pytest.mark.parametrize(("halves", "gone"), [(True, 1.0 - 0.5**4), (False, 2.0)])
def test_narrow_lifts_follow_only_where_less_is_left(
    halves: bool, gone: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is needed halves with each lift, or stays the same however often it is lifted."""
    start = np.concatenate([swollen(ARM[0], 0.4), SLEEVE[0]])
    along = np.array([0.0, 0.0, 1.0])

    def needed(
        lift: LayerLift, pose: FloatArray, wide: NDArray[np.bool_], sunken: Sunken | None = None
    ) -> FloatArray:
        lifted_by = pose[lift.own] - start[lift.own]
        return 0.5 * (along - lifted_by) if halves else np.broadcast_to(along, lifted_by.shape)

    monkeypatch.setattr(LayerLift, "__call__", needed)
    poses, scene, options = np.stack([start] * 7), scene_of(SLEEVE), LiftOptions(left=1e9)
    found = lifted_frames(scene, poses, [BOTH] * 7, np.arange(7.0), options=options)
    moved = found[:, len(ARM[0]) :, 2] - SLEEVE[0][:, 2]
    assert np.allclose(moved, gone, atol=1e-9)


def test_what_is_known_to_be_under_need_not_be_found_again() -> None:
    pose, scene = np.concatenate([swollen(ARM[0], 0.4), SLEEVE[0]]), scene_of(SLEEVE)
    layer = scene.layers.between(0, 1)
    assert layer is not None
    lift = LayerLift(scene, layer, LiftOptions())
    sunken = lift.sunken(lift.inner(pose))
    shift = lift(pose, sunken.under)
    assert shift.any() and np.array_equal(lift(pose, sunken.under, sunken), shift)
    nothing = sunken._replace(under=np.zeros_like(sunken.under))
    assert not lift(pose, sunken.under, nothing).any()


def test_a_few_vertices_are_not_led_far_unless_more_go_there_in_another_frame() -> None:
    # One vertex of the sleeve is at the axis of the arm, as in the crease of an armpit.
    sleeve = SLEEVE[0].copy()
    middle = int(np.argmin(np.abs(sleeve[:, 2]) - sleeve[:, 0]))
    sleeve[middle, :2] *= 0.05
    creased = np.concatenate([ARM[0], sleeve])
    scene = scene_of(SLEEVE)
    assert (lifted(scene, creased)[0] == creased).all()
    through = np.concatenate([swollen(ARM[0], 0.4), sleeve])
    both = lifted(scene, through, creased)
    moved = np.linalg.norm(both[1] - creased, axis=1)[len(ARM[0]) :]
    assert moved[middle] > 0.1
    # However few they are, if the way may be as long.
    options = LiftOptions(wide=10.0, left=10.0)
    led = lifted_frames(scene, creased[None], [BOTH], np.zeros(1), options=options)[0]
    assert np.linalg.norm(led - creased, axis=1)[len(ARM[0]) + middle] > 0.05


def test_a_leg_that_comes_out_through_a_cape_does_not_raise_it() -> None:
    (leg, of_leg), bend, curved = tube(24, 80, 0.2, 4.0), np.radians(60.0), 0.8
    x, z = (axis.ravel() for axis in np.mgrid[-0.6:0.6:25j, -1.8:0.8:53j])
    cape = np.stack([x, np.full(len(x), -0.27), z], axis=1)
    first = (53 * np.arange(24)[:, None] + np.arange(52)).ravel()
    quads = first[:, None] + [0, 53, 54, 1]
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    # Below the hip the leg turns backwards, along a circle and then straight on.
    below = np.maximum(-0.2 - leg[:, 2], 0.0)
    turned, on = np.minimum(below, curved) * bend / curved, np.maximum(below - curved, 0.0)
    round_by = curved / bend
    pose = leg.copy()
    pose[:, 1] = leg[:, 1] * np.cos(turned) - round_by * (1 - np.cos(turned)) - on * np.sin(turned)
    pose[:, 2] = np.where(below > 0.0, -0.2, leg[:, 2]) - leg[:, 1] * np.sin(turned)
    pose[:, 2] -= round_by * np.sin(turned) + on * np.cos(turned)
    scene = make_scene([Body(leg, of_leg), Body(cape, faces)], RepairOptions())
    through = np.concatenate([pose, cape])
    assert (lifted(scene, through)[0] == through).all()
    # It would be raised by more than twice the leg's radius, and the leg still be through.
    options = LiftOptions(left=10.0)
    led = lifted_frames(scene, through[None], [BOTH], np.zeros(1), options=options)[0]
    assert np.linalg.norm(led - through, axis=1).max() > 0.4
    assert len(scene.pairs(led, scene.weld(led)))


def test_before_and_after_all_contacts_nothing_is_under() -> None:
    scene, none = scene_of(SLEEVE), np.zeros((0, 2), dtype=np.int32)
    pose = np.concatenate([swollen(ARM[0], 0.4), SLEEVE[0]])
    poses, frames = np.stack([pose] * 5), np.arange(5.0)
    options = LiftOptions(widths=(0.0,))
    met = [none, BOTH, none, BOTH, none]
    moved = lifted_frames(scene, poses, met, frames, options=options) != poses
    # Between two contacts a limb may be all through.
    assert moved.any(axis=(1, 2)).tolist() == [False, True, True, True, False]


def test_an_outer_layer_follows_the_inner_one() -> None:
    coat = tube(24, 12, 0.26, 1.0)
    arm = swollen(ARM[0], 0.5)
    before = np.concatenate([arm, SLEEVE[0], coat[0]])
    meet = np.array([[0, 1], [0, 2], [1, 2]], dtype=np.int32)
    after = lifted(scene_of(SLEEVE, coat), before, meet=meet)[0][len(arm) :]
    count = len(SLEEVE[0])
    middle = np.abs(SLEEVE[0][:, 2]) < 0.1
    sleeve, outer = radius(after[:count])[middle], radius(after[count:])[middle]
    assert (sleeve > 0.28).all() and outer.mean() > sleeve.mean()


@pytest.mark.parametrize("inside_out", [False, True])
def test_a_lining_stays_between_the_coat_and_the_trousers(inside_out: bool) -> None:
    points, faces = icosphere(4)
    leg = points * [0.2, 0.2, 2.0]
    trousers, lining, coat = (tube(24, 20, own, 1.0) for own in (0.23, 0.25, 0.27))
    # Open in front by a third: what goes round something is told by that alone.
    behind = (lining[0][:, 0] < 0.1)[lining[1]].all(axis=1)
    of_lining = lining[1][behind][:, [0, 2, 1]] if inside_out else lining[1][behind]
    meshes = (leg, faces), trousers, (lining[0], of_lining), (coat[0], coat[1][behind])
    scene = make_scene([Body(*mesh) for mesh in meshes], RepairOptions())
    # Both thigh and trousers come out through the coat.
    pose = [swollen(leg, 0.5), swollen(trousers[0], 0.5), lining[0], coat[0]]
    met = np.array([[0, 2], [0, 3], [1, 2], [1, 3]], dtype=np.int32)
    after = np.split(lifted(scene, np.concatenate(pose), meet=met)[0], scene.vertex_starts[1:-1])
    middle = (np.abs(trousers[0][:, 2]) < 0.2) & (trousers[0][:, 0] < 0.0)
    order = [radius(own)[middle] for own in after[1:]]
    assert (order[1] > order[0]).all() and (order[2] > order[0]).all()
    assert order[2].mean() > order[1].mean()


def test_a_layer_that_the_user_numbers_is_lifted_whatever_the_rest_tells() -> None:
    # In the rest the sleeve lies inside the arm.
    inside = SLEEVE[0] * [0.8, 0.8, 1.0]
    deep = np.concatenate([ARM[0], inside])
    plain = scene_of((inside, SLEEVE[1]))
    assert plain.layers.between(0, 1).top == 0  # type: ignore[union-attr]
    told = scene_of((inside, SLEEVE[1]), layer=np.ones(len(SLEEVE[1]), dtype=np.int32))
    after = lifted(told, deep)[0]
    assert (after[: len(ARM[0])] == ARM[0]).all()
    assert (radius(after[len(ARM[0]) :]) > 0.2).all()


def test_parts_of_one_mesh_meet_too() -> None:
    points, faces = joined(ARM, SLEEVE)
    scene = make_scene([Body(points, faces)], RepairOptions())
    pose = np.concatenate([swollen(ARM[0], 0.4), SLEEVE[0]])
    pairs = scene.pairs(pose, scene.weld(pose))
    meet = parts_that_meet(scene, pairs, np.zeros((0, 2), dtype=np.int32))
    assert meet.tolist() == [[0, 1]]
    assert (lifted(scene, pose, meet=meet)[0] != pose).any()


def test_a_swallowed_ring_is_still_worn_and_clean() -> None:
    ball, faces = icosphere(4, 0.2)
    arm = ball * [1.0, 1.0, 10.0]
    bodies = [Body(arm, faces), Body(RING[0], RING[1][:, [0, 2, 1]])]  # the ring is inside out
    results = SceneRepairer(bodies)([swollen(arm, 0.4), RING[0]])
    assert [result.status for result in results] == ["clean", "clean"]
    ring = results[1].points
    assert radius(ring).min() > 0.25 and np.abs(ring[:, 2]).max() < 0.1


def test_a_cape_is_lifted_off_what_came_through_and_stays_on_the_shoulders() -> None:
    trunk, (points, faces) = tube(24, 40, 0.2, 2.4), tube(24, 24, 0.26, 2.0)
    faces = faces[(points[:, 1] <= 1e-9)[faces].all(axis=1)]
    used, number = np.unique(faces, return_inverse=True)
    cape = points[used]
    cape[:, :2] *= np.where(cape[:, 2:] > 0.85, 0.6, 1.0)
    rest = np.concatenate([trunk[0], cape])
    sheet = cape, number.reshape(-1, 3).astype(np.int32)
    pairs = Detector(rest, joined(trunk, sheet)[1])(rest)
    reference = Reference(rest, pairs)
    bodies = [Body(*trunk), Body(*sheet)]
    scene = make_scene(bodies, RepairOptions(rest_contacts="auto"), (), [reference])
    # A bump of the trunk comes through the cape behind its middle.
    bump = np.exp(-(((trunk[0] - [0.0, -0.2, -0.5]) / 0.25) ** 2).sum(axis=1))
    before = np.concatenate([trunk[0] + 0.08 * bump[:, None] * [0.0, -1.0, 0.0], cape])
    assert len(scene.pairs(before, scene.rest_weld))
    after = lifted(scene, before)[0]
    assert len(scene.pairs(after, scene.rest_weld)) == 0
    assert (after[: len(trunk[0])] == before[: len(trunk[0])]).all()
    moved = np.linalg.norm(after - before, axis=1)[len(trunk[0]) :]
    assert moved[cape[:, 2] > 0.85].max() < 1e-6 < moved.max()
