"""Displacements over time as few shapes with weights."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from dtrepair.numerics.low_rank import LowRankOptions, fewest_shapes


def clip(rank: int, frames: int = 12, vertices: int = 40, seed: int = 0) -> NDArray[np.float64]:
    """Displacements (T, M, 3) of so many shapes."""
    random = np.random.default_rng(seed)
    weights = random.standard_normal((frames, rank))
    return np.tensordot(weights, random.standard_normal((rank, vertices, 3)), 1)


def largest_error(found: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(found - expected, axis=2).max(initial=0.0))


@pytest.mark.parametrize("rank", [1, 2, 5])
def test_as_many_shapes_as_there_are(rank: int) -> None:
    moved = clip(rank)
    found = fewest_shapes(moved, 1e-4)
    assert len(found.shapes) == found.weights.shape[1] == found.least == rank
    assert largest_error(found.displacements, moved) <= 1e-4
    np.testing.assert_allclose(np.abs(found.weights).max(axis=0), 1.0)
    assert (found.weights.max(axis=0) == 1.0).all()


@given(st.integers(1, 6), st.floats(0.01, 3.0), st.integers(0, 9))
def test_no_vertex_is_farther_off_than_the_tolerance(
    rank: int, tolerance: float, seed: int
) -> None:
    moved = clip(rank, seed=seed)
    found = fewest_shapes(moved, tolerance)
    assert largest_error(found.displacements, moved) <= tolerance
    # So many are enough: no proof may say that they are not.
    assert found.least <= len(found.shapes) <= rank


def test_a_travelling_bump_is_met_within_any_tolerance() -> None:
    # No number of shapes is exact: each tolerance takes as many as it needs, and is kept.
    place, centre = np.linspace(0.0, 1.0, 60), np.linspace(0.2, 0.8, 30)[:, None]
    bump = np.exp(-(((place - centre) / 0.15) ** 2))
    moved = bump[:, :, None] * np.array([0.3, 1.0, -0.2])
    counts = []
    for tolerance in (0.3, 0.1, 0.03, 0.01, 1e-3, 1e-4):
        found = fewest_shapes(moved, tolerance)
        assert largest_error(found.displacements, moved) <= tolerance
        counts.append(len(found.shapes))
        assert found.least in (counts[-1], counts[-1] - 1)
    assert counts == sorted(counts) and 1 < counts[0] < counts[-1] < 30


def test_levelling_the_largest_error_saves_shapes() -> None:
    # Noise that lies about the tolerance: least squares leave it uneven.
    random = np.random.default_rng(1)
    moved = (
        clip(2) + 0.05 * random.standard_normal((12, 40, 3)) * np.linspace(0.1, 1.0, 40)[:, None]
    )
    tolerances = np.linspace(0.1, 0.25, 7)
    plain = [
        len(fewest_shapes(moved, t, options=LowRankOptions(rounds=0)).shapes) for t in tolerances
    ]
    level = [len(fewest_shapes(moved, t).shapes) for t in tolerances]
    assert all(a >= b for a, b in zip(plain, level, strict=True)) and sum(level) < sum(plain)


def test_errors_count_as_they_are_seen() -> None:
    moved = clip(4)
    scales = np.ones(moved.shape[:2])
    scales[:, 20:] = 1e-6  # nobody sees these
    moved[:, :20] = clip(1, vertices=20)
    assert len(fewest_shapes(moved, 1e-3, scales=scales).shapes) == 1
    assert len(fewest_shapes(moved, 1e-3).shapes) == 5


def test_vertices_that_stay_are_left_out() -> None:
    moved = clip(2)
    moved[:, 10:] *= 1e-7
    found = fewest_shapes(moved, 1e-4)
    assert not found.shapes[:, 10:].any() and found.shapes[:, :10].any()


def test_nothing_takes_no_shape() -> None:
    for moved in (np.zeros((3, 4, 3)), np.zeros((0, 4, 3)), np.zeros((3, 0, 3))):
        found = fewest_shapes(moved, 1e-4)
        assert found.shapes.shape == (0, moved.shape[1], 3)
        assert found.weights.shape == (len(moved), 0)
        assert found.displacements.shape == moved.shape
