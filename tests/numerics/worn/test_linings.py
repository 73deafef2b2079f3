"""Which sheets are linings: their normals point into the body, and they meet another sheet."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.worn.layers import Layers
from dtrepair.numerics.worn.linings import linings
from dtrepair.numerics.worn.parts import Parts
from tests.meshes import Mesh, grid, icosphere, tube
from tests.numerics.worn.test_layers import ARM, NO_PAIRS, parts_of, reversed_faces

SHIRT, LINING, COAT = (tube(24, 12, radius, 1.0) for radius in (0.23, 0.25, 0.27))
SHEETS = (True, False, False, False)


def dressed(*, inside_out: bool) -> Parts:
    """An arm in a shirt in a coat, whose lining lies between them."""
    lining = reversed_faces(LINING) if inside_out else LINING
    return parts_of(ARM, SHIRT, lining, COAT, closed=SHEETS)


def moved(mesh: Mesh, offset: FloatArray | list[float]) -> Mesh:
    return mesh[0] + offset, mesh[1]


def test_a_lining_is_what_points_into_the_body_beside_other_clothes() -> None:
    assert linings(dressed(inside_out=True)) == [2]
    assert linings(dressed(inside_out=False)) == []


@pytest.mark.parametrize("beside", [(), (moved(COAT, [3.0, 0.0, 0.0]),)], ids=["alone", "far"])
def test_a_sheet_that_meets_no_other_is_none_whichever_way_it_faces(
    beside: tuple[Mesh, ...],
) -> None:
    closed = (True, False, *(False for _ in beside))
    assert linings(parts_of(ARM, reversed_faces(LINING), *beside, closed=closed)) == []


def test_two_that_both_point_inwards_are_linings() -> None:
    both = reversed_faces(SHIRT), reversed_faces(COAT)
    assert linings(parts_of(ARM, *both, closed=(True, False, False))) == [1, 2]


def test_what_covers_two_is_told_by_the_one_that_it_covers_most() -> None:
    # The inner side of a shell around a quarter of the lining faces it, too.
    shell = tube(24, 3, 0.28, 0.25)
    for one in (reversed_faces(shell), shell):
        for first, second in ((one, ARM), (ARM, one)):
            meshes = first, second, SHIRT, reversed_faces(LINING)
            assert linings(parts_of(*meshes, closed=(True, True, False, False))) == [3]


def test_a_ball_in_a_shell_is_none() -> None:
    # Seen from the ball, the inner side of the shell faces it.
    ball, shell, other = icosphere(3, 0.24), icosphere(3, 0.26), icosphere(3, 0.22)
    cut = (ball[0][:, 2] < 0.12)[ball[1]].all(axis=1)
    bowls = (ball[0], ball[1][cut]), reversed_faces((other[0], other[1][cut]))
    assert linings(parts_of(reversed_faces(shell), *bowls, closed=(True, False, False))) == []


@pytest.mark.parametrize("seed", range(4))
def test_a_flat_cape_is_one_however_it_is_turned(seed: int) -> None:
    back, cape = icosphere(3), grid(10, 10, 0.8)
    sheets = [(cape[0] - [0.4, 0.4, 0.0] + [0.0, 0.0, away], cape[1]) for away in (1.03, 1.06)]
    outwards = sheets[0][1][0]
    a, b, c = sheets[0][0][outwards]
    faces_out = np.cross(b - a, c - a)[2] > 0
    turn = Rotation.random(random_state=seed).as_matrix()
    meshes = [(points @ turn.T, faces) for points, faces in (back, *sheets)]
    meshes[1] = reversed_faces(meshes[1]) if faces_out else meshes[1]
    meshes[2] = meshes[2] if faces_out else reversed_faces(meshes[2])
    assert linings(parts_of(*meshes, closed=(True, False, False))) == [1]


def test_a_body_that_ends_at_its_neck_tells_as_a_closed_one_does() -> None:
    points, faces = icosphere(4)
    whole = points * [0.2, 0.2, 2.0], faces
    below = (whole[0][:, 2] < 1.8)[faces].all(axis=1)
    sheets = SHIRT, reversed_faces(LINING), COAT
    for kept, found in ((below, [2]), ((np.abs(whole[0][:, 2]) < 1.0)[faces].all(axis=1), [])):
        body = whole[0], faces[kept]
        assert linings(parts_of(body, *sheets, closed=(False,) * 4)) == found


@pytest.mark.parametrize("inside_out", [False, True])
def test_turned_round_it_lies_between_its_neighbours(inside_out: bool) -> None:
    known = Layers(dressed(inside_out=inside_out), [NO_PAIRS])
    found = [known.between(*both) for both in ((1, 2), (2, 3))]
    order = [(own.top, own.under) for own in found if own and np.isfinite(own.heights).any()]
    assert order == ([] if inside_out else [(2, 1), (3, 2)])
