"""Which sheets are linings: their normals point into the body, and they meet another sheet."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.worn.layers import Layers
from dtrepair.numerics.worn.linings import linings
from dtrepair.numerics.worn.parts import Parts
from tests.meshes import icosphere, tube
from tests.numerics.worn.test_layers import ARM, NO_PAIRS, parts_of, reversed_faces

COAT, LINING, SHIRT = (tube(24, 12, radius, 1.0) for radius in (0.27, 0.25, 0.23))
SHEETS = (True, False, False, False)


def dressed(*, inside_out: bool) -> Parts:
    """An arm in a shirt in a coat, whose lining lies between them."""
    lining = reversed_faces(LINING) if inside_out else LINING
    return parts_of(ARM, SHIRT, lining, COAT, closed=SHEETS)


def test_a_lining_is_what_points_into_the_body_beside_other_clothes() -> None:
    assert linings(dressed(inside_out=True)) == [2]
    assert linings(dressed(inside_out=False)) == []


def test_a_sheet_alone_is_none_whichever_way_it_faces() -> None:
    assert linings(parts_of(ARM, reversed_faces(LINING), closed=(True, False))) == []


def test_a_ball_in_a_shell_is_none() -> None:
    # Seen from the ball, the inner side of the shell faces it.
    ball, shell = icosphere(3, 0.24), reversed_faces(icosphere(3, 0.26))
    other = icosphere(3, 0.22)
    assert linings(parts_of(shell, ball, other, closed=(True, False, False))) == []


@pytest.mark.parametrize("inside_out", [False, True])
def test_turned_round_it_lies_between_its_neighbours(inside_out: bool) -> None:
    known = Layers(dressed(inside_out=inside_out), [NO_PAIRS])
    found = [known.between(*both) for both in ((1, 2), (2, 3))]
    order = [(own.top, own.under) for own in found if own and np.isfinite(own.heights).any()]
    assert order == ([] if inside_out else [(2, 1), (3, 2)])
