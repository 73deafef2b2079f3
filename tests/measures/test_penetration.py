"""Depths of contacts that are known: triangles, balls, a hairpin."""

from __future__ import annotations

import numpy as np
import pytest

from tests.measures.exact_pairs import intersecting_pairs
from tests.measures.penetration import deepest_penetration
from tests.measures.surfaces import Mask, make_surface
from tests.meshes import icosphere, joined, swept

pytest.importorskip("CGAL.CGAL_Kernel")


def depth(points: np.ndarray, faces: np.ndarray, exempt: Mask | None = None) -> float:
    every = faces.astype(np.int64)
    surface = make_surface(points, every)
    pairs = intersecting_pairs(points, every, surface.vertex_of)
    ask = None if exempt is None else lambda own, other: exempt
    return deepest_penetration(surface, points[surface.point_of], pairs, ask)


@pytest.mark.parametrize("tip", [0.05, 0.3])
def test_two_triangles_are_as_deep_as_the_way_out(tip: float) -> None:
    points = np.array([[-4.0, -4, 0], [4, -4, 0], [0, 5, 0], [0, 0, -tip], [-1, 0, 3], [1, 0, 3]])
    assert depth(points, np.array([[0, 1, 2], [3, 4, 5]])) == pytest.approx(tip)


def test_no_contact_has_no_depth() -> None:
    assert depth(*icosphere(1)) == 0.0


@pytest.mark.parametrize("distance", [1.8, 1.5])
def test_balls_are_as_deep_as_they_overlap(distance: float) -> None:
    points, faces = icosphere(3)
    axis = points[0]  # a vertex of the one is the deepest in the other
    overlap = 2.0 - distance
    found = depth(*joined((points, faces), (points + distance * axis, faces)))
    # The facets lie up to 0.01 inside the unit ball.
    assert overlap - 0.02 < found <= overlap


def test_what_is_exempt_on_purpose_is_not_asked() -> None:
    points, faces = icosphere(3)
    both = joined((points, faces), (points + 1.6 * points[0], faces))
    everything = np.ones(len(both[0]), dtype=bool)
    # What is left is the depth of single pairs, no more than a triangle is large.
    assert 0 < depth(*both, everything) < 0.15 < 0.35 < depth(*both, ~everything)


def test_a_hairpin_is_as_deep_as_its_legs_overlap() -> None:
    # Two legs of radius 1, 1.6 apart, round a bend: a single closed part.
    apart, radius = 1.6, 1.0
    along = np.linspace(8.0, 0.0, 17)
    turn = np.linspace(0, np.pi, 9)[1:-1]
    bow = np.stack([-4.0 * np.sin(turn), 0.5 * apart * np.cos(turn), 0 * turn], axis=1)
    leg = np.stack([along, np.full(17, apart / 2), 0 * along], axis=1)
    back = leg[::-1] * (1.0, -1.0, 1.0)
    points, faces = swept(np.concatenate([leg, bow, back]), np.full(41, radius), 16, closed=False)
    found = depth(points, faces)
    # The bow is narrower than the legs are wide: its inner side may be deeper than the legs are.
    assert 0.9 * (2 * radius - apart) < found < 2 * radius


def test_depth_follows_the_size_and_forgets_the_sense() -> None:
    points, faces = icosphere(2)
    both = joined((points, faces), (points + 1.7 * points[0], faces))
    once = depth(*both)
    assert depth(3.0 * both[0], both[1]) == pytest.approx(3 * once, rel=1e-5)
    assert depth(both[0], both[1][:, ::-1]) == pytest.approx(once)
