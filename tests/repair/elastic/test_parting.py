"""Few triangles that cross, led apart by the least motion."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.numerics.metrics import distortion
from dtrepair.repair.elastic.parting import PartingOptions, _groups, least_overlaps, parted
from dtrepair.repair.full.biharmonic_fill import FillOptions
from dtrepair.repair.full.mend import MendOptions, mend
from dtrepair.repair.full.method import FullMethod
from dtrepair.repair.full.phases import PhaseOptions, Phases
from dtrepair.repair.full.push import PushOptions
from dtrepair.repair.surface.defects import find_defects
from dtrepair.repair.surface.surface import BodyRange, Surface
from tests.meshes import elbow, joined, tube

FACES = np.arange(6, dtype=np.int32).reshape(2, 3)
PAIR = np.array([[0, 1]], dtype=np.int32)


@given(st.integers(0, 2**32 - 1))
def test_along_its_axis_a_pair_comes_apart_and_no_sooner(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(6, 3))
    overlaps = least_overlaps(points, FACES, PAIR)
    axis, depth = overlaps.axes[0], overlaps.depths[0]
    crossing = len(Detector(points, FACES)(points)) > 0
    assert lengths(overlaps.axes)[0] == pytest.approx(1.0)
    assert (depth > 0.0) == crossing or abs(depth) < 1e-6
    for share, apart in ((1.001, True), (0.9, not crossing)):
        moved = points.copy()
        moved[:3] -= share * max(depth, 0.0) * axis
        assert (len(Detector(moved, FACES)(moved)) == 0) == apart or abs(depth) < 1e-6
    # The ends are what overlaps most.
    first, second = (overlaps.ends[0, side] @ points[FACES[side]] @ axis for side in (0, 1))
    assert first - second == pytest.approx(depth)


def creased() -> tuple[Surface, FloatArray]:
    """A coarse limb, bent until two or three triangles of its crease cross."""
    rest, faces = elbow(0.0, along=10, around=8)
    surface = Surface(rest, faces)
    for angle in np.linspace(1.4, 3.0, 33):
        pose = elbow(float(angle), along=10, around=8)[0] / surface.size
        if 0 < len(find_defects(surface, pose).crossings) <= 12:
            return surface, pose
    raise AssertionError("no angle crosses")


def test_a_crease_of_few_triangles_comes_apart_by_a_small_motion() -> None:
    surface, pose = creased()
    known = find_defects(surface, pose)
    deepest = least_overlaps(pose, surface.faces, known.crossings).depths.max()
    found = parted(surface, pose, known)
    assert found is not None
    points, left = found
    assert len(left.crossings) == 0 and len(surface.contacts.pairs(points)) == 0
    assert 0.0 < lengths(points - pose).max() < 3.0 * deepest + 0.05 * surface.edge_length
    for solved in (FullMethod(surface)(pose).points, mend(surface, pose, [pose], step=0.01)):
        assert len(surface.contacts.pairs(solved)) == 0
        assert lengths(solved - pose).max() < 3.0 * deepest + 0.05 * surface.edge_length


def test_more_pairs_than_a_crease_has_are_left_to_others() -> None:
    surface, pose = creased()
    known = find_defects(surface, pose)
    few = PartingOptions(most=len(known.crossings) - 1)
    assert parted(surface, pose, known, options=few) is None
    assert parted(surface, surface.rest, find_defects(surface, surface.rest)) is None


def test_what_is_fixed_stays() -> None:
    rest, faces = elbow(0.0, along=10, around=8)
    surface, pose = creased()
    held = Surface(rest, faces, mobility=np.zeros(len(rest)))
    assert parted(held, pose, find_defects(held, pose)) is None
    half = np.ones(len(rest))
    corners = surface.faces[find_defects(surface, pose).crossings]
    half[corners[:, 0]] = 0.0
    some = Surface(rest, faces, mobility=half)
    found = parted(some, pose, find_defects(some, pose))
    assert found is None or np.array_equal(found[0][half == 0.0], pose[half == 0.0])


def test_two_bodies_come_apart_and_a_rigid_one_keeps_its_place() -> None:
    points, faces = joined((ROOF, ROOF_FACES), (ROOF * (1.0, 1.0, -1.0) + [0.3, 0.0, 1.1], BACK))
    bodies = [BodyRange(0, 5, 99.0), BodyRange(5, 10, 99.0, rigid=True)]
    surface = Surface(points, faces, bodies=bodies)
    pose = surface.rest.copy()
    pose[5:, 2] -= 0.2
    known = find_defects(surface, pose)
    found = parted(surface, pose, known)
    assert len(known.crossings) and found is not None
    assert len(surface.contacts.pairs(found[0])) == 0
    assert np.array_equal(found[0][5:], pose[5:])


# A pyramid without a floor, and its triangles turned round.
ROOF = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0, 0, 0.5]], dtype=np.float64)
ROOF_FACES = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]], dtype=np.int32)
BACK = ROOF_FACES[:, ::-1].copy()
# Corners of two triangles.
LINE = np.array([[3, 0, 0], [3.5, 0, 0], [4, 0, 0], [3.2, 0, 0], [3.7, 0, 0], [4.2, 0, 0]])


def test_triangles_without_area_are_left_to_others() -> None:
    """Of two on one line nothing tells where they come apart."""
    points, faces = joined((ROOF, ROOF_FACES), (LINE, FACES))
    surface = Surface(points, faces)
    known = find_defects(surface, surface.rest)
    assert len(known.crossings) == 1
    assert parted(surface, surface.rest, known) is None


def creases_and_line() -> tuple[Surface, FloatArray]:
    """Two creases that come apart, the second farther open, and triangles on one line."""
    rest, faces = elbow(0.0, along=10, around=8)
    alone, pose = creased()
    line, own = joined((ROOF, ROOF_FACES), (LINE, FACES))
    apart = [9.0 * alone.size, 0.0, 0.0]
    surface = Surface(*joined((rest, faces), (1.5 * rest + apart, faces), (line - apart, own)))
    bent = pose * alone.size
    return surface, np.concatenate([bent, 1.5 * bent + apart, line - apart]) / surface.size


def moves_of(surface: Surface, pose: FloatArray, points: FloatArray) -> list[float]:
    """How far the vertices of both limbs, and of the rest, move at most."""
    far, limb = lengths(points - pose), len(elbow(0.0, along=10, around=8)[0])
    return [float(own.max()) for own in np.split(far, [limb, 2 * limb])]


def test_where_one_group_stays_the_others_come_apart() -> None:
    surface, pose = creases_and_line()
    known = find_defects(surface, pose)
    assert parted(surface, pose, known) is None
    found = parted(surface, pose, known, some=True)
    assert found is not None
    points, left = found
    assert len(left.crossings) == 1 < len(known.crossings)
    assert left.crossings.tolist() == surface.contacts.pairs(points).tolist()
    first, second, line = moves_of(surface, pose, points)
    assert 0.0 < 1.2 * first < second and line == 0.0


def test_a_group_that_would_go_too_far_stays_alone() -> None:
    surface, pose = creases_and_line()
    known = find_defects(surface, pose)
    every = parted(surface, pose, known, some=True)
    assert every is not None
    first, second, _ = moves_of(surface, pose, every[0])
    between = 0.5 * (first + second)
    still, none = PushOptions(iterations=0), FillOptions(rounds=0)
    numbers = PhaseOptions(push=still, fill=none, last_fill=none)
    found = Phases(surface, pose, farthest=between, options=numbers).best()
    assert moves_of(surface, pose, found.points) == [first, 0.0, 0.0]
    assert 1 < len(found.defects.crossings) < len(known.crossings)


def test_groups_are_left_alone_where_too_many_or_connected() -> None:
    surface, pose = creases_and_line()
    known = find_defects(surface, pose)
    for few in (PartingOptions(most_in_all=len(known.crossings) - 1), PartingOptions(most=0)):
        assert parted(surface, pose, known, options=few, some=True) is None
    # The limit of what is led apart together holds for each group.
    few = PartingOptions(most=len(known.crossings) - 1)
    found = parted(surface, pose, known, options=few, some=True)
    assert found is not None and len(found[1].crossings) == 1
    # One pair is one group, and is not tried twice.
    points, faces = joined((ROOF, ROOF_FACES), (LINE, FACES))
    one = Surface(points, faces)
    assert parted(one, one.rest, find_defects(one, one.rest), some=True) is None


def test_groups_are_what_rings_or_pairs_connect() -> None:
    points, faces = joined(tube(8, 30, 0.2, 3.0), tube(8, 30, 0.2, 3.0))
    surface = Surface(
        points + np.repeat([[0.0] * 3, [9.0, 0.0, 0.0]], len(points) // 2, axis=0), faces
    )
    # Triangles of the first tube in two of its bands, and one of the second tube for each.
    bands = surface.faces[:480].reshape(30, 16, 3)
    number = np.arange(480).reshape(30, 16)
    assert (np.ptp(surface.rest[bands][..., 2], axis=(1, 2)) < 0.2).all()
    for between, rings, groups in ((4, 2, 1), (8, 2, 2), (8, 4, 1), (4, 0, 2)):
        first = [number[5, 0], number[5 + between, 0]]
        pairs = np.array([[first[0], 480], [first[1], 960 - 1]], dtype=np.int32)
        assert len(_groups(surface, pairs, rings)) == groups
        # Both meet one triangle.
        assert len(_groups(surface, np.array([[first[0], 480], [first[1], 480]]), rings)) == 1


def test_all_that_comes_apart_together_does() -> None:
    surface, pose = creased()
    known = find_defects(surface, pose)
    whole, grouped = parted(surface, pose, known), parted(surface, pose, known, some=True)
    assert whole is not None and grouped is not None
    assert np.array_equal(whole[0], grouped[0])


def test_what_pushing_and_filling_leave_comes_apart_in_groups() -> None:
    surface, pose = creases_and_line()
    still, none = PushOptions(iterations=0), FillOptions(rounds=0)
    numbers = PhaseOptions(push=still, fill=none, last_fill=none)
    mended = mend(surface, pose, [pose], step=0.01, options=MendOptions(push=still, fill=none))
    assert len(surface.contacts.pairs(mended)) == 1
    for way in (Phases.best, partial(Phases.insist_from, points=pose)):
        found = way(Phases(surface, pose, options=numbers))
        assert len(found.defects.crossings) == 1 == len(surface.contacts.pairs(found.points))
        assert found.distortion == pytest.approx(distortion(pose, found.points, surface.edges))
