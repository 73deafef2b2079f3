"""Jumps: a frame that stands out is told, corrections that come and go are not."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.numerics.geometry import diagonal
from dtrepair.numerics.metrics import JumpMeter, JumpOptions
from dtrepair.numerics.temporal import gaussian_kernel
from dtrepair.repair.clip.push_frames import PushFramesOptions

BEFORE = np.random.default_rng(5).normal(size=(400, 3))
SIZE = diagonal(BEFORE)
AWAY = np.array([0.0, 1.0, 0.0])


def jumps(
    shares: list[float], *, times: list[float] | None = None, moving: float = 1.0
) -> dict[float, float]:
    """Jumps of a clip in which some vertices move by these shares of the size."""
    meter, some = JumpMeter(), np.arange(len(BEFORE)) < moving * len(BEFORE)
    for time, share in zip(times or range(len(shares)), shares, strict=True):
        pose = BEFORE + 0.1 * time
        meter.add(float(time), pose, pose + share * SIZE * AWAY * some[:, None])
    return meter.jumps


def test_a_frame_on_the_other_side_jumps_by_how_far_it_stands_out() -> None:
    found = jumps([0.02, 0.02, -0.03, 0.02, 0.02])
    assert found[2.0] == pytest.approx(0.05)
    # The frames beside it stand out by nothing: between its neighbours is as far from both.
    assert list(found) == [2.0]


def test_a_change_of_sides_for_good_jumps() -> None:
    found = jumps([0.0, 0.004, 0.009, -0.013, -0.01, -0.004])
    assert found == {3.0: pytest.approx(0.018)}
    # One that passes through nothing is none, however fast.
    assert jumps([0.0, 0.004, 0.009, 0.0, -0.01, -0.004]) == {}
    least = 0.5 * JumpOptions().opposed
    assert jumps([0.0, 0.9 * least, -0.9 * least, 0.0]) == {}
    assert list(jumps([0.0, 1.1 * least, -1.1 * least, 0.0])) == [2.0]
    assert jumps([0.01, -0.01], times=[1.0, 1.0]) == {}


def test_a_correction_that_turns_with_its_body_does_not_change_sides() -> None:
    meter = JumpMeter()
    for time in range(12):
        angle = np.radians(30.0 * time)
        way = np.array([0.0, np.cos(angle), np.sin(angle)])
        meter.add(float(time), BEFORE, BEFORE + 0.03 * SIZE * way)
    assert meter.jumps == {}


def test_what_comes_and_goes_is_no_jump() -> None:
    assert jumps([0.0, 0.1, 0.2, 0.3, 0.3, 0.1]) == {}
    kernel = gaussian_kernel(np.arange(31.0), PushFramesOptions().phases[0].width)
    bell = 0.1 * kernel[15] / kernel[15].max()
    assert jumps(bell.tolist()) == {}


def test_a_faint_one_is_none_and_neither_is_that_of_a_few_vertices() -> None:
    least = JumpOptions().farther
    assert jumps([0.0, 0.9 * least, 0.0]) == {}
    assert list(jumps([0.0, 1.1 * least, 0.0])) == [1.0]
    assert jumps([0.0, 0.5, 0.0], moving=0.0025) == {}
    assert list(jumps([0.0, 0.5, 0.0], moving=0.01)) == [1.0]


@pytest.mark.parametrize("first", [0, 200, 390])
def test_a_small_part_that_jumps_on_a_still_body_is_told(first: int) -> None:
    belt = np.arange(len(BEFORE)) // 2 == first // 2
    told, untold = JumpMeter(7 - 2 * belt), JumpMeter()
    for time, share in enumerate([0.0, 0.04, 0.0]):
        after = BEFORE + share * SIZE * AWAY * belt[:, None]
        for meter in (told, untold):
            meter.add(float(time), BEFORE, after)
    # Two vertices of 400 are none of the rest, and all of the belt.
    assert told.jumps == {1.0: pytest.approx(0.04)} and untold.jumps == {}


def test_frames_need_not_be_evenly_spaced() -> None:
    times = [1.0, 2.0, 5.0]
    assert jumps([0.0, 0.1, 0.4], times=times) == {}
    assert list(jumps([0.0, 0.4, 0.1], times=times)) == [2.0]


def test_a_part_that_jumps_does_not_hide_what_another_does_next() -> None:
    half = np.arange(len(BEFORE)) < len(BEFORE) // 2
    meter = JumpMeter(half)
    for time, (one, other) in enumerate([(0.0, 0.02), (0.04, 0.02), (0.0, -0.03), (0.0, -0.03)]):
        after = BEFORE + np.where(half, one, other)[:, None] * SIZE * AWAY
        meter.add(float(time), BEFORE, after)
    assert meter.jumps == {1.0: pytest.approx(0.04), 2.0: pytest.approx(0.04)}


def test_what_begins_anew_is_no_neighbour() -> None:
    meter = JumpMeter()
    for time, share in enumerate([0.02, 0.02, -0.02, -0.02]):
        if time == 2:
            meter.restart()
        meter.add(float(time), BEFORE, BEFORE + share * SIZE * AWAY)
    assert meter.jumps == {}


def test_one_time_twice_is_not_measured() -> None:
    assert jumps([0.0, 0.5, 0.0], times=[1.0, 1.0, 1.0]) == {}
    assert jumps([0.0, 0.5, 0.0], times=[float("nan")] * 3) == {}


def test_a_mesh_without_points_has_none() -> None:
    meter, empty = JumpMeter(), np.zeros((0, 3))
    for time in range(4):
        meter.add(float(time), empty, empty)
    assert meter.jumps == {}


def test_the_figure_does_not_depend_on_the_unit() -> None:
    def of(unit: float) -> NDArray[np.float64]:
        meter = JumpMeter()
        for time, share in enumerate([0.0, 0.04, 0.0]):
            meter.add(float(time), unit * BEFORE, unit * (BEFORE + share * SIZE * AWAY))
        return np.array(list(meter.jumps.values()))

    assert of(1.0) == pytest.approx([0.04]) and of(1000.0) == pytest.approx(of(1.0))
