"""Ties in the operators of a surface: clusters with one factor, offsets that are held."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attached.overlaps import find_attachments
from dtrepair.numerics.attachments import Attachments, Reference
from dtrepair.numerics.geometry import FloatArray, triangle_frames
from dtrepair.repair.full.biharmonic_fill import bilaplacian_fill
from dtrepair.repair.surface.surface import BodyRange, Surface, SurfaceOptions
from dtrepair.repair.surface.ties import KeptOffsets, TieOptions
from tests.meshes import Mesh, joined, tube


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
