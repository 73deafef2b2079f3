"""Lengths are measured by what moves, and not by the set around or the space between."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray, IntArray, diagonal, extent
from dtrepair.numerics.scale import WHOLE, Scale, boxes_of, scale_of, sets_among

CUBE = np.array(list(np.ndindex(2, 2, 2)), dtype=float)


def bodies(*places: Sequence[float]) -> tuple[FloatArray, IntArray]:
    """Cubes with a side and a place along x each: their points, and where each starts."""
    points = [side * CUBE + [x, 0.0, 0.0] for side, x in places]
    return np.concatenate(points), np.arange(0, 8 * len(points) + 1, 8, dtype=np.int32)


def extent_of(*places: Sequence[float], still: Sequence[int] = ()) -> float:
    points, starts = bodies(*places)
    return scale_of(points, starts, np.isin(range(len(places)), still)).extent(points)


def test_one_body_or_a_scene_that_stands_still_is_measured_whole() -> None:
    points, starts = bodies((1.0, 0.0))
    assert scale_of(points, starts, np.array([False])) is WHOLE
    points, starts = bodies((1.0, 0.0), (100.0, 0.0))
    assert scale_of(points, starts, np.array([True, True])) is WHOLE
    assert WHOLE.extent(points) == extent(points) and WHOLE.diagonal(points) == diagonal(points)


def test_what_lies_apart_is_measured_each_for_itself() -> None:
    assert extent_of((1.0, 0.0), (1.0, 2.0)) == 3.0
    assert extent_of((1.0, 0.0), (1.0, 2.01)) == 1.0
    assert extent_of((1.0, 0.0), (2.0, 2.9)) == pytest.approx(4.9)  # the larger one's extent counts
    assert extent_of((1.0, 0.0), (2.0, 3.1)) == 2.0
    # Two that are near each other are one, to which a third may be near.
    assert extent_of((1.0, 0.0), (1.0, 2.0), (1.0, 5.9)) == pytest.approx(6.9)


def test_a_set_does_not_count() -> None:
    assert extent_of((1.0, 0.0), (4.0, 0.0), still=[1]) == 4.0
    assert extent_of((1.0, 0.0), (4.01, 0.0), still=[1]) == 1.0
    assert extent_of((1.0, 0.0), (40.0, 0.0)) == 40.0  # it moves
    assert extent_of((1.0, 0.0), (40.0, 0.0), (1.0, 20.0), still=[1]) == 1.0


def test_sets_are_still_and_large() -> None:
    points, starts = bodies((1.0, 0.0), (4.01, 0.0), (9.0, 0.0), (1.0, 0.0))
    found = sets_among(boxes_of(points, starts), np.array([False, True, True, True]), 4.0)
    assert found.tolist() == [False, True, True, False]
    assert not sets_among(boxes_of(points, starts), np.ones(4, dtype=bool), 4.0).any()


@pytest.mark.parametrize(("beside", "expected"), [(1.1, True), (0.6, False)])
def test_two_that_move_are_one_only_where_they_overlap(beside: float, expected: bool) -> None:
    points, starts = bodies((1.0, 0.0), (1.0, beside), (4.2, 0.0))
    found = sets_among(boxes_of(points, starts), np.array([False, False, True]), 4.0)
    assert found.tolist() == [False, False, expected]


def test_the_largest_group_of_a_pose_counts() -> None:
    points, starts = bodies((1.0, 0.0), (3.0, 50.0), (99.0, 0.0))
    scale = scale_of(points, starts, np.array([False, False, True]))
    assert [group.tolist() for group in scale.groups] == [list(range(8)), list(range(8, 16))]
    assert scale.counted(24).tolist() == [True] * 16 + [False] * 8
    assert WHOLE.counted(2).all()
    assert scale.diagonal(points) == pytest.approx(3.0 * np.sqrt(3.0))
    points[:8] *= 7.0
    assert scale.extent(points) == 7.0


def test_some_of_the_vertices_are_measured_like_all() -> None:
    scale = Scale((np.array([0, 1, 2], np.int32), np.array([4, 5], np.int32)))
    kept = np.array([1, 2, 3, 5])
    assert [group.tolist() for group in scale.among(kept).groups] == [[0, 1], [3]]
    assert scale.among(np.array([3])) == WHOLE


def test_boxes_hold_their_bodies() -> None:
    points, starts = bodies((1.0, 0.0), (2.0, 5.0))
    assert boxes_of(points, starts).tolist() == [[[0, 0, 0], [1, 1, 1]], [[5, 0, 0], [7, 2, 2]]]
