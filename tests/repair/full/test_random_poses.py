"""Limbs in random poses through each other and through their body: clean, and hardly bent."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from dtrepair import Repairer, Status
from dtrepair.numerics.geometry import unique_edges
from dtrepair.numerics.metrics import edge_log_ratio, volume
from tests.exact_reference import exact_pairs
from tests.meshes import Mesh, armed_body, crossed_legs, elbow, knot

Random = np.random.Generator
# The rest and a random pose, of the same triangles.
Case = Callable[[Random], tuple[Mesh, Mesh]]


def arm_through_its_body(random: Random) -> tuple[Mesh, Mesh]:
    return armed_body(0.0), armed_body(random.uniform(3.7, 4.3))


def tail_through_its_body(random: Random) -> tuple[Mesh, Mesh]:
    thin = np.array([1.0, random.uniform(0.3, 0.5), 1.0])
    (rest, faces), (pose, _) = armed_body(0.0), armed_body(random.uniform(3.7, 4.1))
    return (rest * thin, faces), (pose * thin, faces)


def knotted_tube(random: Random) -> tuple[Mesh, Mesh]:
    return knot(), knot(tube_radius=random.uniform(0.65, 0.9))


def folded_limb(random: Random) -> tuple[Mesh, Mesh]:
    return elbow(0.0), elbow(random.uniform(2.6, 3.0))


CASES: dict[str, tuple[Case, float]] = {
    # Most distortion, the rms of the logarithms of edge ratios.
    "arm": (arm_through_its_body, 0.1),
    "tail": (tail_through_its_body, 0.1),
    "knot": (knotted_tube, 0.2),
    "elbow": (folded_limb, 0.3),
}


def check(rest: Mesh, pose: Mesh, most: float) -> float:
    """Repair a pose, check what holds for all, and return the largest motion, of its diagonal."""
    (points, faces), moved = pose, rest[0]
    result = Repairer(moved, faces)(points)
    assert result.before.pairs > 0 and result.status is Status.CLEAN
    assert len(exact_pairs(result.points, faces)) == 0
    after = np.asarray(result.points, dtype=np.float64)
    assert edge_log_ratio(points, after, unique_edges(faces)) < most
    assert 0.85 < volume(after, faces) / volume(points, faces) < 1.15
    diagonal = np.linalg.norm(np.ptp(points, axis=0))
    return float(np.linalg.norm(after - points, axis=1).max() / diagonal)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", list(CASES))
def test_limbs_come_clean_and_are_hardly_bent(name: str, seed: int) -> None:
    case, most = CASES[name]
    check(*case(np.random.default_rng(seed)), most)


@pytest.mark.parametrize("seed", range(4))
def test_limbs_that_cross_like_an_x_leave_by_the_short_way(seed: int) -> None:
    random = np.random.default_rng(seed)
    angle, apart = random.uniform(0.3, 0.6), random.uniform(0.0, 0.1)
    pose = crossed_legs(angle, apart)
    largest = check(crossed_legs(0.0, 0.0), pose, 0.1)
    # Either leg has half of their overlap to go in depth, and a little more than that.
    needed = (0.12 - apart) / np.linalg.norm(np.ptp(pose[0], axis=0))
    assert largest < 1.5 * needed + 0.005
