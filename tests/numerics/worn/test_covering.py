"""What open layers cover in one mesh: which part, and which vertices beneath."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.worn.covering import DEEPEST, Covering, learnt_layers, open_layers
from dtrepair.numerics.worn.layers import Layers
from tests.meshes import Mesh, grid, icosphere, joined, torus, tube
from tests.numerics.worn.test_layers import ARM, NO_PAIRS, SLEEVE, parts_of, reversed_faces

BALL = icosphere(2, 0.3)[0] + [0.0, 0.0, 5.0], icosphere(2)[1]


def covering() -> Covering | None:
    """What is known of an arm, its sleeve and a ball far away."""
    parts = parts_of(ARM, SLEEVE, BALL, closed=(True, False, True))
    return open_layers(Layers(parts, [NO_PAIRS]))


def test_a_sleeve_covers_its_arm_and_nothing_else_is_concerned() -> None:
    found = covering()
    assert found is not None
    arm, sleeve = len(ARM[0]), len(ARM[0]) + len(SLEEVE[0])
    assert np.unique(found.part).tolist() == [0, 1, 2] and (found.part[sleeve:] == 0).all()
    under, top = found.part[0], found.part[arm]
    assert np.argwhere(found.over).tolist() == [[top, under]]
    beneath = found.beneath
    assert (beneath[:arm] == -1).all() and (beneath[sleeve:] == -1).all()
    points = np.concatenate([ARM[0], SLEEVE[0]])
    covers = np.flatnonzero(beneath >= 0)
    assert len(covers) == len(SLEEVE[0]) and (beneath[covers] < arm).all()
    away = np.linalg.norm(points[covers] - points[beneath[covers]], axis=1)
    assert away.max() < 0.08


def test_a_tube_far_from_what_it_goes_round_covers_no_vertex_of_it() -> None:
    parts = parts_of(ARM, tube(24, 12, 0.6, 0.3), closed=(True, False))
    found = open_layers(Layers(parts, [NO_PAIRS]))
    assert found is not None and found.over.sum() == 1 and (found.beneath == -1).all()


def test_closed_parts_are_left_to_winding_numbers() -> None:
    parts = parts_of(ARM, torus(48, 12, 0.24, 0.03), closed=(True, True))
    assert open_layers(Layers(parts, [NO_PAIRS])) is None


def test_it_is_told_for_another_numbering_of_the_vertices() -> None:
    found = covering()
    assert found is not None
    count = len(found.part)
    # Every second vertex of the ball goes, the order is turned round.
    kept = np.concatenate([np.arange(count - len(BALL[0])), np.arange(count - 100, count, 2)])[::-1]
    place = np.full(count, -1)
    place[kept] = np.arange(len(kept))
    other = found.of_vertices(kept, place)
    assert np.array_equal(other.part, found.part[kept]) and other.over is found.over
    covers = np.flatnonzero(other.beneath >= 0)
    assert np.array_equal(kept[other.beneath[covers]], found.beneath[kept[covers]])


def test_of_many_cards_the_largest_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    points, faces = grid(3, 3, 0.2)
    cards = [(np.add(points, (0.0, 0.0, 0.01 * k)), faces) for k in range(150)]
    layers = Layers(parts_of(ARM, SLEEVE, *cards, closed=(True, *151 * [False])), [NO_PAIRS])
    asked = []
    monkeypatch.setattr(layers, "between", lambda *both: asked.append(both))
    open_layers(layers)
    assert (0, 1) in asked and len(asked) < 600


def test_a_layer_more_lies_over_what_is_farther_in() -> None:
    coat = tube(24, 12, 0.27, 1.2)
    parts = parts_of(ARM, SLEEVE, coat, BALL, closed=(True, False, False, True))
    found = open_layers(Layers(parts, [NO_PAIRS]))
    assert found is not None
    first = np.cumsum([0, *(len(points) for points, _ in (ARM, SLEEVE, coat))])
    assert found.depth[first].tolist() == [2, 1, 0, 0]


def test_layers_that_lie_over_one_another_in_a_circle_end_somewhere() -> None:
    three = np.arange(3, dtype=np.int32)
    circle = Covering(three, np.roll(np.eye(3, dtype=bool), 1, axis=1), three)
    assert circle.depth.tolist() == [DEEPEST] * 3


OUTER, LINING = tube(32, 24, 0.3, 2.0), reversed_faces(tube(32, 24, 0.29, 2.0))
JACKET = joined(OUTER, LINING)
HALF = JACKET[0], JACKET[1][(JACKET[0][JACKET[1]][:, :, 0] > -0.1).all(axis=1)]


@pytest.mark.parametrize(
    ("radius", "jacket", "worn"),
    [(0.26, JACKET, []), (0.26, LINING, []), (0.26, HALF, [(0, 1)]), (-0.33, JACKET, [(0, 1)])],
    ids=["lined", "lining", "half", "cape"],
)
def test_a_shirt_that_lies_in_its_jacket_is_not_told_to_be_worn_over_it(
    radius: float, jacket: Mesh, worn: list[tuple[int, int]]
) -> None:
    """But a cape around the jacket is, turned inside out; all are attached to it."""
    sheet, none = tube(24, 24, abs(radius), 0.4), np.zeros(0, dtype=np.int32)
    shirt = sheet if radius > 0.0 else reversed_faces(sheet)
    parts = parts_of(shirt, jacket, closed=(False, jacket is not LINING))
    layers = Layers(parts, [NO_PAIRS], zone=lambda a, b: none)
    known = layers.between(0, 1)
    assert known is not None and (known.top, known.under) == (0, 1)
    assert [(own.top, own.under) for own in learnt_layers(layers)] == worn
