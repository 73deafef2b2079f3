"""What lies close on a body, as a plate of armour, is hardly led off it where it is tangled."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair import Body, RepairOptions
from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.numerics.worn.measure import WornOptions
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.separation.penetration import BodyShape
from dtrepair.repair.separation.worn_pairs import WornPairs
from tests.meshes import icosphere
from tests.repair.separation.test_separation import separated

BODY, FACES = icosphere(3)
FLAT = icosphere(2)[0] * (0.3, 0.12, 0.02)
FACES_2 = icosphere(2)[1]
ABOVE = np.array([0.0, 0.0, 1.06])
FAR = np.array([9.0, 0.0, 0.0])


def fitted(scene: Scene, body: int) -> bool:
    shapes = {own: BodyShape(scene, own) for own in range(len(scene.bodies))}
    return WornPairs(scene, shapes.__getitem__, WornOptions()).fitted(body)


@pytest.mark.parametrize(
    ("points", "host", "expected"),
    [
        (FLAT + ABOVE, {}, True),
        (FLAT + FAR, {}, False),
        # A ball touches it only.
        (icosphere(2, 0.2)[0] + (0.0, 0.0, 1.22), {}, False),
        # A large dish is no plate of it.
        (icosphere(2)[0] * (0.9, 0.9, 0.02) + ABOVE, {}, False),
        # A staff beside it is long enough for much to be near.
        (icosphere(2)[0] * (0.02, 0.02, 1.0) + (1.3, 0.0, 0.0), {}, False),
        (FLAT + ABOVE + 1e6, {}, False),
        (FLAT + ABOVE, {"rigid": True}, False),
        (FLAT + ABOVE, {"mobility": 0.0}, False),
    ],
)
def test_what_lies_close_on_a_far_larger_soft_body_is_fitted(
    points: FloatArray, host: dict[str, float], expected: bool
) -> None:
    bodies = [Body(BODY, FACES, **host), Body(points, FACES_2)]  # type: ignore[arg-type]
    scene = make_scene(bodies, RepairOptions())
    assert fitted(scene, 1) == expected
    assert not fitted(scene, 0)


@pytest.mark.parametrize("close", [True, False])
def test_tangled_plates_stay_on_the_body_they_lie_on(close: bool) -> None:
    """Two plates side by side at rest; one of them turns, and stands across the other."""
    body = BODY if close else BODY + FAR
    rest = [FLAT + ABOVE + (0.0, 0.13 * side, 0.0) for side in (1.0, -1.0)]
    scene = make_scene([Body(body, FACES), *(Body(own, FACES_2) for own in rest)], RepairOptions())
    across = FLAT[:, [0, 2, 1]] * (1.0, -1.0, 1.0) + ABOVE + (0.1, 0.13, 0.0)
    before = np.concatenate([body, rest[0], across])
    found = separated(scene, [body, rest[0], across], tangled=frozenset({(1, 2)}))[0]
    moved, left = lengths(found - before).max(), len(scene.pairs(found, scene.weld(found)))
    if close:
        # It would have to go by .14, and may by less: pushing does what it can.
        assert moved < 0.05
    else:
        assert moved > 0.05 and left < len(scene.pairs(before, scene.weld(before))) / 3


def test_what_is_fitted_is_led_as_far_as_it_may() -> None:
    """Two plates that lie across each other, flat: a little frees them."""
    rest = [FLAT + ABOVE + (0.0, 0.13 * side, 0.0) for side in (1.0, -1.0)]
    scene = make_scene([Body(BODY, FACES), *(Body(own, FACES_2) for own in rest)], RepairOptions())
    turned = FLAT[:, [1, 0, 2]] * (1.0, -1.0, 1.0) + ABOVE + (0.1, 0.1, 0.0)
    before = np.concatenate([BODY, rest[0], turned])
    found = separated(scene, [BODY, rest[0], turned], tangled=frozenset({(1, 2)}))[0]
    moved = float(lengths(found - before).max())
    # They are .02 thick on either side of their middles.
    assert 0.0 < moved <= 2.0 * 0.04 + 0.01 * scene.scale.diagonal(before)
    pairs = len(scene.pairs(before, scene.weld(before)))
    assert len(scene.pairs(found, scene.weld(found))) < pairs
