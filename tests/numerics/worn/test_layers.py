"""Which part lies over which: sleeves and rings, by the rest or by poses without contact."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.worn.layers import Layers, median_of_parts
from dtrepair.numerics.worn.parts import Parts
from dtrepair.numerics.worn.sides import LayerOptions, WornLayer, find_layer, find_sheet
from tests.meshes import Mesh, grid, icosphere, joined, torus, tube

ARM = tube(24, 40, 0.2, 4.0)
SLEEVE = tube(24, 12, 0.23, 1.0)
ACROSS, UP = np.eye(3)[[0, 2]]
NO_PAIRS = np.zeros((0, 2), dtype=np.int32)


def parts_of(*meshes: Mesh, closed: tuple[bool, ...], poses: tuple[FloatArray, ...] = ()) -> Parts:
    points, faces = joined(*meshes)
    sizes = [len(own) for own, _ in meshes]
    part = np.repeat(np.arange(len(meshes)), sizes).astype(np.int32)
    return Parts(faces, part, np.array(closed), [points, *poses])


def layer(*meshes: Mesh, closed: tuple[bool, ...]) -> WornLayer | None:
    return Layers(parts_of(*meshes, closed=closed), [NO_PAIRS]).between(0, 1)


def reversed_faces(mesh: Mesh) -> Mesh:
    faces: IntArray = mesh[1][:, [0, 2, 1]]
    return mesh[0], faces


@pytest.mark.parametrize("inside_out", [False, True])
def test_all_of_an_open_sleeve_is_held_outside(inside_out: bool) -> None:
    sleeve = reversed_faces(SLEEVE) if inside_out else SLEEVE
    found = layer(ARM, sleeve, closed=(True, False))
    assert found is not None and (found.top, found.under) == (1, 0)
    # Inside out no normal of it is parallel to the arm's: that it goes round it tells.
    side = -1.0 if inside_out else 1.0
    assert len(found.vertices) == len(sleeve[0]) and (found.sides == side).all()
    assert (found.heights[np.isfinite(found.heights)] > 0).all()


@pytest.mark.parametrize("inside_out", [False, True])
@pytest.mark.parametrize("first", [False, True])
def test_a_sheet_that_goes_half_round_is_a_layer_whichever_way_it_faces(
    inside_out: bool, first: bool
) -> None:
    points, faces = SLEEVE
    half = points, faces[(points[:, 1] <= 1e-9)[faces].all(axis=1)]
    sheet = reversed_faces(half) if inside_out else half
    both, closed = ((sheet, ARM), (False, True)) if first else ((ARM, sheet), (True, False))
    found = layer(*both, closed=closed)
    assert found is not None and found.top == (0 if first else 1)
    assert (found.sides == (-1.0 if inside_out else 1.0)).all()
    # Within a tube it is beneath, and no layer over that.
    around = parts_of(tube(24, 40, 0.26, 4.0), sheet, closed=(True, False))
    found = find_layer(around, 0, 1, [0])
    assert found is None if inside_out else found is not None and found.top == 0


@pytest.mark.parametrize("gap", [0.005, 0.02])
def test_an_arm_beside_an_open_shirt_is_not_inside_of_it(gap: float) -> None:
    shirt, (arm, faces) = tube(48, 40, 0.16, 0.7), tube(24, 40, 0.045, 0.6)
    beside = arm + np.array([0.205 + gap, 0.0, 0.0]), faces
    assert layer(shirt, beside, closed=(False, True)) is None


def test_the_order_of_the_parts_is_no_matter() -> None:
    found = layer(SLEEVE, ARM, closed=(False, True))
    assert found is not None and (found.top, found.under) == (0, 1)


def test_a_closed_ring_has_a_side_towards_its_limb() -> None:
    found = layer(ARM, torus(48, 12, 0.24, 0.03), closed=(True, True))
    assert found is not None and found.top == 1
    inner, outer = (found.heights[found.sides == side] for side in (-1.0, 1.0))
    assert len(inner) and len(outer) and inner.mean() < outer.mean()


def test_what_lies_beside_or_is_stuck_through_is_no_layer() -> None:
    beside = SLEEVE[0] + [1.0, 0.0, 0.0], SLEEVE[1]
    assert layer(ARM, beside, closed=(True, False)) is None
    assert layer(ARM, icosphere(3, 0.5), closed=(True, True)) is None


def test_poses_without_contact_tell_before_all_others() -> None:
    # In the rest the sleeve is inside the arm and meets it; one pose has it outside.
    inside = SLEEVE[0] * [0.8, 0.8, 1.0], SLEEVE[1]
    clear = np.concatenate([ARM[0], SLEEVE[0]])
    parts = parts_of(ARM, inside, closed=(True, False), poses=(clear,))
    meeting = np.array([[0, len(ARM[1])]], dtype=np.int32)
    found = Layers(parts, [meeting, NO_PAIRS]).between(0, 1)
    assert found is not None and found.top == 1
    other = Layers(parts, [NO_PAIRS, meeting]).between(0, 1)
    assert other is not None and other.top == 0


@pytest.mark.parametrize("numbers, top", [((0, 0), 1), ((0, 2), 1), ((3, 2), 0), ((0, -1), 0)])
def test_numbers_of_the_user_win(numbers: tuple[int, int], top: int) -> None:
    parts = parts_of(ARM, SLEEVE, closed=(True, False))
    layers = Layers(parts, [NO_PAIRS], numbers=np.array(numbers, dtype=np.int32))
    found = layers.between(0, 1)
    assert found is not None and found.top == top


def test_the_number_of_a_part_is_the_median_of_its_triangles() -> None:
    part = np.array([0, 1, 0, 1, 0, 1, 1], dtype=np.int32)
    numbers = np.array([5, 1, 5, 2, 0, 7, 2], dtype=np.int32)
    assert median_of_parts(numbers, part, 2).tolist() == [5, 2]


def test_stricter_options_see_no_layer() -> None:
    parts = parts_of(ARM, SLEEVE, closed=(True, False))
    options = LayerOptions(near=0.01, worn=1.1)
    assert Layers(parts, [NO_PAIRS], options=options).between(0, 1) is None


def caped() -> tuple[Mesh, Mesh]:
    """A trunk, and half a tube behind it whose upper rim is sunk in it."""
    points, faces = tube(24, 24, 0.26, 2.0)
    behind = points[:, 1] <= 1e-9
    cape = points.copy()
    cape[:, :2] *= np.where(points[:, 2:] > 0.7, 0.6, 1.0 + 0.3 * (0.7 - points[:, 2:]))
    faces = faces[behind[faces].all(axis=1)]
    used, number = np.unique(faces, return_inverse=True)
    return tube(24, 40, 0.2, 2.4), (cape[used], number.reshape(-1, 3).astype(np.int32))


@pytest.mark.parametrize("inside_out", [False, True])
def test_an_attached_sheet_is_a_layer_where_it_is_not_attached(inside_out: bool) -> None:
    trunk, cape = caped()
    sheet = reversed_faces(cape) if inside_out else cape
    parts = parts_of(trunk, sheet, closed=(True, False))
    sunk = len(trunk[0]) + np.flatnonzero(cape[0][:, 2] > 0.6)
    zones = {(1, 0): sunk.astype(np.int32), (0, 1): np.zeros(0, dtype=np.int32)}
    found = Layers(parts, [NO_PAIRS], zone=lambda a, b: zones[a, b]).between(0, 1)
    assert found is not None and (found.top, found.under) == (1, 0)
    assert len(found.vertices) == len(cape[0]) - len(sunk)
    assert not np.isin(found.vertices, sunk).any()
    assert (found.sides == (-1.0 if inside_out else 1.0)).all()
    # What it does not lie over, the front, has no side.
    assert found.covered is not None and len(found.covered)
    assert (trunk[0][found.covered][:, 1] < 0.15).all()


def test_feathers_with_no_vertex_beneath_another_are_no_layers() -> None:
    """Cards of two columns, one over half of the other: what is nearest lies beside."""
    points, faces = grid(1, 8)
    feather = points * (0.075, 0.4, 1.0)
    parts = parts_of(
        (feather, faces), (feather + 0.03 * ACROSS + 0.002 * UP, faces), closed=(False, False)
    )
    none = np.zeros(0, dtype=np.int32)
    assert find_sheet(parts, 0, 1, 0, zone=lambda a, b: none) is None
    # One right over the other is.
    parts = parts_of((feather, faces), (feather + 0.002 * UP, faces), closed=(False, False))
    found = find_sheet(parts, 0, 1, 0, zone=lambda a, b: none)
    assert found is not None and found.covered is not None and len(found.covered)


def test_an_attached_arm_is_no_layer_of_its_body() -> None:
    arm = tube(16, 20, 0.05, 1.2)[0] + [0.27, 0.0, 0.0], tube(16, 20, 0.05, 1.2)[1]
    trunk = tube(24, 40, 0.2, 2.4)
    none = np.zeros(0, dtype=np.int32)
    parts = parts_of(trunk, arm, closed=(True, False))
    assert Layers(parts, [NO_PAIRS], zone=lambda a, b: none).between(0, 1) is None


def test_trousers_do_not_lie_over_the_lined_coat_above_them() -> None:
    """Its lining faces them, as if they were turned."""
    outer, inner = tube(32, 24, 0.3, 2.0), tube(32, 24, 0.29, 2.0)
    coat = joined(outer, reversed_faces(inner))
    trousers = tube(24, 24, 0.26, 1.0)[0] - [0.0, 0.0, 0.9], tube(24, 24, 0.26, 1.0)[1]
    for meshes, closed in (((coat, trousers), (True, False)), ((trousers, coat), (False, True))):
        found = layer(*meshes, closed=closed)
        assert found is not None and found.top == closed.index(True)
    # A cape that is turned against a solid back still is one.
    back = tube(24, 24, 0.26, 1.6)
    cape = layer(reversed_faces(tube(24, 12, 0.3, 1.0)), back, closed=(False, True))
    assert cape is not None and cape.top == 0


def test_a_robe_lies_over_a_shin_that_is_not_attached_to_it() -> None:
    robe = tube(32, 24, 0.7, 2.0)
    shin = tube(16, 12, 0.15, 0.8)[0] + [0.3, 0.1, -0.55], tube(16, 12, 0.15, 0.8)[1]
    found = layer(robe, shin, closed=(False, True))
    assert found is not None and (found.top, found.under) == (0, 1)
    parts, none = parts_of(robe, shin, closed=(False, True)), np.zeros(0, dtype=np.int32)
    assert Layers(parts, [NO_PAIRS], zone=lambda a, b: none).between(0, 1) is None
