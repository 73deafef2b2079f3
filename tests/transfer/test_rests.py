"""Axes, alignment and winding of two rests."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.transfer.rests import (
    inside_out,
    laid_over,
    local_rotation,
    rotation_between_rests,
    rotation_of,
)
from tests.meshes import grid, icosphere
from tests.transfer_cases import TURN


def matrix(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """A row-vector matrix (4, 4) with a shift, of a column-vector map (3, 3)."""
    result = np.eye(4)
    result[:3, :3] = linear.T
    result[3, :3] = (5.0, -2.0, 9.0)
    return result


def test_scale_shear_and_reflection_are_taken_out() -> None:
    assert np.abs(rotation_of(TURN.T) - TURN).max() < 1e-14
    stretched = TURN @ np.diag([0.1, 3.0, 7.0])  # polar decomposition: stretch along own axes
    assert np.abs(rotation_of(stretched.T) - TURN).max() < 1e-13
    assert np.linalg.det(rotation_of(np.diag([-1.0, 1.0, 1.0]))) == pytest.approx(1.0)


def test_local_axes_go_over_both_worlds() -> None:
    up = np.array([0.0, 1.0, 0.0])
    same = local_rotation(up, up, matrix(TURN), matrix(TURN))
    assert np.abs(same - np.eye(3)).max() < 1e-14
    # Only the source's transform turns: local to world is the whole way.
    assert np.abs(local_rotation(up, up, matrix(TURN), np.eye(4)) - TURN).max() < 1e-14
    turned = local_rotation(up, (0, 0, 1), np.eye(4), np.eye(4))
    assert np.abs(turned @ up - (0, 0, 1)).max() < 1e-14


def test_rests_are_aligned_by_their_pairs() -> None:
    points, faces = icosphere(1)
    points = points * (1.0, 2.0, 3.0)
    moved = 2.5 * points @ TURN.T + (1.0, 2.0, 3.0)
    pairs = np.repeat(np.arange(len(faces))[:, None], 2, axis=1)
    found = rotation_between_rests((points, faces), (moved, faces), pairs)
    assert np.abs(found - TURN).max() < 1e-12
    assert np.abs(laid_over((points, faces), (moved, faces), pairs) - moved).max() < 1e-12
    with pytest.raises(ValueError, match="at least 3"):
        rotation_between_rests((points, faces), (moved, faces), pairs[:2])


def test_winding_shows_in_the_volume() -> None:
    points, faces = icosphere(1)
    assert not inside_out(points, faces) and inside_out(points, faces[:, ::-1])
    assert inside_out(1e4 * points + 1e6, faces[:, ::-1])
    sheet, triangles = grid(3, 3)
    assert not inside_out(sheet, triangles) and not inside_out(sheet, triangles[:, ::-1])
    assert not inside_out(np.zeros((3, 3)), np.array([[0, 1, 2]]))
