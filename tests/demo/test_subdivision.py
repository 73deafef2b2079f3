"""Catmull-Clark against the values of the unit cube, and what every step must keep."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.demo.subdivision import subdivide

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
QUADS = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]],
    dtype=np.int32,
)


def volume(points: NDArray[np.float64], quads: NDArray[np.int32]) -> float:
    a, b, c, d = (points[quads[:, k]] for k in range(4))
    result: float = sum(np.einsum("ij,ij->", a, np.cross(p, q)) / 6 for p, q in ((b, c), (c, d)))
    return result


def test_cube_has_the_textbook_points() -> None:
    matrix, quads = subdivide(QUADS, 8)
    points = matrix @ CUBE
    assert points.shape == (8 + 12 + 6, 3) and quads.shape == (24, 4)
    assert np.allclose(points[:8], CUBE * 5 / 9)  # (1/3 + 2 * 2/3) / 3
    assert np.allclose(np.sort(np.abs(points[8:20]), axis=1), [0, 0.75, 0.75])
    assert np.allclose(np.sort(np.abs(points[20:]), axis=1), [0, 0, 1])


def test_steps_keep_weights_orientation_and_closedness() -> None:
    points, quads = CUBE, QUADS
    volumes = [volume(points, quads)]
    for _ in range(3):
        matrix, quads = subdivide(quads, len(points))
        assert np.allclose(matrix.sum(axis=1), 1)
        assert matrix.min() >= 0  # valence 3 has no negative weight
        points = matrix @ points
        volumes.append(volume(points, quads))
    assert volumes[0] == pytest.approx(8)
    assert all(a > b > 0 for a, b in pairwise(volumes))
    edges = len(
        np.unique(np.sort(np.stack([quads, np.roll(quads, -1, 1)], 2).reshape(-1, 2)), axis=0)
    )
    assert len(points) - edges + len(quads) == 2


def test_open_surface_is_refused() -> None:
    with pytest.raises(ValueError, match="expected a closed surface, got 4 edges"):
        subdivide(QUADS[:-1], 8)
