from __future__ import annotations

import numpy as np
import pytest

from blender.dtrepair_addon.host.runs import moved, parse_frames, run_name, runs, weight_keys


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
