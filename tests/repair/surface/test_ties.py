"""Ties in the operators of a surface: clusters with one factor, offsets that are held."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attached.overlaps import find_attachments
from dtrepair.numerics.attachments import Attachments, Reference, Ties
from dtrepair.numerics.geometry import FloatArray, IntArray, triangle_frames
from dtrepair.repair.full.biharmonic_fill import bilaplacian_fill
from dtrepair.repair.surface.defects import near_contacts
from dtrepair.repair.surface.surface import BodyRange, Surface, SurfaceOptions
from dtrepair.repair.surface.ties import KeptOffsets, Partners, TieOptions
from tests.meshes import Mesh, grid, joined, tube


def two_tubes(gap: float = 0.0) -> tuple[Mesh, list[BodyRange]]:
    """Tubes end to end that overlap, as two bodies, and a third body `gap` beside them."""
    first = tube(12, 20, 0.2, 2.0)
    second = 1.1 * first[0] * (1.0, 1.0, 1.0 / 1.1) + (0.04, 0.01, 1.7)
    third = first[0] + (2.0 + gap, 0.0, 0.0)
    mesh = joined(first, (second, first[1]), (third, first[1]))
    size = len(first[0])
    return mesh, [BodyRange(k * size, (k + 1) * size, 99.0) for k in range(3)]


def attachments_of(mesh: Mesh) -> Attachments:
    points, faces = mesh
    return find_attachments(faces, len(points), [Reference(points, Detector(*mesh)(points))])


def tied() -> Surface:
    mesh, bodies = two_tubes()
    return Surface(*mesh, bodies=bodies, attachments=attachments_of(mesh))


def test_tied_bodies_share_one_factor_and_others_keep_theirs() -> None:
    mesh, bodies = two_tubes()
    free, bound = Surface(*mesh, bodies=bodies), tied()
    assert len(free.diffusion_factors) == 3 and len(bound.diffusion_factors) == 2
    assert bound.cluster_of_body.tolist() == [0, 0, 1]
    # What nothing is tied to is diffused to the last bit as it was.
    own = slice(bodies[2].start, bodies[2].stop)
    field = np.random.default_rng(1).normal(size=(bound.count, 3))
    assert np.array_equal(free.diffuse(field)[own], bound.diffuse(field)[own])


def test_a_push_on_one_body_carries_the_other_along() -> None:
    bound, free = tied(), Surface(*two_tubes()[0], bodies=two_tubes()[1])
    field = np.zeros((bound.count, 3))
    field[bound.bodies[0].start : bound.bodies[0].stop, 0] = 1.0
    other = slice(bound.bodies[1].start, bound.bodies[1].stop)
    assert not free.diffuse(field)[other].any()
    assert bound.diffuse(field)[other, 0].max() > 0.1
    assert not bound.diffuse(field)[bound.bodies[2].start :].any()


def test_ties_join_parts_but_not_shells() -> None:
    bound = tied()
    assert len(np.unique(bound.part_of_vertex)) == 2
    assert np.array_equal(bound.shell_of_vertex, bound.body_of_vertex)


def test_a_shift_of_everything_stretches_no_tie() -> None:
    bound = tied()
    assert bound.ties is not None and bound.offsets is not None
    shift = np.ones((bound.count, 3)) * (1.0, -2.0, 0.5)
    assert np.abs(bound.ties.laplacian @ shift).max() < 1e-12
    assert np.abs(bound.offsets @ shift).max() < 1e-12
    # Symmetric, and never negative.
    field = np.random.default_rng(2).normal(size=bound.count)
    assert np.abs(bound.offsets - bound.offsets.T).max() < 1e-15
    assert field @ (bound.offsets @ field) > 0.0


def drift(surface: Surface, attachments: Attachments, points: FloatArray) -> float:
    """Largest change of the offset of a tied vertex from where it is tied, units of the size."""
    vertices, triangles, weights, _ = attachments.ties

    def offset(pose: FloatArray) -> FloatArray:
        there = np.einsum("ik,ikj->ij", weights, pose[surface.faces[triangles]])
        return np.asarray(pose[vertices] - there)

    change = offset(points) - offset(surface.rest)
    return float(np.linalg.norm(change, axis=1).max())


def test_a_fill_keeps_the_offset_of_its_ties() -> None:
    mesh, _ = two_tubes()
    surface, attachments = tied(), attachments_of(mesh)
    mask = np.zeros(surface.count, dtype=bool)
    mask[attachments.ties.vertices] = True
    mask = surface.dilate(mask, 2) & (surface.body_of_vertex == 0)
    alone = bilaplacian_fill(surface.uniform, surface.rest, mask)
    held = bilaplacian_fill(surface.uniform, surface.rest, mask, surface.ties)
    assert drift(surface, attachments, held) < 0.7 * drift(surface, attachments, alone)


def test_modelled_contacts_and_folds_of_their_zones_do_not_count() -> None:
    mesh, bodies = two_tubes()
    free, bound = Surface(*mesh, bodies=bodies), tied()
    assert len(free.contacts.pairs(free.rest)) > 0
    assert len(bound.contacts.pairs(bound.rest)) == 0
    assert 0.0 < bound.in_zone.mean() < 1.0


def test_the_largest_value_of_a_cluster_is_that_of_each_of_its_bodies() -> None:
    bound = tied()
    values = np.zeros(bound.count)
    values[bound.bodies[1].start + 3] = 2.0
    assert bound.cluster_maxima(values) == pytest.approx([2.0, 2.0, 0.0])


def sleeved_arm() -> tuple[Mesh, list[BodyRange]]:
    """An arm along z, radius .1, and a sleeve .006 over it whose hems end in the arm."""
    arm = tube(16, 80, 0.1, 2.0)
    points, faces = tube(16, 56, 0.1, 1.4)
    radius = np.where(np.abs(points[:, 2]) < 0.6, 1.06, 0.94)[:, None]
    mesh = joined(arm, (points * np.hstack([radius, radius, np.ones_like(radius)]), faces))
    size = len(arm[0])
    return mesh, [BodyRange(0, size, 99.0), BodyRange(size, len(mesh[0]), 99.0)]


def bent(points: FloatArray, angle: float) -> FloatArray:
    """Points (V, 3) bent about the y axis at z = 0, as skinning blends two bones."""
    share = np.clip(points[:, 2:] / 0.1 + 0.5, 0.0, 1.0)
    share = share**2 * (3.0 - 2.0 * share)
    c, s = np.cos(angle), np.sin(angle)
    turned = points @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    return np.asarray((1.0 - share) * points + share * turned)


def sleeved(turns: int = 2, far: float = 0.1) -> Surface:
    mesh, bodies = sleeved_arm()
    chosen = SurfaceOptions(ties=TieOptions(turns=turns, far=far))
    return Surface(*mesh, bodies=bodies, attachments=attachments_of(mesh), options=chosen)


def off_modelled(surface: Surface, points: FloatArray) -> FloatArray:
    """How far tied vertices (N,) are from where they were modelled, seen from their triangles."""
    assert surface.ties is not None
    frames = triangle_frames(points[surface.ties.corners])
    local = np.einsum("nji,nj->ni", frames, surface.ties.rows @ points)
    return np.asarray(np.linalg.norm(local - surface.ties.ties.offsets, axis=1))


def test_nothing_is_off_where_ties_were_found() -> None:
    surface = sleeved()
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    assert off_modelled(surface, surface.rest).max() < 1e-12
    assert off_modelled(surface, surface.rest @ turn.T + (1.0, 2.0, 3.0)).max() < 1e-12
    assert off_modelled(surface, bent(surface.rest, 2.0)).max() > 0.005


def test_a_filled_elbow_lies_in_its_sleeve_as_modelled() -> None:
    surface = sleeved()
    pose, patch = bent(surface.rest, 2.2), np.abs(surface.rest[:, 2]) < 0.08
    off = {
        turns: off_modelled(
            surface, bilaplacian_fill(surface.uniform, pose, patch, sleeved(turns=turns).ties)
        )
        for turns in (0, 2)
    }
    assert surface.ties is not None
    own = patch[surface.ties.ties.vertices]
    assert np.median(off[2][own]) < 0.3 * np.median(off[0][own])


def test_what_slid_far_keeps_the_offset_that_it_has() -> None:
    surface, near = sleeved(), sleeved(far=0.03)
    pose, patch = bent(surface.rest, 2.2), np.abs(surface.rest[:, 2]) < 0.08
    pose[surface.bodies[1].start :, 1] += 0.04
    before = bilaplacian_fill(surface.uniform, pose, patch, sleeved(turns=0).ties)
    assert np.allclose(bilaplacian_fill(surface.uniform, pose, patch, near.ties), before, atol=1e-9)
    turned = bilaplacian_fill(surface.uniform, pose, patch, surface.ties)
    assert np.abs(turned - before).max() > 1e-3


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_what_grew_is_as_far_off_as_it_grew(scale: float) -> None:
    surface = sleeved()
    patch = np.abs(surface.rest[:, 2]) < 0.08
    filled = bilaplacian_fill(surface.uniform, bent(surface.rest, 2.0), patch, surface.ties)
    grown = bilaplacian_fill(surface.uniform, scale * bent(surface.rest, 2.0), patch, surface.ties)
    assert np.abs(grown - scale * filled).max() < 1e-6


def test_triangles_without_area_turn_nothing() -> None:
    surface = sleeved()
    assert surface.ties is not None
    pose, patch = bent(surface.rest, 2.2), np.abs(surface.rest[:, 2]) < 0.08
    # The sleeve is a line there.
    flat = patch & (surface.body_of_vertex == 1)
    pose[flat] = pose[flat].mean(axis=0) + [[0.0, 0.0, 1.0]] * surface.rest[flat, 2:]
    kept = KeptOffsets(surface.ties, np.flatnonzero(patch), pose)
    assert np.isfinite(kept.right_hand_side(pose)).all()
    thin = triangle_frames(np.array([[[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [3.0, 3.0, 3.0 + 1e-12]]]))
    assert not thin[0, :, 1:].any() and thin[0, :, 0].any()


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
