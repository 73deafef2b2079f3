"""Accessories follow what is nearest: large ones triangle by triangle, small ones as wholes."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.surface.surface import BoolArray
from dtrepair.transfer import FollowingOptions, following_pairs
from tests.meshes import grid, icosphere, joined

HOST, HOST_FACES = grid(6, 6, 6.0)
HOST_PAIRS = np.stack([np.arange(len(HOST_FACES))] * 2, axis=1).astype(np.int32)
HOST_PAIRS[:, 0] += 100
ABOVE = HOST + np.array([0.0, 0.0, 0.1])


def dressed(points: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray, BoolArray]:
    """The host with something on it, and which triangles that is."""
    together = joined((HOST, HOST_FACES), (points, faces))
    return *together, np.arange(len(together[1])) >= len(HOST_FACES)


def test_a_cloth_takes_the_partners_of_the_triangles_below_it() -> None:
    points, faces, cloth = dressed(ABOVE, HOST_FACES)
    pairs = following_pairs(HOST_PAIRS, points, faces, cloth)
    assert np.array_equal(pairs[: len(HOST_PAIRS)], HOST_PAIRS)
    added = pairs[len(HOST_PAIRS) :]
    assert np.array_equal(np.sort(added[:, 1]), np.flatnonzero(cloth))
    assert np.array_equal(added[:, 0] - 100, added[:, 1] - len(HOST_FACES))


def test_a_host_with_several_partners_gives_them_all() -> None:
    points, faces, cloth = dressed(ABOVE, HOST_FACES)
    twice = np.concatenate([HOST_PAIRS, HOST_PAIRS + np.array([500, 0])])
    added = following_pairs(twice, points, faces, cloth)[len(twice) :]
    assert len(added) == 2 * len(HOST_FACES)
    assert set(added[added[:, 1] == len(HOST_FACES) + 7, 0]) == {107, 607}


def test_a_small_part_goes_as_one() -> None:
    ball, ball_faces = icosphere(1, 0.3)
    points, faces, eye = dressed(ball + HOST[24], ball_faces)
    added = following_pairs(HOST_PAIRS, points, faces, eye)[len(HOST_PAIRS) :]
    partners = [set(added[added[:, 1] == t, 0].tolist()) for t in np.flatnonzero(eye)]
    assert len(partners[0]) > 1 and all(own == partners[0] for own in partners)
    never = FollowingOptions(small=0.0)
    each = following_pairs(HOST_PAIRS, points, faces, eye, options=never)[len(HOST_PAIRS) :]
    assert len(each) == len(ball_faces)


def test_nothing_to_follow_is_an_error_and_nothing_to_lead_is_none() -> None:
    points, faces, cloth = dressed(ABOVE, HOST_FACES)
    assert following_pairs(HOST_PAIRS, points, faces, np.zeros_like(cloth)) is HOST_PAIRS
    with pytest.raises(ValueError, match="a triangle that does not follow"):
        following_pairs(HOST_PAIRS[:0], points, faces, cloth)
