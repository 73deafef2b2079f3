"""Zones around overlaps of rods, balls and sockets whose size is known."""

from __future__ import annotations

import numpy as np
import pytest

from tests.measures.exact_pairs import intersecting_pairs
from tests.measures.modelled_zones import RINGS, Attachment, Zones, attach, drift
from tests.measures.surfaces import Surface, make_surface
from tests.meshes import icosphere, joined, swept

pytest.importorskip("CGAL.CGAL_Kernel")

STEP = 0.25  # between two rings of a rod


def rod(start: float, end: float, radius: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """A closed rod along x with rings at every STEP."""
    x = np.arange(start, end + STEP / 2, STEP)
    centre = np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)
    return swept(centre, np.full(len(x), radius), 12, closed=False)


def attached(points: np.ndarray, faces: np.ndarray) -> tuple[Surface, list[Attachment]]:
    surface = make_surface(points, faces.astype(np.int64))
    pairs = intersecting_pairs(points, faces.astype(np.int64), surface.vertex_of)
    return surface, attach(surface, points[surface.point_of], pairs)


def ball(x: float, radius: float, level: int = 3) -> tuple[np.ndarray, np.ndarray]:
    points, faces = icosphere(level, radius)
    return points + np.array([x, 0.011, 0.007]), faces


def test_a_zone_reaches_as_far_as_the_seeds_are_wide() -> None:
    # The rod enters the ball from x = 0.9 on; its start is a unit inside.
    points, faces = joined(rod(-0.1, 10.0), ball(0.0, 1.0))
    surface, (attachment,) = attached(points, faces)
    welded = points[surface.point_of]
    side = attachment.sides[0]
    seeds = welded[side.seeds]
    assert len(side.seeds) == len(set(side.seeds.tolist()))
    # All that is buried is a seed, and the ring beyond the surface of the ball.
    assert seeds[:, 0].max() == pytest.approx(1.15)
    assert seeds[:, 0].min() < -0.1
    spread = seeds - seeds.mean(axis=0)
    reach = max(float(np.sqrt((spread**2).sum(axis=1).mean())), RINGS * STEP)
    zone = welded[surface.faces[side.zone]]
    assert zone[..., 0].max() <= 1.15 + reach + 1e-9
    assert zone[..., 0].max() > 1.15 + reach - STEP
    assert side.zone.sum() < len(surface.triangles(side.part)) / 2


def test_contacts_near_the_overlap_are_modelled_and_others_are_faults() -> None:
    points, faces = joined(rod(-0.1, 10.0), ball(0.0, 1.0))
    surface, attachments = attached(points, faces)
    zones = Zones(surface, attachments)
    every = faces.astype(np.int64)
    moved = points.copy()
    rest = intersecting_pairs(points, every, surface.vertex_of)
    assert len(rest) and zones.modelled(rest).all()
    # The ball slides along to the middle of the rod: there it has no business.
    ball_points = np.arange(len(points)) >= len(points) - 642
    moved[ball_points] += (5.0, 0.0, 0.0)
    pairs = intersecting_pairs(moved, every, surface.vertex_of)
    assert len(pairs) and not zones.modelled(pairs).any()
    held = zones.held(0, 1)
    x = points[surface.point_of][:, 0]
    assert held[(x < 1.0) & (surface.part_of_vertex == 0)].all() and not held[x > 3.0].any()


def test_a_part_mostly_inside_another_is_modelled_as_a_whole() -> None:
    # An eye: a small ball whose centre lies inside a large one.
    points, faces = joined(ball(0.0, 1.0, 4), ball(0.9, 0.3, 2))
    surface, (attachment,) = attached(points, faces)
    small = attachment.sides[1]
    assert len(small.seeds) == len(surface.vertices(1)) == 162
    assert small.zone.sum() == len(surface.triangles(1))
    # What holds it may meet it within its length: not on the far side.
    x = points[surface.point_of][surface.faces][..., 0]
    held = attachment.sides[0].zone
    assert held[(surface.part_of_face == 0) & (x > 0.7).all(axis=1)].all()
    assert not held[(x < 0.2).any(axis=1)].any()
    # Once it is held by less than half of it, only what is near the overlap is.
    points, faces = joined(ball(0.0, 1.0), ball(1.2, 0.3, 2))
    surface, (attachment,) = attached(points, faces)
    assert 0 < len(attachment.sides[1].seeds) < 81
    assert attachment.sides[0].zone.sum() < len(surface.triangles(0)) / 2


@pytest.mark.parametrize(("size", "modelled"), [(0.5, True), (1.2, False)])
def test_two_parts_in_one_socket_may_meet_there(size: float, modelled: bool) -> None:
    # Two rods end in one ball without touching, and meet in it later: in a small one.
    left, faces = rod(-5.0, -0.25)
    right = left * (-1.0, 1.0, 1.0)
    points, every = joined((left, faces), (right, faces[:, ::-1]), ball(0.0, size))
    surface, attachments = attached(points, every)
    assert {own.sides[0].part for own in attachments} == {0, 1}
    assert {own.sides[1].part for own in attachments} == {2}
    zones = Zones(surface, attachments)
    moved = points.copy()
    moved[len(left) : 2 * len(left)] += (-0.8, 0.05, 0.03)
    pairs = intersecting_pairs(moved, every.astype(np.int64), surface.vertex_of)
    two = pairs[(surface.part_of_face[pairs] < 2).all(axis=1)]
    assert len(two) and zones.modelled(two).all() == modelled == zones.modelled(two).any()
    # The same rods without the ball have nothing in common.
    assert not Zones(surface, attachments[:1]).modelled(two).any()


def test_drift_is_what_one_part_moves_against_the_other() -> None:
    points, faces = joined(rod(-0.1, 10.0), ball(0.0, 1.0))
    surface, (attachment,) = attached(points, faces)
    welded = points[surface.point_of]
    ties = attachment.ties
    assert len(ties.vertices) == sum(len(side.seeds) for side in attachment.sides)
    assert ties.weights.min() >= 0 and ties.weights.sum(axis=1) == pytest.approx(1.0)
    together = welded + np.array([1.0, -2.0, 0.5])
    assert drift(ties, welded, together) == pytest.approx(np.zeros(len(ties.vertices)))
    apart = welded.copy()
    apart[surface.vertices(1)] += (0.0, 0.3, 0.4)
    assert drift(ties, welded, apart) == pytest.approx(np.full(len(ties.vertices), 0.5))


def test_parts_that_do_not_meet_are_not_attached() -> None:
    points, faces = joined(rod(2.0, 5.0), ball(0.0, 1.0))
    surface, attachments = attached(points, faces)
    assert attachments == []
    zones = Zones(surface, attachments)
    assert not zones.modelled(np.array([[0, len(faces) - 1]])).any()
    assert not zones.held(0, 1).any() and not zones.modelled(np.zeros((0, 2), np.int64)).any()
