"""Small parts go along with what they are attached to, unless that brings something back."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.relief.small_parts import SmallPartOptions, with_small_parts
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.scene import Scene
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
    for options in (SmallPartOptions(off=1.0), SmallPartOptions(small=0.01)):
        assert with_small_parts(scene, pose, found, options=options) is found


def test_what_would_meet_something_stays_and_the_rest_is_led_back() -> None:
    # The rivet was led off by what is beside it; the pin on it has no reason to be off.
    scene, pose = riveted(beside=np.array([1.045, 0.0, 0.045]))
    assert len(pose.pairs)
    found = pose.centred.copy()
    found[RIVETS] -= [0.0, 0.0, 0.03]
    assert not len(scene.pairs(found, pose.weld))
    assert with_small_parts(scene, pose, found) is found
    apart = found.copy()
    apart[PINS] -= [0.0, 0.0, 0.045]
    led = with_small_parts(scene, pose, apart)
    assert (led[RIVETS] == found[RIVETS]).all()
    assert np.allclose(led[PINS], pose.centred[PINS] - [0.0, 0.0, 0.03], atol=2e-3)


def test_what_is_fixed_stays() -> None:
    pin = np.zeros(COUNT + SMALL + len(PIN[0]))
    pin[RIVETS] = 1.0
    scene, pose = riveted(pin=pin)
    found = moved(pose)
    found[RIVETS] = pose.centred[RIVETS]
    assert (with_small_parts(scene, pose, found)[RIVETS] == pose.centred[RIVETS]).all()


@pytest.mark.parametrize("smaller", [0.8, 0.1])
def test_what_is_nearly_as_large_as_its_host_follows_nothing(smaller: float) -> None:
    scene, pose = riveted()
    found = pose.centred.copy()
    found[PINS] += [0.0, 0.0, 0.02]
    led = with_small_parts(scene, pose, found, options=SmallPartOptions(smaller=smaller))
    assert (led is found) == (smaller == 0.1)
