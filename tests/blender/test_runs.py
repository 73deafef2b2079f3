from __future__ import annotations

import numpy as np
import pytest

from blender.dtrepair_addon.host.runs import (
    few_shapes,
    moved,
    parse_frames,
    run_name,
    runs,
    weight_keys,
)


def test_frames_are_grouped_into_runs() -> None:
    assert runs([5, 3, 4, 9, 4]) == [[3, 4, 5], [9]]
    assert runs([]) == []
    assert [run_name(run) for run in runs([3, 4, 9])] == ["3-4", "9"]


def test_frames_are_read_from_a_text() -> None:
    assert parse_frames("7") == [7]
    assert parse_frames("-2:3x2, 10, 3") == [-2, 0, 2, 3, 10]


@pytest.mark.parametrize("text", ["", "a", "3:1", "1:9x0", "1:2:3", "1,,2"])
def test_other_texts_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match="expected such as"):
        parse_frames(text)


def test_a_shape_is_at_its_weights_in_its_run_and_off_beside_it() -> None:
    keys = weight_keys([4, 5, 6, 7], np.array([0.5, 1.0, 1.0, 1.0]))
    assert keys[0] == (3, 0.0) and keys[-1] == (8, 0.0)
    assert keys[1:-1] == [(4, 0.5), (5, 1.0), (7, 1.0)]
    times, values = np.array(keys).T
    assert np.interp([4, 5, 6, 7], times, values).tolist() == [0.5, 1.0, 1.0, 1.0]


def test_only_vertices_whose_bits_change_move() -> None:
    before = np.zeros((3, 5, 3), np.float32)
    after = before.copy()
    after[1, 2, 0], after[2, 4, 2] = np.nextafter(np.float32(0), np.float32(1)), 1.0
    assert moved(before, after).tolist() == [2, 4]
    assert not len(moved(before, before))


def test_what_comes_and_goes_as_a_whole_is_one_shape() -> None:
    shape = np.random.default_rng(0).normal(size=(6, 3))
    eased = np.array([0.25, 0.5, 1.0, 0.5])
    shapes, weights = few_shapes(eased[:, None, None] * shape, 1e-6)
    assert shapes.shape == (1, 6, 3) and np.allclose(shapes[0], shape)
    assert np.allclose(weights[:, 0], eased)


def test_few_shapes_stay_within_the_tolerance_and_are_fewer_with_a_larger_one() -> None:
    random = np.random.default_rng(1)
    scales = 0.1 ** np.arange(5)
    flat = random.normal(size=(8, 5)) * scales @ random.normal(size=(5, 30))
    offsets = flat.reshape(8, 10, 3)
    numbers = []
    for tolerance in (1e-9, 1e-2, 1e-1):
        shapes, weights = few_shapes(offsets, tolerance)
        left = np.tensordot(weights, shapes, 1) - offsets
        assert np.linalg.norm(left, axis=2).max() <= tolerance
        assert np.allclose(np.abs(weights).max(axis=0), 1.0)
        numbers.append(len(shapes))
    assert numbers[0] > numbers[1] > numbers[2]


def test_vertices_that_hardly_move_are_left_out() -> None:
    offsets = np.ones((3, 1, 1)) * np.array([[1.0, 0, 0], [1e-6, 0, 0]])
    (shape,), _ = few_shapes(offsets, 1e-4)
    assert np.allclose(shape[0], (1.0, 0.0, 0.0)) and not shape[1].any()


def test_without_a_tolerance_each_frame_has_its_own_shape() -> None:
    offsets = np.ones((3, 4, 3))
    shapes, weights = few_shapes(offsets, 0.0)
    assert np.array_equal(shapes, offsets) and np.array_equal(weights, np.eye(3))
