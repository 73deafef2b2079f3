"""Smoothing in time."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.temporal import (
    apply_in_time,
    easing_weights,
    gaussian_kernel,
    runs_of,
    standing_out,
    steady_weights,
    steps_between,
    undamped,
)


def test_small_products_make_the_whole_one() -> None:
    kernel = gaussian_kernel(np.arange(60.0), 3.5)
    field = np.random.default_rng(0).normal(size=(60, 700, 3))
    expected = np.einsum("ts,svk->tvk", kernel, field)
    assert np.abs(apply_in_time(kernel, field) - expected).max() < 1e-13
    assert apply_in_time(kernel[:, :2], field[:2]).shape == field.shape
    assert apply_in_time(np.ones((2, 3)), np.zeros((3, 0, 3))).shape == (2, 0, 3)


def test_a_lone_frame_keeps_its_length() -> None:
    kernel = gaussian_kernel(np.arange(30.0), 3.5)
    field = np.zeros((30, 5, 3))
    field[12, 1] = [0.3, -0.4, 0.0]
    smooth = undamped(kernel, field)
    assert np.allclose(smooth[12, 1], field[12, 1], atol=1e-15)
    assert (smooth[:, [0, 2, 3, 4]] == 0).all()
    assert (smooth[23:] == 0).all() and np.linalg.norm(smooth[15, 1]) > 0.1
    assert (undamped(kernel, np.zeros((30, 5, 3))) == 0).all()


def test_runs_are_of_consecutive_frames() -> None:
    chosen = np.array([True, True, False, True, False, False, True])
    assert runs_of(chosen) == [slice(0, 2), slice(3, 4), slice(6, 7)]
    assert runs_of(chosen[2:3]) == runs_of(chosen[:0]) == []
    assert runs_of(chosen, apart=2) == [slice(0, 4), slice(6, 7)]
    assert runs_of(chosen, apart=3) == [slice(0, 7)]
    assert runs_of(chosen[:1], apart=4) == [slice(0, 1)]
    assert runs_of(chosen[2:3], apart=4) == runs_of(chosen[:0], apart=4) == []


def test_needless_ends_ease_and_do_not_swing_to_the_other_side() -> None:
    frames = np.array([0.0, 1.0, 2.0, 4.0, 5.0])
    needless = np.array([True, True, False, False, False])
    weights, steady = easing_weights(frames, needless), steady_weights(frames)
    np.testing.assert_array_equal(weights[1:], steady[1:])
    assert weights[0].tolist() == [0.0, 0.5, 0.0, 0.0, 0.0]
    assert easing_weights(frames, ~needless)[4].tolist() == [0.0, 0.0, 0.0, 0.5, 0.0]
    np.testing.assert_array_equal(easing_weights(frames[:1], needless[:1]), [[0.0]])
    for own, swings in ((weights, False), (steady, True)):
        values = np.array([0.0, 0.0, 0.0, 1.0, 1.2])
        for _ in range(20):
            values[:3] = 0.5 * (values + own @ values)[:3]
        assert (values[0] < -0.05) == swings


def test_ends_that_are_level_do_not_swing_on() -> None:
    frames, needless = np.arange(5.0), np.array([False, False, False, False, True])
    weights = easing_weights(frames, needless, level=True)
    assert weights[0].tolist() == [0.0, 1.0, 0.0, 0.0, 0.0]
    assert weights[4].tolist() == [0.0, 0.0, 0.0, 0.5, 0.0]
    np.testing.assert_array_equal(weights[1:4], steady_weights(frames)[1:4])
    grown = np.array([0.0, 0.1, 0.4, 1.0, 1.0])
    assert weights[0] @ grown > 0.0 > easing_weights(frames, needless)[0] @ grown


def test_what_stands_out_is_a_part_or_a_limb_of_a_large_one() -> None:
    part_of = np.repeat([0, 1, -1], [4, 2, 1])
    moved = [np.zeros((7, 3)) for _ in range(4)]
    moved[1][:, 0] = [3.0, 0.0, 0.0, 0.0, 1.0, 1.0, 9.0]
    # Evenly coming and going does not stand out.
    assert standing_out(moved, part_of, limb=9).tolist() == [0.0, 1.5, 0.0, 0.0]
    assert standing_out(moved, part_of, limb=1).tolist() == [0.0, 3.0, 0.0, 0.0]
    assert steps_between(moved, part_of, limb=9).tolist() == [1.5, 1.5, 0.0]
    assert steps_between(moved, part_of, limb=1).tolist() == [3.0, 3.0, 0.0]
    ramp = [moved[1] * k for k in range(4)]
    assert steps_between(ramp, part_of, limb=1).tolist() == [3.0, 3.0, 3.0]
    assert not standing_out(ramp, part_of, limb=1).any()
    moved[1][:4] = 0.0
    assert standing_out(moved, part_of, limb=9).tolist() == [0.0, 1.0, 0.0, 0.0]
