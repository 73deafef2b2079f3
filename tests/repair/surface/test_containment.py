"""Parts wholly inside others: found, told apart from what the rest pose has inside, and led out."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.intersect.detector import find_intersections
from dtrepair.repair.surface.containment import (
    Enclosures,
    meshes_oriented_outwards,
    oriented_outwards,
)
from tests.meshes import Mesh, grid, icosphere, joined, torus

NONE = np.zeros((0, 2), dtype=np.int32)
BALL, BALL_FACES = icosphere(3)
SMALL, SMALL_FACES = icosphere(2, 0.3)
AWAY = np.array([3.0, 0.0, 0.0])
# Not on a symmetry plane.
DEEP = np.array([0.1, 0.05, 0.31])


def two(shift: NDArray[np.float64]) -> Mesh:
    return joined((BALL, BALL_FACES), (SMALL + shift, SMALL_FACES))


REST, FACES = two(AWAY)


def test_what_is_inside_is_found() -> None:
    found = Enclosures(REST, FACES)(two(DEEP)[0], NONE)
    assert found.parts.tolist() == [[1, 0]] and found.meant.tolist() == [False]


@pytest.mark.parametrize("shift", [[1.5, 0, 0], [0.99, 0, 0.5], [0, -3, 0], [0.75, 0.75, 0.75]])
def test_outside_is_not_inside(shift: list[float]) -> None:
    assert len(Enclosures(REST, FACES)(two(np.array(shift))[0], NONE).parts) == 0


def test_what_touches_is_a_contact() -> None:
    points = two(np.array([0.9, 0.1, 0.0]))[0]
    pairs = find_intersections(points, FACES)
    assert len(pairs)
    assert len(Enclosures(REST, FACES)(points, pairs).parts) == 0


def test_an_eye_stays_in_its_head() -> None:
    rest = two(DEEP)[0]
    found = Enclosures(rest, FACES)(rest + 7.0, NONE)
    assert found.parts.tolist() == [[1, 0]] and found.meant.tolist() == [True]


def test_a_ring_has_no_inside_at_its_hole() -> None:
    ring, ring_faces = torus()
    rest, faces = joined((ring, ring_faces), (0.05 * SMALL + AWAY, SMALL_FACES))
    finder = Enclosures(rest, faces)
    # The middle of the ring's cross section nearest to the x axis.
    core = ring[np.abs(np.arctan2(ring[:, 1], ring[:, 0])) < 0.3].mean(axis=0)
    for place, count in ((np.zeros(3), 0), (core, 1)):
        pose = joined((ring, ring_faces), (0.05 * SMALL + place, SMALL_FACES))[0]
        assert len(finder(pose, NONE).parts) == count


def test_open_and_inverted_parts_have_no_inside() -> None:
    opened, inverted = FACES.copy()[1:], FACES.copy()
    assert not Enclosures(REST, opened).closed[0]
    assert len(Enclosures(REST, opened)(two(DEEP)[0], NONE).parts) == 0
    inverted[: len(BALL_FACES)] = inverted[: len(BALL_FACES), ::-1]
    assert Enclosures(REST, inverted).closed.all()
    assert len(Enclosures(REST, inverted)(two(DEEP)[0], NONE).parts) == 0


def test_a_sheet_can_be_inside() -> None:
    sheet, sheet_faces = grid(3, 3, 0.2)
    rest, faces = joined((BALL, BALL_FACES), (sheet + AWAY, sheet_faces))
    pose = joined((BALL, BALL_FACES), (sheet + DEEP, sheet_faces))[0]
    assert Enclosures(rest, faces)(pose, NONE).parts.tolist() == [[1, 0]]


def test_nested_parts_are_all_told() -> None:
    tiny = 0.1 * SMALL
    rest, faces = joined(
        (BALL, BALL_FACES), (SMALL + AWAY, SMALL_FACES), (tiny + AWAY, SMALL_FACES)
    )
    pose = joined((BALL, BALL_FACES), (SMALL + DEEP, SMALL_FACES), (tiny + DEEP, SMALL_FACES))[0]
    found = Enclosures(rest, faces)(pose, NONE)
    told = dict(zip(map(tuple, found.parts.tolist()), found.meant.tolist(), strict=True))
    assert told == {(1, 0): False, (2, 0): False, (2, 1): True}


def test_vertices_without_triangles_belong_nowhere() -> None:
    rest = np.concatenate([REST[:5], REST])
    finder = Enclosures(rest, FACES + 5)
    assert finder.count == 2 and (finder.part[:5] == -1).all()
    pose = np.concatenate([REST[:5], two(DEEP)[0]])
    assert finder(pose, NONE).parts.tolist() == [[1, 0]]


def test_the_way_out_is_short_and_leads_out() -> None:
    finder = Enclosures(REST, FACES)
    points = two(DEEP)[0]
    way = finder.way_out(points, 1, 0)
    # The shortest is 1 + 0.3 less the distance from the centre.
    assert np.linalg.norm(way) < 1.1 * (1.3 - np.linalg.norm(DEEP))
    points[len(BALL) :] += 1.1 * way
    assert len(find_intersections(points, FACES)) == 0
    assert np.linalg.norm(points[len(BALL) :], axis=1).min() > 1.0


def test_the_cost_of_many_parts_is_small() -> None:
    shifts = np.random.default_rng(0).uniform(-40, 40, (1500, 3))
    rest, faces = joined(*[(icosphere(0)[0] + s, icosphere(0)[1]) for s in shifts])
    found = Enclosures(rest, faces)._boxes_inside(rest)
    assert len(found) == 0


def test_meshes_are_oriented_as_if_each_were_alone() -> None:
    inside_out = BALL_FACES[:, ::-1]
    plane, open_faces = grid(3, 3)
    # A ball with a cavity, which stays one.
    hollow, hollow_faces = joined((BALL, BALL_FACES), (SMALL, SMALL_FACES[:, ::-1]))
    meshes = [
        (BALL, BALL_FACES),
        (BALL + AWAY, inside_out),
        (plane, open_faces),
        (BALL, BALL_FACES[:0]),
        (hollow, hollow_faces),
    ]
    together = meshes_oriented_outwards(meshes)
    for mesh, found in zip(meshes, together, strict=True):
        assert np.array_equal(found, oriented_outwards(*mesh))
    assert np.array_equal(together[1], inside_out[:, [0, 2, 1]])
    assert together[0] is BALL_FACES and np.array_equal(together[4], hollow_faces)
    assert meshes_oriented_outwards([]) == []
