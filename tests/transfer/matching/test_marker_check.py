"""Swapped and misplaced markers are found; good ones are left alone."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.transfer import check_markers
from tests.meshes import Mesh
from tests.quadruped import SOURCE, TARGET, markers

Animals = tuple[Mesh, Mesh, NDArray[np.int32]]


@pytest.fixture(scope="module")
def animals() -> Animals:
    source, target = SOURCE.mesh(), TARGET.mesh()
    return source, target, markers(SOURCE, source[0], TARGET, target[0])


def test_good_markers_raise_no_suspicion(animals: Animals) -> None:
    source, target, rows = animals
    found = check_markers(*source, *target, rows)
    assert found.suspects == () and found.swapped == () and found.warnings == ()
    assert found.distances.shape == (len(rows),)
    assert found.distances.max() < 0.06


@pytest.mark.parametrize(("first", "second"), [(0, 30), (12, 47), (60, 85)])
def test_a_swapped_pair_is_named_and_the_others_stay_good(
    animals: Animals, first: int, second: int
) -> None:
    source, target, rows = animals
    wrong = rows.copy()
    wrong[[first, second], 1] = wrong[[second, first], 1]
    found = check_markers(*source, *target, wrong)
    assert found.suspects == (first, second)
    assert found.swapped == ((first, second),)
    assert found.distances[[first, second]].min() > 0.10
    assert np.delete(found.distances, [first, second]).max() < 0.06
    assert f"swapped with marker {second}?" in found.warnings[0]
    assert f"target vertex {wrong[first, 1]}" in found.warnings[0]


def test_two_swapped_pairs_are_both_named(animals: Animals) -> None:
    source, target, rows = animals
    wrong = rows.copy()
    wrong[[0, 30, 12, 47], 1] = wrong[[30, 0, 47, 12], 1]
    found = check_markers(*source, *target, wrong)
    assert set(found.swapped) == {(0, 30), (12, 47)}


def test_a_misplaced_marker_is_named(animals: Animals) -> None:
    source, target, rows = animals
    wrong = rows.copy()
    free = np.setdiff1d(np.arange(len(target[0])), rows[:, 1])
    far = np.linalg.norm(target[0][free] - target[0][rows[20, 1]], axis=1)
    wrong[20, 1] = free[far.argmax()]
    found = check_markers(*source, *target, wrong)
    assert found.suspects == (20,) and found.swapped == ()
    assert found.distances[20] > 0.3
    assert "marker 20" in found.warnings[0] and "misplaced?" in found.warnings[0]


def test_duplicates_are_refused(animals: Animals) -> None:
    source, target, rows = animals
    with pytest.raises(ValueError, match="should have one marker"):
        check_markers(*source, *target, np.concatenate([rows, rows[:1]]))
