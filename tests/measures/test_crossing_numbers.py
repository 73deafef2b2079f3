"""Lines through, beside, back through and exactly through the edges of loops."""

from __future__ import annotations

import numpy as np
import pytest

from tests.measures.crossing_numbers import crossing_number, crossing_numbers


def circle(count: int = 24, wave: float = 0.0) -> np.ndarray:
    """A unit circle round z, counter-clockwise from above; `wave` lifts it up and down."""
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle), wave * np.cos(3 * angle)], axis=1)


def line(*points: tuple[float, float, float]) -> np.ndarray:
    return np.array(points, dtype=float)


UP = line((0.1, 0.2, -3), (0.1, 0.2, 0.4), (0.3, 0.1, 3))


def test_through_against_and_beside() -> None:
    assert crossing_number(UP, circle()) == 1
    assert crossing_number(UP[::-1], circle()) == -1
    assert crossing_number(UP, circle()[::-1]) == -1
    assert crossing_number(UP + np.array([3.0, 0, 0]), circle()) == 0
    assert crossing_number(UP + np.array([0, 0, 5.0]), circle()) == 0


def test_there_and_back_is_zero_and_twice_round_is_two() -> None:
    back = np.concatenate([UP, [[0.2, -0.3, -3.0]]])
    assert crossing_number(back, circle()) == 0
    outside = line((5, 0, 3), (5, 0, -3), (0.2, -0.3, -3), (0.2, -0.3, 3))
    assert crossing_number(np.concatenate([UP, outside]), circle()) == 2


# Half way from the fan's centre to a corner of a square.
SQUARE = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
ON_EDGE = (0.0113 / 2, (0.0071 - 1) / 2)


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.5, 0.0), (0.0, 0.25), ON_EDGE])
def test_a_line_through_the_centre_or_an_edge_of_the_fan_counts_once(
    place: tuple[float, float],
) -> None:
    x, y = place
    assert crossing_number(line((x, y, -1), (x, y, 1)), SQUARE) == 1
    # The same with a point of the line exactly in the plane.
    assert crossing_number(line((x, y, -1), (x, y, 0), (x, y, 1)), SQUARE) == 1


@pytest.mark.parametrize("wave", [0.3, 2.0])
def test_a_loop_need_not_be_flat(wave: float) -> None:
    far = line((0.05, 0.1, -9), (0.05, 0.1, 9))
    assert crossing_number(far, circle(60, wave)) == 1
    assert crossing_number(far + np.array([2.0, 0, 0]), circle(60, wave)) == 0


def test_turning_everything_changes_nothing() -> None:
    random = np.random.default_rng(1)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    loops = [circle() + np.array(own) for own in ((0, 0, 0), (0, 0, 1.0), (4.0, 0, 0))]
    expected = [[1, -1], [1, -1], [0, 0]]
    cores = [UP, UP[::-1]]
    assert crossing_numbers(cores, loops) == expected
    turned = [[own @ turn + 3.0 for own in group] for group in (cores, loops)]
    assert crossing_numbers(*turned) == expected
