"""Small parts go along with what they are attached to, unless that brings something back."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.relief.relief import relieved_poses
from dtrepair.repair.relief.small_parts import SmallPartOptions, SmallParts
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from tests.meshes import icosphere, joined

SHELL, RIVET, PIN = icosphere(4), icosphere(2, 0.05), icosphere(2, 0.02)
AT, ON = np.array([1.0, 0.0, 0.0]), np.array([1.06, 0.0, 0.0])
COUNT, SMALL = len(SHELL[0]), len(RIVET[0])
RIVETS = slice(COUNT, COUNT + SMALL)
PINS = slice(COUNT + SMALL, COUNT + SMALL + len(PIN[0]))


def riveted(beside: FloatArray | None = None, **choices: object) -> tuple[Scene, OpenedPose]:
    """A ball, a rivet in its surface and a pin on that; something else may be beside the rivet."""
    places = [SHELL[0], RIVET[0] + AT, PIN[0] + ON]
    points, faces = joined(*zip(places, (SHELL[1], RIVET[1], PIN[1]), strict=True))
    away = PIN[0] + [3.0, 0.0, 0.0]
    rest = np.concatenate([points, away])
    reference = Reference(rest, Detector(points, faces)(points))
    bodies = [Body(points, faces, **choices), Body(away, PIN[1])]  # type: ignore[arg-type]
    scene = make_scene(bodies, RepairOptions(rest_contacts="auto"), (), [reference])
    pose = [points, away if beside is None else PIN[0] + beside]
    return scene, detected(scene, gathered(scene, pose))


def with_small_parts(
    scene: Scene, pose: OpenedPose, points: FloatArray, **values: float
) -> FloatArray:
    options = SmallPartOptions(**values)  # type: ignore[arg-type]
    return SmallParts(scene, options=options)(pose, points)


def off(pose: OpenedPose, points: FloatArray, own: slice) -> float:
    """How far something is from where the shell, which turned and went on, would have it."""
    return float(lengths(points[own] - moved(pose)[own]).max())


def moved(pose: OpenedPose) -> FloatArray:
    """All of a pose turned and led on, as one."""
    c, s = np.cos(0.2), np.sin(0.2)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    result: FloatArray = pose.centred @ turn + [0.1, 0.0, 0.0]
    return result


def test_a_rivet_and_the_pin_on_it_follow_their_shell() -> None:
    scene, pose = riveted()
    found = moved(pose)
    found[RIVETS] += [0.0, 0.0, 0.03]
    found[PINS] = pose.centred[PINS]
    led = with_small_parts(scene, pose, found)
    assert off(pose, led, RIVETS) < 2e-3 and off(pose, led, PINS) < 2e-3
    assert (led[:COUNT] == found[:COUNT]).all()


def test_what_is_nearly_there_or_did_not_move_keeps_every_bit() -> None:
    scene, pose = riveted()
    assert with_small_parts(scene, pose, pose.centred) is pose.centred
    found = moved(pose)
    found[COUNT : PINS.stop] += [0.0, 0.0, 0.005]
    assert with_small_parts(scene, pose, found) is found
    found[COUNT : PINS.stop] += [0.0, 0.0, 0.025]
    assert with_small_parts(scene, pose, found, off=1.0) is found
    assert with_small_parts(scene, pose, found, small=0.01) is found


def test_what_would_meet_something_stays_and_the_rest_is_led_back() -> None:
    # The rivet was led off by what is beside it; the pin on it has no reason to be off.
    scene, pose = riveted(beside=np.array([1.045, 0.0, 0.045]))
    assert len(pose.pairs)
    found = pose.centred.copy()
    found[RIVETS] -= [0.0, 0.0, 0.03]
    assert not len(scene.pairs(found, pose.weld))
    for pins in (0.0, 0.045):
        apart = found.copy()
        apart[PINS] -= [0.0, 0.0, pins]
        led = with_small_parts(scene, pose, apart)
        assert (led[RIVETS] == found[RIVETS]).all()
        assert np.allclose(led[PINS], pose.centred[PINS] - [0.0, 0.0, 0.03], atol=2e-3)


ALL = COUNT + SMALL + len(PIN[0])


@pytest.mark.parametrize(
    "choices",
    [
        {"pin": (np.arange(ALL) >= COUNT).astype(float)},
        {"rigid": True},
        {"diffusion": 999.0},
        {"direction": np.tile([0.0, 0.0, 1.0], (ALL, 1))},
    ],
    ids=["fixed", "rigid", "stiff", "directed"],
)
def test_what_may_not_move_freely_stays(choices: dict[str, Any]) -> None:
    scene, pose = riveted(**choices)
    found = moved(pose)
    found[RIVETS] = pose.centred[RIVETS]
    assert (with_small_parts(scene, pose, found)[RIVETS] == pose.centred[RIVETS]).all()


@pytest.mark.parametrize("smaller", [0.8, 0.1])
def test_what_is_nearly_as_large_as_its_host_follows_nothing(smaller: float) -> None:
    scene, pose = riveted()
    found = pose.centred.copy()
    found[PINS] += [0.0, 0.0, 0.02]
    led = with_small_parts(scene, pose, found, smaller=smaller)
    assert (led is found) == (smaller == 0.1)


def test_a_pin_follows_its_rivet_where_both_cannot_go_at_once() -> None:
    # Something is where the pin belongs, once the rivet is back.
    scene, pose = riveted(beside=ON + np.array([0.02, 0.0, 0.03]))
    found = pose.centred.copy()
    found[COUNT : PINS.stop] -= [0.0, 0.0, 0.015]
    assert not len(scene.pairs(found, pose.weld)) and len(pose.pairs)
    led = with_small_parts(scene, pose, found)
    assert np.allclose(led[RIVETS], pose.centred[RIVETS], atol=2e-3)
    assert (led[PINS] == found[PINS]).all()


def test_what_is_hidden_in_a_point_stays() -> None:
    scene, pose = riveted()
    points = pose.centred.copy()
    points[RIVETS] = points[RIVETS].mean(axis=0)
    hidden = detected(scene, gathered(scene, [points[: PINS.stop], points[PINS.stop :]]))
    found = moved(hidden)
    found[RIVETS] = hidden.centred[RIVETS]
    led = with_small_parts(scene, hidden, found)
    assert (led[RIVETS] == found[RIVETS]).all()


def test_poses_that_are_relieved_have_their_small_parts_led_back() -> None:
    scene, pose = riveted()
    mesh = WeldedMeshes(scene)([pose.weld])
    found = moved(pose)
    found[RIVETS] += [0.0, 0.0, 0.03]
    found[PINS] += [0.0, 0.0, 0.03]
    (led,) = relieved_poses(scene, mesh, [pose], [found])
    assert off(pose, led, RIVETS) < 2e-3


def test_nothing_moves_farther_than_what_was_found() -> None:
    scene, pose = riveted()
    found = pose.centred.copy()
    # The shell swings about, and would take the rivet along farther than anything went.
    found[:COUNT] = moved(pose)[:COUNT]
    farthest = lengths(found - pose.centred).max()
    led = with_small_parts(scene, pose, found)
    assert lengths(led - pose.centred).max() <= farthest * (1.0 + 1e-6)
