"""Advice speaks of what was chosen: limits, pins, rests, what is rigid or held."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair import Body, RepairOptions
from dtrepair.diagnosis import Advice, advice_words
from dtrepair.numerics.attachments import Reference
from dtrepair.repair.scene.diagnosis import advice_for, contacts_left, deformation_of
from dtrepair.repair.scene.make_scene import make_scene
from tests.meshes import icosphere, joined

BALL, FACES = icosphere(1)
NEAR, AWAY = np.array([0.7, 0.0, 0.0]), np.array([3.0, 0.0, 0.0])
BOTH = "raise the effort, or raise the diffusion"
HELD = "what is rigid cannot be resolved within itself"
TWO_APART, TWO_FACES = joined((BALL, FACES), (BALL + AWAY, FACES))
TWO_CROSSING = joined((BALL, FACES), (BALL + NEAR, FACES))[0]


def left(
    rest: NDArray[np.float64] = TWO_APART, *, options: RepairOptions | None = None, **given: Any
) -> tuple[str, str]:
    """What is said of a body of two balls that cross: what is left, and the advice."""
    scene = make_scene([Body(rest, TWO_FACES, **given)], options or RepairOptions())
    pairs = scene.detector(TWO_CROSSING)
    assert len(pairs)
    (contact,) = contacts_left(scene, pairs)
    assert contact.pairs == len(pairs)
    return str(contact), advice_words(advice_for(scene, pairs))


def test_a_free_body_has_the_effort_and_the_diffusion() -> None:
    assert left()[1] == BOTH
    assert left(pin=np.zeros(len(TWO_APART)))[1] == BOTH


@pytest.mark.parametrize(
    ("chosen", "text"),
    [
        (
            {"maximum_displacement": 0.1},
            "raise maximum_displacement, or raise the effort, or raise the diffusion",
        ),
        ({"method": "paper"}, "take the method full, or raise the diffusion"),
        ({"effort": 0.5}, BOTH),
        ({"effort": 1.2}, "ease the pose where it is deepest, or raise the diffusion"),
    ],
)
def test_what_was_chosen_comes_first(chosen: dict[str, Any], text: str) -> None:
    assert left(options=RepairOptions(**chosen))[1] == text


def test_parts_that_hold_each_other_have_no_diffusion() -> None:
    """Measured on clips that kept contacts: a wider push left more of them as often as fewer."""
    both = [Body(TWO_APART, TWO_FACES), Body(BALL + 2 * AWAY, FACES)]
    for attached in (True, False):
        scene = make_scene(both, RepairOptions())
        points = np.concatenate([TWO_CROSSING, BALL + 2 * AWAY])
        if attached:
            known = Reference(points, scene.detector(points))
            scene = make_scene(both, RepairOptions(), references=[known])
        pairs = scene.detector(np.concatenate([TWO_APART, BALL + np.array([0.0, 0.7, 0.0])]))
        assert len(pairs) and (scene.attachments is not None) == attached
        words = advice_words(advice_for(scene, pairs))
        assert words == ("raise the effort" if attached else BOTH)


def test_pins_and_rests_are_named_where_they_matter() -> None:
    pin = np.zeros(len(TWO_APART))
    pin[0] = 0.5
    assert left(pin=pin)[1] == f"{BOTH}, or free pinned vertices"
    assert left(TWO_CROSSING)[1] == (f"{BOTH}, or give a rest pose that does not intersect itself")


def test_what_is_held_has_no_cure() -> None:
    found, advice = left(rigid=True)
    assert "the mesh, which is rigid, still intersects itself" in found and advice == HELD
    found, advice = left(mobility=0.0)
    assert "all of them where nothing may move" in found
    assert advice == "where nothing may move, nothing can be resolved"


def test_some_that_are_held_leave_cures_for_the_others() -> None:
    bodies = [Body(TWO_APART, TWO_FACES, rigid=True), Body(BALL + 2 * AWAY, FACES)]
    scene = make_scene(bodies, RepairOptions())
    pairs = scene.detector(np.concatenate([TWO_CROSSING, BALL + np.array([0.0, 0.7, 0.0])]))
    advice = advice_for(scene, pairs)
    assert advice == (Advice.RAISE_EFFORT, Advice.RAISE_DIFFUSION, Advice.RIGID)
    assert advice_words(advice) == f"{BOTH}; {HELD}"
    first, second = contacts_left(scene, pairs)
    assert {(first.first, first.second), (second.first, second.second)} == {
        ("body 0", "body 0"),
        ("body 0", "body 1"),
    }
    assert first.pairs >= second.pairs > 0 and first.rigid != second.rigid


def test_what_is_much_deformed_is_told() -> None:
    flat, fine = BALL * (1.0, 1.0, 0.4), BALL * (1.0, 1.0, 0.97)
    bodies = [Body(BALL, FACES), Body(BALL + AWAY, FACES, name="pea")]
    scene = make_scene(bodies, RepairOptions())
    assert deformation_of(scene, 0, BALL, BALL) is deformation_of(scene, 0, BALL, fine) is None
    told = str(deformation_of(scene, 1, BALL + AWAY, flat + AWAY))
    assert told.startswith("pea is much deformed (lengths by a factor of 1.")
    assert "volume to 40%)" in told
    # Turned and moved nothing is deformed.
    assert deformation_of(scene, 0, BALL, BALL[:, [1, 2, 0]] + AWAY) is None
    # Thinner by an eighth: the edges hardly change.
    thinner = deformation_of(scene, 0, BALL, BALL * (1.0, 1.0, 0.87))
    assert thinner is not None and thinner.volume == pytest.approx(0.87)


def test_an_open_surface_has_no_volume_to_lose() -> None:
    half = FACES[BALL[FACES].mean(axis=1)[:, 2] > 0.0]
    scene = make_scene([Body(BALL, half)], RepairOptions())
    assert deformation_of(scene, 0, BALL, BALL * (1.0, 1.0, 0.87)) is None
    larger = deformation_of(scene, 0, BALL, 2.0 * BALL)
    assert larger is not None and larger.volume is None
    assert larger.lengths == pytest.approx(2.0)
    assert "(lengths by a factor of 2.00)" in str(larger)
