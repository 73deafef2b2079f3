"""What is in front of a layer hangs outside of it; what is beneath, beside or close does not."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.worn.beside import in_front
from tests.meshes import tube

RADIUS, SPACING = 0.25, 0.05
POINTS, FACES = tube(24, 16, radius=RADIUS, length=0.6)
OUTWARD = POINTS * [1.0, 1.0, 0.0] / RADIUS
MIDDLE = POINTS[:, 2].mean()


@pytest.mark.parametrize(
    ("point", "outside"),
    [
        ((0.35, 0.0, MIDDLE), True),  # a hand beside it
        ((0.2, 0.0, MIDDLE), False),  # the limb within
        ((RADIUS + 0.5 * SPACING, 0.0, MIDDLE), False),  # closer than the mesh tells
        ((0.26, 0.0, MIDDLE + 0.6), False),  # beyond its rim: of that it tells nothing
        ((0.37, 0.0, POINTS[:, 2].max() + 0.1), False),  # beyond and beside, at 40 degrees
    ],
)
def test_what_lies_outside_of_a_tube(point: tuple[float, float, float], outside: bool) -> None:
    spacing = np.full(len(POINTS), SPACING)
    assert in_front(np.array([point]), POINTS, OUTWARD, spacing).tolist() == [outside]


def test_without_points_or_a_layer_nothing_is_outside() -> None:
    none, spacing = np.zeros((0, 3)), np.full(len(POINTS), SPACING)
    assert in_front(none, POINTS, OUTWARD, spacing).shape == (0,)
    assert not in_front(POINTS, none, none, np.zeros(0)).any()
