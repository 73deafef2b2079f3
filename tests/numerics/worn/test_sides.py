"""A sheet, open or lined, is a layer over what it goes round, however far away that is."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dtrepair.numerics.worn.around import find_around, find_worn, still_around
from dtrepair.numerics.worn.parts import Parts
from dtrepair.numerics.worn.sides import LayerOptions
from tests.meshes import icosphere, tube

Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]


def cone(radius: float, lower: float, *, part: float = 1.0, around: int = 40) -> Mesh:
    """An open cone about the y axis from y = -1 to 1, or a part of its turn; normals outwards."""
    count = around + 1
    angle = 2.0 * np.pi * part * np.linspace(0.0, 1.0, count)
    rings = [
        np.stack([r * np.sin(angle), np.full(count, y), r * np.cos(angle)], axis=1)
        for y, r in zip(np.linspace(1.0, -1.0, 9), np.linspace(radius, lower, 9), strict=True)
    ]
    corner = (np.arange(8)[:, None] * count + np.arange(around)[None]).ravel()
    faces = [[corner, corner + count, corner + count + 1], [corner, corner + count + 1, corner + 1]]
    return np.concatenate(rings), np.concatenate([np.stack(f, axis=1) for f in faces]).astype(
        np.int32
    )


def legs() -> Mesh:
    """Two long balls side by side, one mesh."""
    points, faces = icosphere(3)
    sides = [points * (0.2, 1.3, 0.2) + (x, 0.0, 0.0) for x in (-0.4, 0.4)]
    return np.concatenate(sides), np.concatenate([faces, faces + len(points)]).astype(np.int32)


def parts_of(outer: Mesh, inner: Mesh, closed: list[bool]) -> Parts:
    """Two parts in one pose."""
    points = np.concatenate([outer[0], inner[0]])
    faces = np.concatenate([outer[1], inner[1] + len(outer[0])]).astype(np.int32)
    part = np.repeat([0, 1], [len(outer[0]), len(inner[0])]).astype(np.int32)
    return Parts(faces, part, np.array(closed), [points])


def test_an_open_part_is_a_layer_over_what_it_goes_round() -> None:
    skirt, (points, faces) = cone(0.8, 1.6), icosphere(3)
    leg = points * (0.2, 1.3, 0.2), faces
    for order in ((0, 1), (1, 0)):
        layer = find_worn(parts_of(skirt, leg, [False, True]), *order, 0)
        assert layer is not None and (layer.top, layer.under) == (0, 1)
        assert (layer.sides == 1.0).all() and len(layer.vertices) == len(skirt[0])
    assert find_worn(parts_of(skirt, leg, [True, True]), 0, 1, 0) is None
    half = cone(0.8, 1.6, part=0.5)
    assert find_worn(parts_of(half, leg, [False, True]), 0, 1, 0) is None


@pytest.mark.parametrize("seed", range(4))
def test_a_wide_skirt_lies_over_two_legs_whichever_way_they_are_turned(seed: int) -> None:
    turn = Rotation.random(random_state=seed)
    skirt, both = ((turn.apply(points), faces) for points, faces in (cone(0.8, 1.6), legs()))
    layer = find_worn(parts_of(skirt, both, [False, True]), 0, 1, 0)
    assert layer is not None and layer.top == 0 and (layer.sides == 1.0).all()


def test_normals_that_face_inwards_are_told() -> None:
    points, faces = cone(0.8, 1.6)
    layer = find_worn(parts_of((points, faces[:, ::-1].copy()), legs(), [False, True]), 0, 1, 0)
    assert layer is not None and (layer.sides == -1.0).all()


def lined(thickness: float) -> Mesh:
    """A skirt with a lining: its two sides, so far from each other."""
    (outer, faces), (inner, _) = cone(0.8, 1.6), cone(0.8 - thickness, 1.6 - thickness)
    within = faces[:, ::-1] + len(outer)
    return np.concatenate([outer, inner]), np.concatenate([faces, within]).astype(np.int32)


@pytest.mark.parametrize("inside_out", [False, True])
def test_a_skirt_with_a_lining_is_a_layer_and_a_thick_ring_is_none(inside_out: bool) -> None:
    points, faces = lined(0.02)
    faces = faces[:, ::-1].copy() if inside_out else faces
    layer = find_worn(parts_of((points, faces), legs(), [True, True]), 0, 1, 0)
    assert layer is not None and (layer.top, layer.under) == (0, 1)
    sides = np.repeat([1.0, -1.0], len(points) // 2) * (-1.0 if inside_out else 1.0)
    assert np.array_equal(layer.sides, sides)
    assert find_worn(parts_of(lined(0.3), legs(), [True, True]), 0, 1, 0) is None


def shoe(offset: float) -> Mesh:
    """A ball that looks out of the skirt's hem, to one side of its middle."""
    points, faces = icosphere(2, 0.3)
    return points + np.array([offset, -0.95, 0.0]), faces


@pytest.mark.parametrize("inside_out", [False, True])
def test_a_robe_is_a_layer_over_a_shoe_at_its_hem(inside_out: bool) -> None:
    points, faces = lined(0.02)
    robe = points, faces[:, ::-1].copy() if inside_out else faces
    parts = parts_of(robe, shoe(0.5), [True, True])
    assert find_worn(parts, 0, 1, 0) is None
    for order in ((0, 1), (1, 0)):
        layer = find_around(parts, *order, 0)
        assert layer is not None and (layer.top, layer.under) == (0, 1)
        sides = np.repeat([1.0, -1.0], len(points) // 2) * (-1.0 if inside_out else 1.0)
        assert np.array_equal(layer.sides, sides) and np.isinf(layer.heights).all()
    assert find_around(parts_of(robe, shoe(1.6), [True, True]), 0, 1, 0) is None
    assert find_around(parts_of(lined(0.3), shoe(0.5), [True, True]), 0, 1, 0) is None
    small = LayerOptions(small=0.05)
    assert find_around(parts_of(robe, shoe(0.5), [True, True]), 0, 1, 0, options=small) is None
    # Nothing is said of what sticks out on one side.
    assert find_around(parts_of(robe, shoe(1.5), [True, True]), 0, 1, 0) is None


def test_an_open_robe_has_one_side_outside() -> None:
    points, faces = cone(0.8, 1.6)
    for turned, side in ((faces, 1.0), (faces[:, ::-1].copy(), -1.0)):
        layer = find_around(parts_of((points, turned), shoe(0.5), [False, True]), 0, 1, 0)
        assert layer is not None and (layer.sides == side).all()


def test_of_two_sheets_that_surround_each_other_neither_is_outside() -> None:
    robe, (points, faces) = tube(32, 24, 0.7, 2.0), tube(32, 24, 0.42, 2.0)
    within = points - np.array([0.0, 0.0, 0.9]), faces
    for outer, inner in ((robe, within), (within, robe)):
        assert find_around(parts_of(outer, inner, [False, False]), 0, 1, 0) is None


def test_a_pose_tells_whether_a_shoe_is_in_the_robe_yet() -> None:
    parts = parts_of(lined(0.02), shoe(0.5), [True, True])
    layer = find_around(parts, 0, 1, 0)
    assert layer is not None and layer.around
    for way, inside in (((0.0, 0.0, 0.0), True), ((0.5, 0.2, 0.0), True), ((1.5, 0.0, 0.0), False)):
        points = parts.poses[0].copy()
        points[parts.vertices[1]] += way
        assert still_around(parts, layer, points) == inside


def test_a_hand_in_its_sleeve_lies_beneath_the_side_of_it_that_is_nearest() -> None:
    """Far from the middle of a coat, where all of a sleeve would be on one side."""
    coat, sleeve = cone(0.8, 0.9), cone(0.3, 0.3)
    points = sleeve[0][:, [1, 0, 2]] * [1.0, -1.0, 1.0] + np.array([2.0, 0.9, 0.0])
    outer = np.concatenate([coat[0], points])
    within = np.concatenate([0.97 * coat[0], (points - [2.0, 0.9, 0.0]) * 0.97 + [2.0, 0.9, 0.0]])
    faces = np.concatenate([coat[1], sleeve[1] + len(coat[0])])
    lined_coat = (
        np.concatenate([outer, within]),
        np.concatenate([faces, faces[:, ::-1] + len(outer)]).astype(np.int32),
    )
    hand, triangles = icosphere(2, 0.25)
    held = hand * np.array([2.0, 1.0, 1.0]) + np.array([2.4, 0.9, 0.0]), triangles
    layer = find_around(parts_of(lined_coat, held, [True, True]), 0, 1, 0)
    assert layer is not None
    of_sleeve = np.arange(len(coat[0]), len(outer))
    assert (layer.sides[of_sleeve] == layer.sides[of_sleeve][0]).all()
    assert (layer.sides[of_sleeve + len(outer)] == -layer.sides[of_sleeve][0]).all()
