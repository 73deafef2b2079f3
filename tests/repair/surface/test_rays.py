"""Rays through closed surfaces: winding numbers and ways out, against balls."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.repair.surface.rays import exits_along, frame_along, windings
from tests.meshes import icosphere, joined, torus

BALL, FACES = icosphere(3)
GENERATOR = np.random.default_rng(0)


def test_windings_of_a_ball_and_of_two_in_each_other() -> None:
    points = GENERATOR.uniform(-1.2, 1.2, size=(300, 3))
    radius = np.linalg.norm(points, axis=1)
    clear = np.abs(radius - 1.0) > 0.02  # the polyhedron is inside of the ball
    assert np.array_equal(windings(points, BALL[FACES])[clear], (radius < 1.0)[clear])
    both, faces = joined((BALL, FACES), (0.5 * BALL, FACES))
    nested = (radius < 1.0).astype(int) + (radius < 0.5)
    clear &= np.abs(radius - 0.5) > 0.02
    assert np.array_equal(windings(points, both[faces])[clear], nested[clear])
    assert np.array_equal(windings(points, BALL[FACES[:, ::-1]]), -windings(points, BALL[FACES]))


def test_the_way_out_of_a_ball() -> None:
    points = GENERATOR.normal(size=(200, 3))
    points *= GENERATOR.uniform(0, 0.97, size=(200, 1)) / np.linalg.norm(points, axis=1)[:, None]
    way = np.array([0.6, 0.0, 0.8])
    along = points @ way
    expected = -along + np.sqrt(1.0 - (points**2).sum(axis=1) + along**2)
    assert np.allclose(exits_along(way, points, BALL[FACES]), expected, atol=0.03)


def test_outside_there_is_nothing_to_leave() -> None:
    ring, faces = torus()
    points = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [-5.0, 0.0, 0.05], [1.0, 0.0, 0.0]])
    out = exits_along(np.array([1.0, 0.0, 0.0]), points, ring[faces])
    assert out[:3].tolist() == [0.0, 0.0, 0.0] and 0.28 < out[3] < 0.31
    assert exits_along(np.array([1.0, 0.0, 0.0]), points[:0], ring[faces]).shape == (0,)
    # The first way out counts, not the last: a part may end in a hole.
    out = exits_along(np.array([-1.0, 0.0, 0.0]), points[3:], ring[faces])
    assert 0.28 < out[0] < 0.31


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_frames_are_rotations(axis: int, sign: float) -> None:
    direction = sign * np.eye(3)[axis]
    frame = frame_along(direction)
    assert np.allclose(frame.T @ frame, np.eye(3)) and np.linalg.det(frame) > 0
    assert np.allclose(direction @ frame, [1.0, 0.0, 0.0])


def test_what_is_asked_together_does_not_matter() -> None:
    """Only triangles near the asked points are looked at: one point sees what many see."""
    points, faces = icosphere(2)
    corners = points[faces]
    probes = np.random.default_rng(1).uniform(-1.2, 1.2, size=(60, 3))
    way = np.array([0.0, 0.6, 0.8])
    alone = [windings(probe[None], corners)[0] for probe in probes]
    assert np.array_equal(windings(probes, corners), alone)
    assert 0 < np.count_nonzero(alone) < len(probes)
    lengths = [exits_along(way, probe[None], corners)[0] for probe in probes]
    assert np.allclose(exits_along(way, probes, corners), lengths, rtol=0.0, atol=1e-12)
