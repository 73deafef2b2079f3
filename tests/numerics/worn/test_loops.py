"""Rings and what passes through them: on in the rest, off where a correction took them off."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.worn.loops import Rings
from dtrepair.numerics.worn.parts import Parts
from dtrepair.numerics.worn.ring import LoopOptions, Ring
from tests.meshes import Mesh, bent_tube, icosphere, joined, torus, tube

ARM, LEG = tube(24, 40, 0.2, 4.0), tube(24, 40, 0.2, 2.0)
BAND = torus(48, 12, 0.32, 0.06)


def moved(mesh: Mesh, offset: tuple[float, float, float]) -> Mesh:
    return mesh[0] + offset, mesh[1]


def rings_of(
    *meshes: Mesh, closed: bool = True, stiff: tuple[int, ...] = (), **values: Any
) -> Rings:
    points, faces = joined(*meshes)
    part = np.repeat(np.arange(len(meshes)), [len(own) for own, _ in meshes]).astype(np.int32)
    parts = Parts(faces, part, np.full(len(meshes), closed), [points])
    return Rings(parts, stiff, options=LoopOptions(**values))


def with_ring_moved(rings: Rings, top: int, offset: tuple[float, float, float]) -> FloatArray:
    pose = rings.parts.poses[0].copy()
    pose[rings.parts.vertices[top]] += offset
    return pose


def taken(rings: Rings, after: FloatArray) -> list[tuple[int, int]]:
    found: list[Ring] = rings.taken_off(rings.parts.poses[0], after)
    return [(ring.top, ring.under) for ring in found]


def test_a_band_that_went_through_its_arm_is_off() -> None:
    rings = rings_of(ARM, BAND)
    assert [(ring.top, ring.under) for ring in rings.of(1)] == [(1, 0)] and rings.of(0) == []
    assert taken(rings, with_ring_moved(rings, 1, (0.8, 0.0, 0.0))) == [(1, 0)]
    # So is the arm where that is what moved.
    arm = with_ring_moved(rings, 0, (0.0, 0.8, 0.0))
    assert taken(rings, arm) == [(1, 0)]


def test_what_an_input_has_on_is_asked_of_each_input() -> None:
    rings = rings_of(ARM, BAND)
    on, off = rings.parts.poses[0], with_ring_moved(rings, 1, (0.8, 0.0, 0.0))
    for before, after, taken_off in ((on, off, 1), (off, off + 1e-3, 0), (on, off, 1)):
        assert len(rings.taken_off(before, after)) == taken_off
    # Also where it is the same array, changed in place.
    pose = on.copy()
    assert len(rings.taken_off(pose, off)) == 1
    pose[:] = off
    assert rings.taken_off(pose, off + 2.0) == []


def test_a_cuff_goes_round_the_thin_arm_of_a_large_body() -> None:
    belly = icosphere(3, 2.0)
    thin = tube(16, 80, 0.05, 4.0)
    body = joined(moved(belly, (0.0, 0.0, -4.0)), thin)
    sleeve = tube(16, 10, 0.06, 0.6)
    rings = rings_of(body, moved(sleeve, (0.0, 0.0, 1.0)), closed=False)
    hems = [ring for ring in rings.of(1) if ring.width < 0.15]
    assert len(hems) >= 2 and {(ring.top, ring.under) for ring in hems} == {(1, 0)}
    assert (1, 0) in taken(rings, with_ring_moved(rings, 1, (0.3, 0.0, 0.0)))
    assert taken(rings, with_ring_moved(rings, 1, (0.0, 0.0, 0.1))) == []


@pytest.mark.parametrize("offset", [(0.3, 0.0, 0.0), (0.0, 0.0, 0.9)])
def test_a_band_that_slid_or_cut_in_is_on(offset: tuple[float, float, float]) -> None:
    rings = rings_of(ARM, BAND)
    assert taken(rings, with_ring_moved(rings, 1, offset)) == []


def test_a_band_whose_limb_has_its_middle_just_outside_is_on() -> None:
    # Where a limb is bent, its middle line cuts the corner, and leaves what goes round it.
    rings = rings_of(ARM, BAND)
    (ring,) = rings.of(1)
    beside, off = (with_ring_moved(rings, 1, (x * ring.width, 0.0, 0.0)) for x in (0.5, 0.75))
    assert not ring.worn(beside) and taken(rings, beside) == []
    assert taken(rings_of(ARM, BAND, wider=(1.0,)), beside) == taken(rings, off) == [(1, 0)]


@pytest.mark.parametrize(("end", "tilt", "off"), [(-1.0, 2.5, 0.1), (1.0, 1.0, 0.0)])
def test_a_strap_that_tilts_at_the_end_of_its_limb_is_on(
    end: float, tilt: float, off: float
) -> None:
    # One side of it lies beyond the end, as where a knee lifts the strap of a boot.
    arm, strap = ARM, moved(BAND, (0.0, 0.0, 1.9 * end))
    rings = rings_of(arm, strap)
    pose = rings.parts.poses[0].copy()
    own = rings.parts.vertices[1]
    pose[own, 2] += end * (off + tilt * np.maximum(pose[own, 0], -0.1))
    assert len(rings.of(1)) == 1 and taken(rings, pose) == []
    assert taken(rings_of(arm, strap, ends=0.0, wider=(1.0,)), pose) == [(1, 0)]
    # Beyond the end as a whole it is off.
    assert taken(rings, with_ring_moved(rings, 1, (0.0, 0.0, 0.6 * end))) == [(1, 0)]


def test_a_coarse_limb_of_uneven_triangles_has_a_straight_middle() -> None:
    # Many vertices on one side of it, few on the other: their means would be off, and swing about.
    points, faces = ARM
    fine = np.flatnonzero((points[faces, 0] > 0.15).all(axis=1))
    tips = np.column_stack([faces[fine], len(points) + np.arange(len(fine))])
    split = np.concatenate([tips[:, own] for own in ([0, 1, 3], [1, 2, 3], [2, 0, 3])])
    triangles = np.concatenate([np.delete(faces, fine, axis=0), split]).astype(np.int32)
    uneven = np.concatenate([points, points[faces[fine]].mean(axis=1)]), triangles
    for mesh in (ARM, uneven):
        (ring,) = rings_of(mesh, BAND).of(1)
        core = ring.core @ np.concatenate([mesh[0], BAND[0]])
        assert np.abs(core[:, :2]).max() < 0.02


def test_what_was_off_before_did_not_come_off() -> None:
    rings = rings_of(ARM, BAND)
    off, farther = (with_ring_moved(rings, 1, (x, 0.0, 0.0)) for x in (0.8, 1.6))
    assert rings.taken_off(off, farther) == [] == rings.taken_off(off, rings.parts.poses[0])


def test_half_a_band_that_swung_over_the_hand_is_off() -> None:
    # As a strap in the hollow of a knee: no part of it went through the limb.
    rings = rings_of(ARM, BAND)
    pose = rings.parts.poses[0].copy()
    own = rings.parts.vertices[1]
    far = own[pose[own, 0] > 0.0]
    pose[far] = pose[far] * [-1.4, 1.0, 1.0] + [0.0, 0.0, 0.3]
    assert taken(rings, pose) == [(1, 0)]


@given(st.integers(0, 1000), st.floats(0.1, 2.5))
def test_a_band_stays_on_a_limb_that_turns_and_bends(seed: int, bend: float) -> None:
    straight, faces = bent_tube(0.0, 24, 40)
    band = torus(24, 8, 0.16, 0.03)
    place = band[0] + [0.0, 0.0, 0.3]
    rings = rings_of((straight, faces), (place, band[1]))
    # The band goes along with the middle of the limb there.
    curved, turn = bent_tube(bend, 24, 40)[0], 0.3 * bend / 2.0
    about = Rotation.from_euler("y", turn).as_matrix()
    middle = curved[np.abs(straight[:, 2] - 0.3) < 1e-9].mean(axis=0)
    carried = band[0] @ about.T + middle
    turned = Rotation.from_rotvec(np.random.default_rng(seed).normal(size=3)).as_matrix()
    pose = np.concatenate([curved, carried]) @ turned.T + 1.0
    (ring,) = rings.of(1)
    assert ring.worn(pose)
    pose[rings.parts.vertices[1]] += pose[rings.parts.vertices[1]].mean(axis=0) + 5.0
    assert not ring.worn(pose)


@given(st.integers(0, 1000), st.sampled_from([8, 12, 24]))
def test_a_sleeve_of_the_rows_of_its_limb_is_on_however_it_lies(seed: int, around: int) -> None:
    # Its middle line goes through the middle of its hems, with points in their planes. Both are
    # asked, and no ring of the whole sleeve, which a bent one may have beside its limb.
    limb, sleeve = tube(around, 20, 0.2, 4.0), tube(around, 6, 0.25, 1.2)
    rng = np.random.default_rng(seed)
    first, second = (Rotation.from_rotvec(rng.normal(size=3)).as_matrix() for _ in range(2))
    rings = rings_of((limb[0] @ first.T, limb[1]), (sleeve[0] @ first.T, sleeve[1]), closed=False)
    rest, own = rings.parts.poses[0], rings.parts.vertices[1]
    assert len(rings.of(1)) == 2
    assert all(ring.worn(rest @ second.T + rng.normal(size=3)) for ring in rings.of(1))
    for rows in (1, 2, 3):
        slid = rest.copy()
        slid[own] += 0.2 * rows * first[:, 2]
        assert rings.taken_off(rest, slid) == []


def test_a_skirt_comes_off_two_legs() -> None:
    legs = joined(moved(LEG, (-0.25, 0.0, -0.9)), moved(LEG, (0.25, 0.0, -0.9)))
    trunk = tube(32, 40, 0.5, 2.0)
    body = joined(moved(trunk, (0.0, 0.0, 1.1)), legs)
    skirt = moved(tube(32, 12, 0.7, 1.0), (0.0, 0.0, 0.3))
    rings = rings_of(body, skirt, closed=False)
    # The hem at the waist, and the whole: no leg alone is in the middle of the other hem.
    assert [ring.under for ring in rings.of(1)] == [0, 0]
    assert set(taken(rings, with_ring_moved(rings, 1, (1.6, 0.0, 0.0)))) == {(1, 0)}
    assert taken(rings, with_ring_moved(rings, 1, (0.0, 0.0, -0.5))) == []


def test_an_arm_comes_out_of_a_sleeve_while_the_shirt_stays_on() -> None:
    trunk, arm = tube(32, 40, 0.5, 3.0), tube(24, 40, 0.15, 2.0)
    across = arm[0][:, [2, 1, 0]] * [1.0, 1.0, -1.0] + [1.2, 0.0, 0.5]
    shirt, sleeve = tube(32, 12, 0.6, 1.6), tube(24, 12, 0.2, 0.8)
    hanging = sleeve[0][:, [2, 1, 0]] * [1.0, 1.0, -1.0] + [1.0, 0.0, 0.5]
    rings = rings_of(
        joined(trunk, (across, arm[1])), joined(shirt, (hanging, sleeve[1])), closed=False
    )
    assert {ring.under for ring in rings.of(1)} == {0} and len(rings.of(1)) > 2
    pose = rings.parts.poses[0].copy()
    own = rings.parts.vertices[1][len(shirt[0]) :]
    pose[own] += [0.0, 0.5, 0.0]
    found = rings.taken_off(rings.parts.poses[0], pose)
    # Both ends of the sleeve are off, and neither hem of the shirt.
    assert len(found) == 2 and all(ring.width < 0.5 for ring in found)
    assert all(np.isin(own, ring.concerned).any() for ring in found)


def test_the_ball_of_a_joint_does_not_go_through_the_hem_that_it_lies_in() -> None:
    foot, ball = tube(32, 12, 0.26, 1.0), moved(icosphere(3, 0.22), (0.0, 0.0, 0.5))
    assert rings_of(ball, foot, closed=False).of(1) == []
    # As far as its core reaches, it would.
    assert len(rings_of(ball, foot, closed=False, through=0.8).of(1)) == 1
    # The foot of a leg that ends a little below the hem does.
    leg = moved(tube(24, 40, 0.22, 4.0), (0.0, 0.0, 2.4))
    assert [ring.under for ring in rings_of(leg, foot, closed=False).of(1)] != []


@pytest.mark.parametrize(
    "other", [moved(BAND, (1.0, 0.0, 0.0)), icosphere(3, 0.5), moved(ARM, (0.1, 0.0, 0.0))]
)
def test_what_lies_beside_or_is_pierced_is_no_ring(other: Mesh) -> None:
    rings = rings_of(ARM, other)
    assert rings.of(0) == [] == rings.of(1)


def test_stiff_rings_may_leave_and_short_moves_are_not_looked_at() -> None:
    for stiff in ((0,), (1,)):
        rings = rings_of(ARM, BAND, stiff=stiff)
        assert rings.of(0) == [] == rings.of(1)
    rings = rings_of(ARM, BAND, moved=2.0)
    assert taken(rings, with_ring_moved(rings, 1, (0.8, 0.0, 0.0))) == []
    # Of many parts the largest are looked at.
    rings = rings_of(ARM, BAND, parts=1)
    assert taken(rings, with_ring_moved(rings, 1, (0.8, 0.0, 0.0))) == []


ROBE = tube(32, 24, 0.7, 2.0)


@pytest.mark.parametrize(("length", "height"), [(0.8, -0.55), (0.2, -0.7), (0.4, -1.0)])
def test_legs_and_shoes_that_came_out_of_a_robe_are_off(length: float, height: float) -> None:
    shin = tube(16, 12, 0.15, length)
    both = [moved(shin, (x, 0.0, height)) for x in (-0.3, 0.3)]
    rings = rings_of(ROBE, *both, closed=False)
    assert rings.of(0) == []
    assert [(ring.top, ring.under) for ring in rings.sections(0)] == [(0, 1), (0, 2)]
    assert taken(rings, with_ring_moved(rings, 2, (0.9, 0.0, 0.0))) == [(0, 2)]
    assert taken(rings, with_ring_moved(rings, 2, (0.25, 0.2, -0.1))) == []


def test_both_legs_are_concerned_where_one_came_out_of_a_robe_and_no_hand() -> None:
    shin, sleeve = tube(16, 12, 0.15, 0.8), tube(24, 12, 0.3, 0.8)
    across = moved((sleeve[0][:, [2, 1, 0]] * [1.0, 1.0, -1.0], sleeve[1]), (2.0, 0.0, 0.9))
    wrist = tube(16, 8, 0.1, 0.4)[0][:, [2, 1, 0]] * [1.0, 1.0, -1.0]
    hand = moved((wrist, tube(16, 8, 0.1, 0.4)[1]), (2.2, 0.0, 0.9))
    legs = [moved(shin, (x, 0.0, -0.55)) for x in (-0.3, 0.3)]
    rings = rings_of(joined(ROBE, across), *legs, hand, closed=False)
    assert [ring.under for ring in rings.sections(0)] == [1, 2, 3]
    off = rings.taken_off(rings.parts.poses[0], with_ring_moved(rings, 2, (0.9, 0.0, 0.0)))
    assert [ring.under for ring in off] == [2]
    mask = np.isin(np.arange(len(rings.parts.part)), rings.concerned(off, 0))
    assert [bool(mask[rings.parts.vertices[part]].any()) for part in range(4)] == [
        *(True, True, True, False)
    ]


def test_what_no_sheet_surrounds_may_leave() -> None:
    leg = moved(tube(16, 12, 0.15, 0.8), (0.3, 0.0, -0.55))
    assert rings_of(ROBE, leg).sections(0) == []  # that is solid
    assert rings_of(ROBE, leg, closed=False, stiff=(0,)).sections(0) == []
    assert rings_of(ROBE, leg, closed=False, stiff=(1,)).sections(0) == []
    beside = moved(leg, (0.45, 0.0, 0.0))  # half through it
    assert rings_of(ROBE, beside, closed=False).sections(0) == []
    # A limb that is worn has its rings already.
    rings = rings_of(ROBE, moved(ARM, (0.1, 0.0, 0.0)), closed=False)
    assert rings.of(0) != [] == rings.sections(0)


def test_few_and_narrow_sections_are_looked_for() -> None:
    legs = [moved(tube(16, 12, r, 0.8), (x, 0.0, -0.5)) for r, x in ((0.1, 0.3), (0.2, -0.3))]
    rings = rings_of(ROBE, *legs, closed=False)
    assert [ring.under for ring in rings.sections(0)] == [2, 1], "the larger one first"
    assert [ring.under for ring in rings.sections(0, 0.3)] == [1], "none is as narrow as the other"
    one = rings_of(ROBE, *legs, closed=False, beside=1)
    assert [ring.under for ring in one.sections(0)] == [2]


def test_a_lined_robe_is_looked_at_where_it_is_wider_than_a_leg_went() -> None:
    points, faces = tube(32, 24, 0.7, 2.0)
    funnel = points * (1.2 + 0.7 * points[:, 2:]) ** [1.0, 1.0, 0.0]
    robe = joined((funnel, faces), (0.98 * funnel, faces[:, ::-1]))
    rings = rings_of(robe, moved(tube(16, 12, 0.1, 0.8), (0.2, 0.0, -0.55)), moved=0.8)
    assert 1.2 / 0.8 < np.ptp(funnel, axis=0).min()
    assert taken(rings, with_ring_moved(rings, 1, (0.2, 0.0, 0.0))) == []
    assert taken(rings, with_ring_moved(rings, 1, (1.2, 0.0, 0.0))) == [(0, 1)]
