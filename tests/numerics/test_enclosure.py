"""Winding numbers of surfaces with a border, next to what solid angles make of them."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics import enclosure as module
from dtrepair.numerics.enclosure import (
    Dipoles,
    enclosure,
    facing_away,
    solid_angles,
    turned_over,
)
from dtrepair.numerics.geometry import vector_areas
from tests.meshes import grid, icosphere, joined, tube

ALONG = np.array([1.0, 0.0, 0.0])
AXIS = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.9], [0.0, 0.0, 3.0], [2.0, 0.0, 0.0]])


def test_a_closed_ball_goes_round_what_is_inside_once() -> None:
    points, faces = icosphere(3)
    found = enclosure(np.array([[0.0, 0.0, 0.0], [0.3, 0.1, -0.2], [3.0, 0.0, 0.0]]), points[faces])
    assert found == pytest.approx([1.0, 1.0, 0.0], abs=0.02)


def test_of_an_open_tube_the_ends_are_missing() -> None:
    points, faces = tube(48, 40, 0.2, 2.0)
    outwards = points[faces][0].mean(axis=0) @ np.cross(
        points[faces[0, 1]] - points[faces[0, 0]], points[faces[0, 2]] - points[faces[0, 0]]
    )
    # On the axis a disk of radius r at distance d takes up 1 - d / sqrt(d^2 + r^2) of half a turn.
    ends = [
        (1.0 - z) / np.hypot(1.0 - z, 0.2) + (1.0 + z) / np.hypot(1.0 + z, 0.2) for z in (0, 0.9)
    ]
    found = np.sign(outwards) * enclosure(AXIS, points[faces])
    assert found[:2] == pytest.approx(np.array(ends) / 2.0, abs=0.03)
    assert np.abs(found[2:]).max() < 0.03


def test_points_are_looked_at_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    points, faces = icosphere(3)
    asked = np.random.default_rng(0).normal(size=(50, 3))
    whole = Dipoles(points[faces], 12).enclose(asked)
    assert np.array_equal(whole, enclosure(asked, points[faces], 12))
    monkeypatch.setattr(module, "BLOCK", 1)
    assert Dipoles(points[faces], 12).enclose(asked) == pytest.approx(whole, abs=1e-12)
    assert len(Dipoles(points[faces], 12).enclose(asked[:0])) == 0
    closely = Dipoles(points[faces], 12).enclose_closely(asked)
    monkeypatch.setattr(module, "BLOCK", 10_000)
    assert Dipoles(points[faces], 12).enclose_closely(asked) == pytest.approx(closely, abs=1e-12)
    assert len(Dipoles(points[faces], 12).enclose_closely(asked[:0])) == 0


def test_an_octant_is_an_eighth_of_all_directions() -> None:
    octant = np.eye(3)
    both = np.stack([octant, octant[[0, 2, 1]]])
    assert solid_angles(np.zeros((2, 3)), both) == pytest.approx([np.pi / 2, -np.pi / 2])
    beyond = np.array([[2.0, 2.0, 2.0], [-2.0, 0.0, 0.0]])
    found = solid_angles(beyond, np.stack([octant, octant]))
    assert found[0] < 0.0 < found[1]


def test_close_to_a_surface_its_triangles_count_themselves() -> None:
    points, faces = tube(24, 12, 0.2, 1.0)
    corners = points[faces][np.random.default_rng(1).permutation(len(faces))]
    rng = np.random.default_rng(0)
    on = corners[rng.integers(len(corners), size=200)].mean(axis=1)
    asked = on + 0.01 * rng.normal(size=on.shape)
    exact = np.array([solid_angles(np.tile(p, (len(corners), 1)), corners).sum() for p in asked])
    exact /= 4.0 * np.pi
    dipoles = Dipoles(corners, 64)
    assert dipoles.enclose_closely(asked) == pytest.approx(exact, abs=0.01)
    assert np.abs(dipoles.enclose(asked) - exact).max() > 0.3


def test_open_parts_that_face_away_are_found() -> None:
    floor, faces = grid(4, 4, 2.0)
    above = np.array([[1.0, 1.0, 0.5], [0.5, 0.2, 1.0]])
    up = vector_areas(floor, faces)[0, 2] > 0.0
    assert facing_away(floor, faces, above).all() == (not up)
    assert facing_away(floor, faces, above * (1, 1, -1)).all() == up
    # Both at once: each part for itself; a closed one, and one seen from nowhere, are left.
    down = faces[:, ::-1] if up else faces
    ball = icosphere(1, 0.2)
    points, every = joined((floor, down), (floor + 5.0 * ALONG, down[:, ::-1]), ball)
    away = facing_away(points, every, above)
    assert away[: len(down)].all() and not away[len(down) :].any()
    assert not facing_away(points, every, np.zeros((0, 3))).any()
    # However far away that is; but not what is seen from both sides.
    assert facing_away(floor, down, above + 300.0 * ALONG).all()
    both = np.concatenate([above, above * (1, 1, -1)])
    assert not facing_away(floor, down, both).any() and not facing_away(floor, faces, both).any()
    turned = turned_over(every, away)
    assert not facing_away(points, turned, above).any()
    assert np.array_equal(turned[len(down) :], every[len(down) :])


def test_a_room_faces_who_is_in_it() -> None:
    points, faces = icosphere(2)
    room = faces[points[faces].mean(axis=1)[:, 2] < 0.8]
    inside, outside = np.array([[0.1, 0.0, 0.0]]), np.array([[2.0, 0.0, -1.0]])
    assert facing_away(points, room, inside).all() and not facing_away(points, room, outside).any()
    assert not facing_away(points, faces, inside).any()
