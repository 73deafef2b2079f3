"""Exact triangle-triangle intersection: by hand, by symmetry and against CGAL."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.device import Device
from dtrepair.intersect.exact import settled
from dtrepair.intersect.topology.device_mesh import DeviceMesh
from tests.cgal_reference import cgal_intersect
from tests.crossing_meshes import TWO_FACES
from tests.integer_arithmetic import as_integers, integer_intersect
from tests.soups import lattice_pairs, stress_families

BASE = [(0, 0, 0), (4, 0, 0), (0, 4, 0)]
STEP = float(np.finfo(np.float32).smallest_subnormal)
CASES: dict[str, tuple[Sequence[tuple[float, ...]], bool]] = {
    "through the inside": ([(1, 1, -1), (1, 1, 1), (9, 9, 1)], True),
    "above": ([(1, 1, 1), (2, 1, 1), (1, 2, 1)], False),
    "beside, crossing the plane": ([(5, 5, -1), (5, 5, 1), (9, 9, 1)], False),
    "corner on the inside": ([(1, 1, 0), (1, 1, 5), (2, 2, 5)], True),
    "corner just above the inside": ([(1, 1, STEP), (1, 1, 5), (2, 2, 5)], False),
    "corner on corner": ([(0, 0, 0), (-1, -1, 5), (-2, -1, 5)], True),
    "corner on an edge": ([(2, 0, 0), (2, -1, 5), (3, -1, 5)], True),
    "corner just off an edge": ([(2, -STEP, 0), (2, -1, 5), (3, -1, 5)], False),
    "corner on the line of an edge, beyond it": ([(5, 0, 0), (5, -1, 5), (6, -1, 5)], False),
    "edge across an edge": ([(2, -1, -1), (2, 1, 1), (2, -5, 5)], True),
    "edge in the plane, across": ([(-1, 1, 0), (5, 1, 0), (2, 2, 3)], True),
    "edge in the plane, outside": ([(5, 1, 0), (9, 1, 0), (7, 2, 3)], False),
    "edge on an edge": ([(1, 0, 0), (3, 0, 0), (2, 0, 3)], True),
    "edge on the line of an edge, beyond it": ([(5, 0, 0), (7, 0, 0), (6, 0, 3)], False),
    "coplanar, inside": ([(0.5, 0.5, 0), (1, 0.5, 0), (0.5, 1, 0)], True),
    "coplanar, around": ([(-9, -9, 0), (20, -9, 0), (-9, 20, 0)], True),
    "coplanar, corner touches edge": ([(2, 2, 0), (4, 4, 0), (2, 4, 0)], True),
    "coplanar, corner touches corner": ([(4, 0, 0), (5, 0, 0), (5, 1, 0)], True),
    "coplanar, edge touches edge": ([(1, 0, 0), (3, 0, 0), (2, -3, 0)], True),
    "coplanar, apart by one step": ([(1, -STEP, 0), (3, -STEP, 0), (2, -3, 0)], False),
    "coplanar, apart": ([(5, 5, 0), (6, 5, 0), (5, 6, 0)], False),
    "equal": (BASE, True),
    "point on the inside": ([(1, 1, 0)] * 3, True),
    "point just above the inside": ([(1, 1, STEP)] * 3, False),
    "point on an edge": ([(2, 2, 0)] * 3, True),
    "point on a corner": ([(0, 4, 0)] * 3, True),
    "point in the plane, outside": ([(3, 3, 0)] * 3, False),
    "needle through": ([(1, 1, -1), (1, 1, 1), (1, 1, 3)], True),
    "needle that ends on the inside": ([(1, 1, 0), (1, 1, 1), (1, 1, 3)], True),
    "needle that ends just above": ([(1, 1, STEP), (1, 1, 1), (1, 1, 3)], False),
    "needle beside": ([(5, 5, -1), (5, 5, 1), (5, 5, 3)], False),
    "needle of a corner twice, through": ([(1, 1, -1), (1, 1, 1), (1, 1, 1)], True),
    "needle in the plane, across": ([(-1, 1, 0), (1, 1, 0), (9, 1, 0)], True),
    "needle in the plane, inside": ([(0.5, 1, 0), (1, 1, 0), (1.5, 1, 0)], True),
    "needle in the plane, outside": ([(5, 1, 0), (6, 1, 0), (7, 1, 0)], False),
    "needle on the line of an edge, beyond": ([(5, 0, 0), (6, 0, 0), (7, 0, 0)], False),
    "needle on the line of an edge, touching": ([(4, 0, 0), (6, 0, 0), (7, 0, 0)], True),
}
NEEDLE = [(0, 0, 0), (2, 2, 2), (4, 4, 4)]
THIN_CASES: dict[str, tuple[Sequence[tuple[float, ...]], bool]] = {
    "crossing": ([(1, 3, 2), (3, 1, 2), (2, 2, 2)], True),
    "crossing, in a plane of the axes": ([(2, 0, 2), (2, 4, 2), (2, 9, 2)], True),
    "skew": ([(1, 3, 2), (3, 1, 2 + 2.0**-20), (1, 3, 2)], False),
    "in one plane, apart": ([(5, 6, 5), (9, 1, 5), (5, 6, 5)], False),
    "parallel": ([(0, 0, 1), (2, 2, 3), (4, 4, 5)], False),
    "in line, overlapping": ([(3, 3, 3), (5, 5, 5), (7, 7, 7)], True),
    "in line, touching": ([(4, 4, 4), (5, 5, 5), (7, 7, 7)], True),
    "in line, apart": ([(4.5, 4.5, 4.5), (5, 5, 5), (7, 7, 7)], False),
    "point on it": ([(3, 3, 3)] * 3, True),
    "point at its end": ([(4, 4, 4)] * 3, True),
    "point in line, beyond": ([(5, 5, 5)] * 3, False),
    "point beside": ([(3, 3, 2)] * 3, False),
    "equal": (NEEDLE, True),
}


def intersect(first: NDArray[np.float32], second: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Whether the triangles first[k] and second[k] (K, 3, 3) have a common point (K,)."""
    poses = np.concatenate([first, second], axis=1)
    rows = np.arange(len(poses))[:, None] * (1, 0, 0) + (0, 0, 1)
    return settled(DeviceMesh(TWO_FACES, 6, device=Device()), poses, rows.astype(np.int32))


def as_triangles(corners: Sequence[tuple[float, ...]]) -> NDArray[np.float32]:
    return np.array([corners], dtype=np.float32)


@pytest.mark.parametrize("name", CASES)
def test_known_case_in_every_order_of_corners(name: str) -> None:
    check_every_order(BASE, *CASES[name])


@pytest.mark.parametrize("name", THIN_CASES)
def test_known_case_of_two_without_area(name: str) -> None:
    check_every_order(NEEDLE, *THIN_CASES[name])


def test_points_meet_if_they_are_one() -> None:
    check_every_order([(1, 2, 3)] * 3, [(1, 2, 3)] * 3, True)
    check_every_order([(1, 2, 3)] * 3, [(1, 2 + 2.0**-20, 3)] * 3, False)
    check_every_order([(0, 2, 3)] * 3, [(-0.0, 2, 3)] * 3, True)


def check_every_order(
    base_corners: Sequence[tuple[float, ...]], corners: Sequence[tuple[float, ...]], expected: bool
) -> None:
    for order in permutations(range(3)):
        turned = as_triangles([corners[k] for k in order])
        base = as_triangles([base_corners[k] for k in order])
        for fixed in (base, as_triangles(base_corners)):
            assert intersect(fixed, turned).tolist() == [expected]
            assert intersect(turned, fixed).tolist() == [expected]


@pytest.mark.parametrize("family", stress_families(1))
def test_agrees_with_cgal_and_with_integers(family: str) -> None:
    pairs = stress_families(1500)[family]
    expected = cgal_intersect(pairs[:, 0], pairs[:, 1])
    assert np.array_equal(intersect(pairs[:, 0], pairs[:, 1]), expected)
    assert np.array_equal(integer_intersect(pairs[:, 0], pairs[:, 1]), expected)
    assert 0.1 < expected.mean() < 0.95, "the family should hold both answers"


def test_whole_shifts_and_powers_of_two_change_nothing() -> None:
    pairs = lattice_pairs(1000, 5, 4)
    expected = intersect(pairs[:, 0], pairs[:, 1])
    for moved in (pairs + 1000, pairs * 2.0**-140, pairs * 2.0**100):
        moved = moved.astype(np.float32)
        assert np.array_equal(intersect(moved[:, 0], moved[:, 1]), expected)


def test_integers_keep_every_ratio() -> None:
    values = np.array([[1.5, -(2.0**-149), 2.0**127], [0.0, -0.0, 3.0]], dtype=np.float32)
    whole = as_integers(values)
    step = -whole[0, 1]
    assert step > 0
    assert whole[0, 0] == 3 * 2**148 * step and whole[0, 2] == 2 ** (127 + 149) * step
    assert whole[1].tolist() == [0, 0, 3 * 2**149 * step]


def test_no_pairs() -> None:
    nothing = np.zeros((0, 3, 3), dtype=np.float32)
    assert intersect(nothing, nothing).shape == (0,)
