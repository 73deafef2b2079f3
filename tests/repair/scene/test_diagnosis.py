"""Advice speaks of what was chosen: limits, pins, rests, what is rigid or held."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair import Body, RepairOptions
from dtrepair.repair.scene.diagnosis import contacts_left, cures, deformed
from dtrepair.repair.scene.scene import make_scene
from tests.meshes import icosphere, joined

BALL, FACES = icosphere(1)
NEAR, AWAY = np.array([0.7, 0.0, 0.0]), np.array([3.0, 0.0, 0.0])
HELD = "what is rigid cannot be resolved within itself"
TWO_APART, TWO_FACES = joined((BALL, FACES), (BALL + AWAY, FACES))
TWO_CROSSING = joined((BALL, FACES), (BALL + NEAR, FACES))[0]


def left(
    rest: NDArray[np.float64] = TWO_APART, *, options: RepairOptions | None = None, **given: Any
) -> tuple[str, str]:
    """What is said of a body of two balls that cross: what is left, and the cures."""
    scene = make_scene([Body(rest, TWO_FACES, **given)], options or RepairOptions())
    pairs = scene.detector(TWO_CROSSING)
    assert len(pairs)
    return contacts_left(scene, pairs), cures(scene, pairs)


def test_a_free_body_has_the_diffusion_only() -> None:
    assert left()[1] == "raise the diffusion"
    assert left(pin=np.zeros(len(TWO_APART)))[1] == "raise the diffusion"


@pytest.mark.parametrize(
    ("chosen", "text"),
    [
        ({"maximum_displacement": 0.1}, "raise maximum_displacement, or raise the diffusion"),
        ({"method": "paper"}, "take the method full, or raise the diffusion"),
    ],
)
def test_what_was_chosen_comes_first(chosen: dict[str, Any], text: str) -> None:
    assert left(options=RepairOptions(**chosen))[1] == text


def test_pins_and_rests_are_named_where_they_matter() -> None:
    pin = np.zeros(len(TWO_APART))
    pin[0] = 0.5
    assert left(pin=pin)[1] == "raise the diffusion, or free pinned vertices"
    assert left(TWO_CROSSING)[1] == (
        "raise the diffusion, or give a rest pose that does not intersect itself"
    )


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
    assert cures(scene, pairs) == f"raise the diffusion; {HELD}"


def test_what_is_much_deformed_is_told() -> None:
    flat, fine = BALL * (1.0, 1.0, 0.4), BALL * (1.0, 1.0, 0.97)
    bodies = [Body(BALL, FACES), Body(BALL + AWAY, FACES, name="pea")]
    scene = make_scene(bodies, RepairOptions())
    assert deformed(scene, 0, BALL, BALL) == deformed(scene, 0, BALL, fine) == ""
    told = deformed(scene, 1, BALL + AWAY, flat + AWAY)
    assert told.startswith("pea is clean but much deformed (lengths by a factor of 1.")
    assert "volume to 40%)" in told
    # Turned and moved nothing is deformed.
    assert deformed(scene, 0, BALL, BALL[:, [1, 2, 0]] + AWAY) == ""
    # Thinner by an eighth: the edges hardly change.
    thinner = deformed(scene, 0, BALL, BALL * (1.0, 1.0, 0.87))
    assert "volume to 87%" in thinner


def test_an_open_surface_has_no_volume_to_lose() -> None:
    half = FACES[BALL[FACES].mean(axis=1)[:, 2] > 0.0]
    scene = make_scene([Body(BALL, half)], RepairOptions())
    assert deformed(scene, 0, BALL, BALL * (1.0, 1.0, 0.87)) == ""
    assert "(lengths by a factor of 2.00)" in deformed(scene, 0, BALL, 2.0 * BALL)
