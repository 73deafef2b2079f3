"""Repairer: units, places, orientations and numberings of the same pose."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from dtrepair import Repairer, RepairResult, Status
from dtrepair.numerics.geometry import FloatArray, IntArray, diagonal
from tests.exact_reference import exact_pairs
from tests.meshes import Mesh, armed_body

ARM, REST = armed_body(4.2)[0], armed_body(0.0)[0]
FACES = armed_body(0.0)[1]


@pytest.fixture(scope="module")
def plain() -> RepairResult:
    return Repairer(REST, FACES)(ARM)


def outcome(result: RepairResult) -> tuple[Status, float, float]:
    return result.status, result.displacement_mean, result.displacement_max


@pytest.mark.parametrize("scale", [2.0**-13, 2.0**20])
def test_powers_of_two_scale_exactly(scale: float, plain: RepairResult) -> None:
    scaled = Repairer(scale * REST, FACES)(scale * ARM)
    assert scaled.before == plain.before and scaled.after == plain.after
    assert np.array_equal(scaled.points, scale * plain.points)


def rotation(seed: int) -> FloatArray:
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def renumbered(points: FloatArray, faces: IntArray, seed: int) -> tuple[FloatArray, IntArray]:
    random = np.random.default_rng(seed)
    order = random.permutation(len(points))
    place = np.argsort(order).astype(np.int32)
    shuffled = place[faces][random.permutation(len(faces))]
    turned = (np.arange(3) + random.integers(0, 3, (len(faces), 1))) % 3
    return points[order], np.take_along_axis(shuffled, turned, axis=1)


CHANGES: dict[str, Callable[[FloatArray, IntArray], Mesh]] = {
    "scale 1e-4": lambda p, f: (1e-4 * p, f),
    "scale 1e6": lambda p, f: (1e6 * p, f),
    "rotated": lambda p, f: (p @ rotation(0).T, f),
    "moved": lambda p, f: (p + np.array([3.0, -5.0, 2.0]), f),
    "far away": lambda p, f: (p + 1e6 * diagonal(p) * np.array([0.6, 0.0, -0.8]), f),
    "renumbered": lambda p, f: renumbered(p, f, 0),
}


@pytest.mark.parametrize("name", CHANGES)
def test_the_outcome_does_not_depend_on_units_place_or_numbers(
    name: str, plain: RepairResult
) -> None:
    points, faces, rest = ARM, FACES, REST
    changed_points, changed_faces = CHANGES[name](points, faces)
    changed_rest, _ = CHANGES[name](rest, faces)
    changed = Repairer(changed_rest, changed_faces)(changed_points)
    assert changed.status is plain.status is Status.CLEAN
    # Rounding decides which of several near ways out is taken: sizes agree, not coordinates.
    assert abs(changed.before.pairs - plain.before.pairs) <= 0.1 * plain.before.pairs
    for one, other in zip(outcome(changed)[1:], outcome(plain)[1:], strict=True):
        assert 0.5 < one / other < 2.0
    centre = changed_points.mean(axis=0) if name == "far away" else 0.0
    assert len(exact_pairs(changed.points - centre, changed_faces)) == 0


def test_float64_poses_far_from_the_origin_keep_their_digits(plain: RepairResult) -> None:
    away = 1e6 * diagonal(ARM) * np.array([1.0, -2.0, 0.5])
    pose = ARM + away
    result = Repairer(REST, FACES)(pose)
    assert result.status is Status.CLEAN
    assert result.displacement_mean < 2 * plain.displacement_mean
    clean = Repairer(REST, FACES)(REST + away)
    assert clean.status is Status.CLEAN and np.array_equal(clean.points, REST + away)
