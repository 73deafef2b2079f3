"""The character of the demo: one closed surface, clean at rest, intersecting in motion."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.demo.character import DemoCharacter, make_character
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.geometry import components, unique_edges


@pytest.fixture(scope="module")
def character() -> DemoCharacter:
    return make_character()


def triangles(quads: NDArray[np.int32]) -> NDArray[np.int32]:
    return np.stack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1).reshape(-1, 3)


def test_one_closed_surface_of_a_few_thousand_quads(character: DemoCharacter) -> None:
    faces = triangles(character.quads)
    assert 2000 < len(character.quads) < 6000
    assert character.quads.max() == len(character.rest) - 1
    assert len(np.unique(components(faces, len(character.rest)))) == 1
    # Euler characteristic of a sphere
    assert len(character.rest) - len(unique_edges(faces)) + len(faces) == 2


def test_outside_is_outside_and_feet_stand_on_the_ground(character: DemoCharacter) -> None:
    a, b, c = (character.rest[triangles(character.quads)[:, k]] for k in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0
    low, high = character.rest.min(axis=0), character.rest.max(axis=0)
    assert -0.02 < low[1] < 0.05 and 1.5 < high[1] < 2.0
    assert np.allclose(low[0], -high[0], atol=1e-9)  # symmetric arms


def test_rest_is_clean_and_the_clip_is_not(character: DemoCharacter) -> None:
    detector = Detector(character.rest, triangles(character.quads))
    assert len(detector(character.rest)) == 0
    counts = np.bincount(detector(character.points)[:, 0], minlength=len(character.times))
    assert counts[0] == 0 and counts[-1] == 0
    assert (counts > 0).sum() >= 8
    assert counts.max() > 100


def test_poses_start_at_rest_and_move_smoothly(character: DemoCharacter) -> None:
    assert np.allclose(character.points[0], character.rest)
    assert character.times.tolist() == list(range(1, 25))
    steps = np.abs(np.diff(character.points, axis=0)).max(axis=(1, 2))
    assert steps.max() < 0.3
    assert np.abs(character.points - character.rest).max() > 0.4


def test_number_of_frames(character: DemoCharacter) -> None:
    assert make_character(frames=5).points.shape == (5, *character.rest.shape)
    assert np.allclose(make_character(frames=1).points[0], character.rest)
