"""Laws of a repair: what moves, turns, mirrors and scales without rounding does so to the result.

Other turns round the coordinates, and rounding decides which of several near ways out is taken;
what holds for those is in `test_repairer_units`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dtrepair import Repairer, Status
from dtrepair.numerics.geometry import FloatArray, diagonal
from tests.meshes import Mesh, bent_tube, elbow, overlapping_spheres

# Coordinates are multiples of this, so that moves by whole numbers and powers of two are exact.
GRID = 2.0**-16
# What the results may differ by, as a part of the largest displacement: float32 adds its digits,
# and which way a step goes hangs on counts, so that a digit may decide between two good poses.
TOLERANCE = 0.1
# A failing example is told as it is: to look for a smaller one would take minutes.
FEW = settings(max_examples=15, phases=[Phase.explicit, Phase.generate])


def on_grid(points: FloatArray) -> FloatArray:
    """Points in general position: a symmetric mesh has ways out that are equally near."""
    noise = np.random.default_rng(1).normal(size=points.shape)
    rounded: FloatArray = np.round((points + 0.004 * noise) / GRID) * GRID
    return rounded


def tube(amount: float) -> tuple[Mesh, FloatArray]:
    return bent_tube(0.0, 8, 24), bent_tube(6.35 + 0.5 * amount, 8, 24)[0]


def spheres(amount: float) -> tuple[Mesh, FloatArray]:
    return overlapping_spheres(1, 3.0), overlapping_spheres(1, 1.9 - 0.4 * amount)[0]


def crease(amount: float) -> tuple[Mesh, FloatArray]:
    return elbow(0.0, 20, 8), elbow(1.6 + 0.2 * amount, 20, 8)[0]


def exact_turn(axes: list[int], signs: tuple[float, float, float]) -> FloatArray:
    """A signed permutation of the axes (3, 3): quarter turns, and mirror images of them."""
    turn: FloatArray = np.eye(3)[axes] * signs
    return turn


TURNS = st.builds(
    exact_turn, st.permutations([0, 1, 2]), st.tuples(*[st.sampled_from([-1.0, 1.0])] * 3)
)


@FEW
@given(
    st.sampled_from([tube, spheres, crease]),
    st.floats(0.0, 1.0),
    TURNS,
    st.integers(-12, 12),
    st.tuples(*[st.integers(-500, 500)] * 3),
)
def test_a_moved_turned_and_scaled_pose_gives_the_moved_result(
    make: Callable[[float], tuple[Mesh, FloatArray]],
    amount: float,
    turn: FloatArray,
    power: int,
    move: tuple[int, int, int],
) -> None:
    (rest, faces), pose = make(amount)
    rest, pose = on_grid(rest), on_grid(pose)

    def moved(points: FloatArray) -> FloatArray:
        return 2.0**power * (points @ turn.T + np.array(move, dtype=np.float64))

    outward = faces if np.linalg.det(turn) > 0 else np.ascontiguousarray(faces[:, ::-1])
    here, there = Repairer(rest, faces)(pose), Repairer(moved(rest), outward)(moved(pose))
    assert here.status is there.status is Status.CLEAN
    assert here.before == there.before and here.before.pairs > 0
    off = np.abs(there.points - moved(here.points)).max()
    last_digit = np.spacing(np.float32(diagonal(there.points)))
    assert off <= TOLERANCE * there.displacement_max + 2 * last_digit


@pytest.fixture(scope="module")
def repairer() -> Repairer:
    return Repairer(*bent_tube(0.0, 8, 24))


@given(
    st.floats(0.1, 5.5),
    st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    st.tuples(*[st.floats(-1e3, 1e3)] * 3),
    st.sampled_from([np.float32, np.float64]),
)
def test_a_clean_pose_comes_back_bit_for_bit(
    repairer: Repairer,
    angle: float,
    turn: tuple[float, float, float],
    move: tuple[float, float, float],
    kind: type[np.floating],
) -> None:
    pose = (Rotation.from_rotvec(turn).apply(bent_tube(angle, 8, 24)[0]) + move).astype(kind)
    result = repairer(pose)
    assert result.status is Status.CLEAN and result.before.pairs == 0
    assert result.points.dtype == kind and np.array_equal(result.points, pose)


@FEW
@given(st.floats(6.3, 7.5))
def test_what_was_repaired_needs_no_repair(repairer: Repairer, angle: float) -> None:
    once = repairer(bent_tube(angle, 8, 24)[0])
    again = repairer(once.points)
    assert once.status is Status.CLEAN and once.displacement_max > 0.0
    assert np.array_equal(again.points, once.points) and again.displacement_max == 0.0
