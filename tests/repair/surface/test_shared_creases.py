"""Creases that attached parts share, and the triangles that ties join."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.attachments import Ties
from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.surface.defects import near_contacts
from dtrepair.repair.surface.surface import BodyRange, Surface, SurfaceOptions
from dtrepair.repair.surface.ties import Partners, TieOptions
from tests.meshes import grid, joined, tube
from tests.repair.surface.test_ties import attachments_of


def arm_in_its_sleeve(creased: float = TieOptions.creased) -> tuple[Surface, FloatArray]:
    """An arm and a sleeve that cuts it all along, of .6 of the size; heights of triangles."""
    arm = tube(12, 40, 0.2, 2.0)
    mesh = joined(arm, (arm[0] * (1.1, 0.95, 0.6), arm[1]))
    bodies = [BodyRange(k * len(arm[0]), (k + 1) * len(arm[0]), 99.0) for k in range(2)]
    options = SurfaceOptions(ties=TieOptions(creased=creased))
    surface = Surface(*mesh, bodies=bodies, attachments=attachments_of(mesh), options=options)
    return surface, surface.rest[surface.faces].mean(axis=1)


def across(surface: Surface, where: FloatArray, height: float) -> IntArray:
    """A pair of a triangle of the arm in its middle, and one of the sleeve at some height."""
    half = len(surface.faces) // 2
    middle = np.abs(where - where[half // 2]).sum(axis=1)[:half].argmin()
    wanted = where[middle] + (0.0, 0.0, height - where[middle, 2])
    beside = half + np.abs(where[half:] - wanted).sum(axis=1).argmin()
    return np.array([[middle, beside]], dtype=np.int32)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_an_arm_shares_the_creases_of_its_sleeve(order: tuple[int, int]) -> None:
    surface, where = arm_in_its_sleeve()
    beside, far = (across(surface, where, height)[:, order] for height in (0.03, 0.2))
    assert near_contacts(surface, beside, 6).all() and not near_contacts(surface, far, 6).any()
    assert near_contacts(surface, far, 20).all()


def test_it_is_a_crease_if_either_side_has_one() -> None:
    # Of a sleeve of few triangles, which is round its arm in six rings.
    arm, sleeve = tube(24, 80, 0.2, 2.0), tube(8, 10, 0.21, 1.2)
    mesh = joined(arm, sleeve)
    surface = Surface(*mesh, attachments=attachments_of(mesh))
    assert surface.ties is not None
    rng, count = np.random.default_rng(0), len(arm[1])
    ends = rng.integers(0, count, 500), rng.integers(count, len(mesh[1]), 500)
    pairs: IntArray = np.stack(ends, axis=1).astype(np.int32)
    sides = []
    for one, other in (pairs.T, pairs.T[::-1]):
        partner = surface.ties.partners.of(one, other)
        rings = surface.contacts.ring_distance(np.stack([np.maximum(partner, 0), other], axis=1))
        sides.append((partner >= 0) & (rings <= 6))
    assert (sides[0] != sides[1]).any()
    assert np.array_equal(near_contacts(surface, pairs, 6), sides[0] | sides[1])


def test_where_nothing_is_left_to_the_fill_nothing_is_a_crease() -> None:
    surface, where = arm_in_its_sleeve()
    arm = np.arange(len(where) // 2, dtype=np.int32)
    assert surface.ties is not None
    partner = surface.ties.partners.of(arm, np.full_like(arm, len(where) - 1))
    pairs = np.stack([arm, partner], axis=1)[partner >= 0]
    assert len(pairs) and near_contacts(surface, pairs, 1).all()
    assert not near_contacts(surface, pairs, 0).any()


def test_what_is_small_shares_no_creases() -> None:
    for creased, shared in ((0.5, True), (0.7, False)):
        surface, where = arm_in_its_sleeve(creased)
        assert near_contacts(surface, across(surface, where, 0.0), 6).all() == shared


def test_what_lies_beside_does_not_change_what_is_small() -> None:
    # A floor ten times as large as the arm, which nothing is tied to.
    arm = tube(12, 40, 0.2, 2.0)
    floor = np.array([[0.0, 9.0, 0.0], [20.0, 9.0, 0.0], [0.0, 9.0, 20.0]])
    sleeve = arm[0] * (1.1, 0.95, 0.6), arm[1]
    mesh = joined(arm, sleeve, (floor, np.array([[0, 1, 2]], dtype=np.int32)))
    surface = Surface(*mesh, attachments=attachments_of(mesh))
    pair = across(surface, surface.rest[surface.faces[:-1]].mean(axis=1), 0.0)
    assert near_contacts(surface, pair, 6).all()


def test_what_is_stiff_shares_no_creases() -> None:
    surface, where = arm_in_its_sleeve()
    pair = across(surface, where, 0.0)
    surface.stiff = np.zeros(surface.count, dtype=bool)
    assert near_contacts(surface, pair, 6).all()
    for side in pair[0]:
        surface.stiff[:] = False
        surface.stiff[surface.faces[side]] = True
        assert not near_contacts(surface, pair, 6).any()


def tied_by_hand(*lengths: float, to: int = 0) -> tuple[Partners, IntArray]:
    """Two quads, 1 and .1 in size; ties of some lengths from vertex 4 to triangles from `to` on."""
    points, faces = grid(1, 1)
    rest, faces = joined((points, faces), (0.1 * points, faces))
    count = len(lengths)
    triangles = np.arange(to, to + count, dtype=np.int32)
    offsets = np.outer(lengths, [0.0, 0.0, 1.0])
    vertices = np.full(count, 4, dtype=np.int32)
    ties = Ties(vertices, triangles, np.full((count, 3), 1 / 3), offsets)
    return Partners(ties, faces, rest, 0.05), faces


@pytest.mark.parametrize("lengths", [(0.1, 0.2), (0.2, 0.1)])
def test_the_shortest_of_several_ties_tells_the_partner(lengths: tuple[float, ...]) -> None:
    partners, faces = tied_by_hand(*lengths)
    at = np.flatnonzero((faces == 4).any(axis=1)).astype(np.int32)
    assert len(at) > 0
    # What is asked of is any triangle of the other shell.
    assert (partners.of(at, np.zeros_like(at)) == np.argmin(lengths)).all()


def test_one_tie_tells_both_sides() -> None:
    partners, faces = tied_by_hand(0.1)
    at = np.flatnonzero((faces == 4).any(axis=1))
    first, second = (np.array([k], dtype=np.int32) for k in (0, at[0]))
    assert partners.of(second, first) == 0 and partners.of(first, second) in at
    assert partners.of(first, first) == -1 and partners.of(second, second) == -1
    assert partners.of(np.array([1], dtype=np.int32), second) == -1


def test_a_tie_within_a_shell_joins_nothing() -> None:
    partners, _ = tied_by_hand(0.1, 0.1, to=2)
    every = np.arange(4, dtype=np.int32)
    assert all((partners.of(every, np.full_like(every, k)) == -1).all() for k in every)


@pytest.mark.parametrize("first", [0, 1])
def test_both_shells_have_to_be_large(first: int) -> None:
    points, faces = grid(1, 1)
    quads = [points, 0.1 * points]
    rest, faces = joined((quads[first], faces), (quads[1 - first], faces))
    four, one, other = (np.array([k], dtype=np.int32) for k in (4, 0, 2))
    ties = Ties(four, one, np.ones((1, 3)) / 3, rest[:1])
    for least, known in ((0.05, True), (0.2, False)):
        partners = Partners(ties, faces, rest, least)
        assert (partners.of(one, other) >= 0) == known
