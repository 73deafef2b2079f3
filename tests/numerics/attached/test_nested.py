"""What a third part tells of two others: of joints much, of a hand in its glove nothing."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attached.attachment_options import AttachmentOptions
from dtrepair.numerics.attached.overlaps import _Overlaps, find_attachments
from dtrepair.numerics.attachments import Attachments, Reference
from dtrepair.numerics.geometry import IntArray
from tests.meshes import Mesh, icosphere, joined, torus, tube


def attachments_of(*meshes: Mesh) -> tuple[Attachments, Mesh]:
    points, faces = joined(*meshes)
    reference = Reference(points, Detector(points, faces)(points))
    return find_attachments(faces, len(points), [reference]), (points, faces)


def around_the_middle(found: Attachments, mesh: Mesh) -> IntArray:
    """Pairs (K, 2) of triangles of the first two parts, all within .15 of the origin's height."""
    middles = mesh[0][mesh[1]].mean(axis=1)
    near = np.abs(middles[:, 2]) < 0.15
    first, second = (np.flatnonzero(near & (found.part_of == part)) for part in (0, 1))
    pairs = np.stack(np.meshgrid(first, second), axis=-1).reshape(-1, 2).astype(np.int32)
    assert len(pairs) > 0
    return pairs


def test_a_ring_does_not_make_a_hand_come_through_its_glove() -> None:
    finger, glove, ring = tube(16, 40, 0.1, 2.0), tube(20, 24, 0.12, 1.2), torus(24, 12, 0.11, 0.03)
    found, mesh = attachments_of(finger, glove, ring)
    assert found.pairs_of_parts == [(0, 2), (1, 2)] and not len(found.by_third)
    across = around_the_middle(found, mesh)
    assert not found.modelled(across).any()
    # All that is made of it knows so, too.
    every = np.arange(len(mesh[1])), np.arange(len(mesh[0]))
    for other in (
        found.holding(np.ones(len(found.ties.vertices), dtype=bool)),
        found.carrying(found.carried),
        found.of_triangles(*every),
    ):
        assert not len(other.by_third) and not other.modelled(across).any()


def test_two_limbs_at_one_ball_are_modelled_contacts() -> None:
    limb = tube(16, 20, 0.1, 1.0)
    upper, lower = limb[0] + (0.0, 0.0, 0.55), limb[0] - (0.0, 0.0, 0.55)
    found, mesh = attachments_of((upper, limb[1]), (lower, limb[1]), icosphere(3, 0.14))
    assert found.pairs_of_parts == [(0, 2), (1, 2)] and found.by_third.tolist() == [1]
    across = around_the_middle(found, mesh)
    # So know all that are made of it, without the ball, too.
    limbs = np.flatnonzero(found.part_of != 2)
    place = np.arange(len(mesh[0]))
    for other in (
        found,
        found.holding(np.ones(len(found.ties.vertices), dtype=bool)),
        found.carrying(found.carried),
        found.of_triangles(limbs, place),
    ):
        assert np.array_equal(other.modelled(across), found.modelled(across))
    assert found.modelled(across).any()
    alone = Attachments(found.part_of, found.zones, found.ties)
    assert found.same_zones(found.carrying(found.carried)) and not found.same_zones(alone)


@pytest.mark.parametrize(("apart", "modelled"), [(0.1, True), (1.0, False)])
def test_rings_may_meet_where_they_are_beside_each_other(apart: float, modelled: bool) -> None:
    arm, ring = tube(24, 80, 0.1, 3.0), torus(24, 12, 0.1, 0.03)
    found, _ = attachments_of(arm, ring, (ring[0] + (0.0, 0.0, apart), ring[1]))
    assert found.pairs_of_parts == [(0, 1), (0, 2)]
    assert found.by_third.tolist() == ([5] if modelled else [])
    first, second = (np.flatnonzero(found.part_of == part) for part in (1, 2))
    meeting = np.stack([first, second], axis=1).astype(np.int32)
    assert found.modelled(meeting).all() == modelled == found.modelled(meeting).any()


def test_a_zone_without_vertices_lies_in_nothing() -> None:
    points, faces = joined(
        tube(16, 40, 0.1, 2.0), tube(20, 24, 0.12, 1.2), torus(24, 12, 0.11, 0.03)
    )
    pairs = Detector(points, faces)(points)
    part = np.repeat([0, 1, 2], [41 * 16, 25 * 20, 24 * 12]).astype(np.int32)
    shown = Reference(points, pairs)
    overlaps = _Overlaps(faces, part, part[faces[:, 0]], shown, AttachmentOptions())
    ring = np.flatnonzero(part == 2).astype(np.int32)
    none = np.zeros(0, dtype=np.int32)
    assert overlaps.nested({(0, 2): none, (1, 2): none, (2, 0): ring, (2, 1): ring}) == set()


def test_all_of_what_holds_a_whole_part_may_be_buried_by_design() -> None:
    found, (points, faces) = attachments_of(icosphere(3), icosphere(1, 0.2))
    assert not len(found.zones), "the small one is nowhere near the surface"
    eye = icosphere(1, 0.2)
    found, (points, faces) = attachments_of(icosphere(3), (eye[0] + (0.0, 0.0, 0.9), eye[1]))
    every = found.of_triangles(np.arange(len(faces)), np.arange(len(points)))
    assert found.holders == every.holders == {0} and not found.triangles.all()
    assert every.wholly_in_zones(faces, len(points)).all()
