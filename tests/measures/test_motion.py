"""Moves, edges, volumes and jitter of motions that are known."""

from __future__ import annotations

import numpy as np
import pytest

from tests.measures.motion import box_diagonal, jitter, moves, spoilt_edges, volume_changes
from tests.measures.surfaces import make_surface
from tests.meshes import grid, icosphere, joined, tube


def test_moves_are_over_the_diagonal() -> None:
    points = np.array([[0.0, 0, 0], [3, 4, 12]])
    assert box_diagonal(points) == pytest.approx(13.0)
    assert moves(points, points + np.array([[0, 0, 0], [0, 0, 1.3]])) == pytest.approx([0.0, 0.1])


def test_edges_are_spoilt_beyond_the_factor_both_ways() -> None:
    points, faces = grid(4, 4)
    surface = make_surface(points, faces.astype(np.int64))
    welded = points[surface.point_of]
    for factor, expected in ((3.9, 0), (4.1, 56), (1 / 3.9, 0), (1 / 4.1, 56)):
        assert spoilt_edges(surface, welded, factor * welded) == expected
    assert len(surface.edges) == 56
    collapsed = welded.copy()
    collapsed[0] = collapsed[1]
    assert spoilt_edges(surface, welded, collapsed) == 1


def test_volumes_of_closed_parts_change_and_others_have_none() -> None:
    points, faces = joined(icosphere(2), tube(), icosphere(1, 5.0))
    surface = make_surface(points, faces.astype(np.int64))
    welded = points[surface.point_of]
    after = welded.copy()
    after[surface.vertices(0)] *= 2.0
    after[surface.vertices(2)] *= (1.0, 1.0, 0.5)
    change = volume_changes(surface, welded, after)
    assert change[[0, 2]] == pytest.approx([7.0, -0.5]) and np.isnan(change[1])


def test_a_sheet_that_is_closed_has_no_volume_to_keep() -> None:
    points, faces = icosphere(2)
    flat = points * (1.0, 1.0, 1e-4)
    surface = make_surface(flat, faces.astype(np.int64))
    welded = flat[surface.point_of]
    assert np.isnan(volume_changes(surface, welded, 2 * welded)).all()


def test_jitter_is_the_second_difference_of_the_displacement() -> None:
    points = np.array([[0.0, 0, 0], [3, 4, 0]])
    before = np.stack([points + np.array([0.1 * k * k, 0, 0]) for k in range(6)])
    steady = before + np.arange(6)[:, None, None] * np.array([0.0, 0.2, 0.0])
    assert jitter(before, steady) == pytest.approx(0.0, abs=1e-12)
    shaken = before + (-1.0) ** np.arange(6)[:, None, None] * np.array([0.0, 0.0, 0.05])
    assert jitter(before, shaken) == pytest.approx(4 * 0.05 / 5.0)
    assert jitter(before[:2], shaken[:2]) == 0.0
