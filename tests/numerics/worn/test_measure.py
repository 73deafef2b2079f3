"""The worn measure: rings round limbs against what lies beside or pierces them."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.worn.measure import Solid, share_around, surrounds, worn_measure
from tests.meshes import Mesh, icosphere, joined, torus, tube

ARM = tube(24, 40, 0.2, 4.0)


def solid(mesh: Mesh, *, closed: bool = True) -> Solid:
    return Solid(mesh[0], mesh[1], closed)


def moved(mesh: Mesh, offset: tuple[float, float, float]) -> Mesh:
    return mesh[0] + offset, mesh[1]


def test_a_bracelet_goes_round_its_arm() -> None:
    found = worn_measure(solid(torus(48, 12, 0.32, 0.06)), solid(ARM))
    assert found.share > 0.9
    assert abs(found.axis[2]) == pytest.approx(1.0, abs=0.05)


def test_an_open_sleeve_goes_round_its_arm_even_where_the_arm_comes_through() -> None:
    sleeve = tube(24, 12, 0.21, 1.0)
    assert worn_measure(solid(sleeve, closed=False), solid(ARM)).share > 0.9
    through = moved(sleeve, (0.08, 0.0, 0.0))
    assert worn_measure(solid(through, closed=False), solid(ARM)).share > 0.7


@pytest.mark.parametrize("offset", [(1.0, 0.0, 0.0), (0.0, 0.0, 5.0)])
def test_a_bracelet_beside_its_arm_is_not_worn(offset: tuple[float, float, float]) -> None:
    assert worn_measure(solid(moved(torus(48, 12, 0.32, 0.06), offset)), solid(ARM)).share < 0.3


def test_a_ball_that_an_arm_pierces_is_not_worn() -> None:
    assert worn_measure(solid(icosphere(3, 0.5)), solid(ARM)).share < 0.3


def test_a_skirt_goes_round_two_legs() -> None:
    legs = joined(moved(ARM, (-0.3, 0.0, 0.0)), moved(ARM, (0.3, 0.0, 0.0)))
    skirt = tube(32, 12, 0.7, 1.0)
    assert worn_measure(solid(skirt, closed=False), solid(legs)).share > 0.9


def test_what_is_taken_off_is_seen_along_the_same_axis() -> None:
    ring, arm = torus(48, 12, 0.32, 0.06), solid(ARM)
    worn = worn_measure(solid(ring), arm)
    off = share_around(solid(moved(ring, (0.9, 0.0, 0.0))), arm, worn.axis)
    assert off < 0.6 * worn.share
    turned = np.roll(np.eye(3), 1, axis=0)
    again = worn_measure(
        Solid(ring[0] @ turned, ring[1], True), Solid(ARM[0] @ turned, ARM[1], True)
    )
    assert again.share == pytest.approx(worn.share, abs=0.1)


@pytest.mark.parametrize("offset", [0.0, 0.15, 0.3, 2.0])
def test_shares_of_no_interest_end_early_and_others_are_the_same(offset: float) -> None:
    ring, arm = solid(moved(torus(48, 12, 0.32, 0.06), (offset, 0.0, 0.0))), solid(ARM)
    whole = worn_measure(ring, arm).share
    for least in (0.3, 0.7):
        found = worn_measure(ring, arm, least=least).share
        assert found == whole if whole >= least else found < least


def test_points_of_other_bodies_make_no_difference() -> None:
    together, faces = joined(torus(48, 12, 0.32, 0.06), ARM, moved(ARM, (9.0, 9.0, 9.0)))
    first = len(torus(48, 12, 0.32, 0.06)[1])
    ring = Solid(together, faces[:first], True)
    arm = Solid(together, faces[first : first + len(ARM[1])], True)
    alone = worn_measure(solid(torus(48, 12, 0.32, 0.06)), solid(ARM))
    assert worn_measure(ring, arm).share == pytest.approx(alone.share, abs=0.02)
    assert len(ring.alone().points) == 48 * 12 and len(ring.alone().faces) == first


# A robe down to z = -1, and one of two shins in it, which ends half way up, or looks out below.
ROBE, SHIN = tube(32, 24, 0.7, 2.0), tube(16, 12, 0.15, 0.8)


@pytest.mark.parametrize("height", [-0.55, -0.9])
def test_a_robe_surrounds_each_of_two_shins(height: float) -> None:
    robe, shin = solid(ROBE, closed=False), solid(moved(SHIN, (0.3, 0.1, height)))
    assert worn_measure(robe, shin).share < 0.7
    found = surrounds(robe, shin)
    assert found.share == 1.0 and abs(found.axis[2]) == pytest.approx(1.0, abs=0.01)
    assert surrounds(robe, shin, least=0.95).share >= 0.95
    # What lies within a solid is not worn by it.
    assert surrounds(solid(ROBE), shin).share < 0.7


@pytest.mark.parametrize("least", [0.0, 0.95])
@pytest.mark.parametrize("offset", [(0.75, 0.0, -0.5), (0.3, 0.1, -1.1), (0.0, 0.0, -2.0)])
def test_what_sticks_out_or_looks_in_is_not_surrounded(
    offset: tuple[float, float, float], least: float
) -> None:
    shin = solid(moved(SHIN, offset))
    assert surrounds(solid(ROBE, closed=False), shin, least=least).share < 0.95
    turned = np.roll(np.eye(3), 1, axis=0)
    way = Solid(ROBE[0] @ turned, ROBE[1], False), Solid(shin.points @ turned, shin.faces, True)
    assert surrounds(*way, least=least).share < 0.95
