"""Volumes of pieces: as of bodies of known volume, and limbs that lost theirs are told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import FloatArray, vector_areas
from dtrepair.numerics.scale import WHOLE
from dtrepair.repair.strain.bounds import Excess
from dtrepair.repair.strain.meter import StrainMeter
from dtrepair.repair.strain.parts import ConnectedParts
from dtrepair.repair.strain.volumes import SHORT, Beyond, LimbOptions, Pieces, Solids, limbs
from tests.meshes import Mesh, crossed_legs, joined, swept, tube

AROUND, ALONG = 24, 120


def rod(radius: FloatArray | None = None) -> Mesh:
    """A closed rod of length 3 along x, with a radius (ALONG,) for each ring, .15 by default."""
    centre = np.linspace(0.0, 3.0, ALONG)[:, None] * [1.0, 0.0, 0.0]
    return swept(centre, np.full(ALONG, 0.15) if radius is None else radius, AROUND, closed=False)


def pinched(share: float, first: int, last: int) -> FloatArray:
    """The points of the rod with some rings drawn in to a share of their radius."""
    radius = np.full(ALONG, 0.15)
    radius[first:last] *= share
    return rod(radius)[0]


def parts_of(mesh: Mesh) -> ConnectedParts:
    return ConnectedParts(mesh[1], np.zeros(len(mesh[0]), dtype=np.int32))


def judged(mesh: Mesh, after: FloatArray) -> list[Excess]:
    return StrainMeter(parts_of(mesh), rest=mesh[0])(mesh[0], after)


def test_a_slice_of_a_rod_has_the_volume_of_a_prism() -> None:
    points, faces = rod()
    middle = points[faces].mean(axis=1)[:, 0]
    # Rings are 3 / 119 apart; slices end between the triangles of two rings.
    slices = np.where((middle > 0.2) & (middle < 2.8), middle // (10 * 3.0 / 119), -1).astype(int)
    whole = np.flatnonzero(np.bincount(slices[slices >= 0]) == 2 * AROUND * 10)
    assert len(whole) > 5
    pieces = Pieces(faces, slices, 0.0)
    section = 0.5 * AROUND * np.sin(2.0 * np.pi / AROUND) * 0.15**2
    volume, area = pieces.measures(points, vector_areas(points, faces))
    assert volume[whole] == pytest.approx(section * 10 * 3.0 / 119, rel=1e-9)
    side = 2.0 * AROUND * np.sin(np.pi / AROUND) * 0.15 * 10 * 3.0 / 119
    assert area[whole] == pytest.approx(side + 2.0 * section, rel=1e-9)


@given(st.integers(0, 1000), st.floats(0.1, 100.0))
def test_pieces_keep_their_volume_where_they_move_as_wholes(seed: int, scale: float) -> None:
    points, faces = crossed_legs(0.1, 0.2)
    random = np.random.default_rng(seed)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = points @ turn.T + 100.0 * random.normal(size=3)
    old, new = vector_areas(scale * points, faces), vector_areas(scale * moved, faces)
    for pieces in limbs(parts_of((points, faces)), points, LimbOptions())[0]:
        before, after = pieces.measures(scale * points, old), pieces.measures(scale * moved, new)
        assert pieces.changes(before, after, np.zeros(pieces.count)).max() < 1e-9


def test_a_limb_that_lost_its_volume_is_told_though_the_whole_keeps_its_own() -> None:
    mesh = rod()
    after = pinched(0.35, 40, 52)
    assert StrainMeter(parts_of(mesh))(mesh[0], after) == []
    found = judged(mesh, after)
    assert {e.kind for e in found} == {StrainKind.LIMB}
    for excess in found:
        assert excess.value > excess.bound
        assert np.abs(mesh[0][excess.vertices, 0] - 46 * 3.0 / 119).max() < 0.5
        assert 39 <= excess.worst // AROUND <= 52
    # A third of the radius less is a contact of soft flesh.
    assert judged(mesh, pinched(0.66, 40, 52)) == []


@pytest.mark.parametrize("first", range(40, 48))
def test_a_wire_shorter_than_usual_pieces_is_told_wherever_it_is(first: int) -> None:
    # Slices of one phase tell every second one.
    mesh = rod()
    found = [e for e in judged(mesh, pinched(0.1, first, first + 4)) if e.kind is StrainKind.LIMB]
    assert found
    assert all(first <= e.worst // AROUND < first + 4 for e in found)


def test_rings_of_coarse_limbs_and_their_ends_are_no_short_pieces() -> None:
    points, faces = rod()
    for pieces in limbs(parts_of((points, faces)), points, replace(SHORT, length=0.01))[0]:
        along = points[pieces.faces].mean(axis=1)[:, 0]
        spans = [np.ptp(along[pieces.piece == k]) for k in np.unique(pieces.piece)]
        # Rings are 3 / 119 apart.
        assert len(spans) > 20 and min(spans) > 3.0 / 119


def test_of_a_part_of_which_nothing_else_is_told_the_worst_short_piece_is() -> None:
    mesh = rod()
    after = pinched(0.3, 40, 46)
    radius = np.full(ALONG, 0.15)
    radius[40:46], radius[80:86] = 0.3 * 0.15, 0.2 * 0.15
    both = rod(radius)[0]
    solids = Solids(parts_of(mesh), mesh[0], scale=WHOLE, sheet=0.002, thicker=0.02)

    def told(pose: FloatArray, **bounds: float) -> list[Beyond]:
        old, new = (vector_areas(own, mesh[1]) for own in (mesh[0], pose))
        return solids.beyond(solids.changes(mesh[0], pose, old, new), limb=1.0, wire=0.8, **bounds)

    (one,) = told(after, volume=1.0)
    assert (one.vertices // AROUND).min() >= 39 and (one.vertices // AROUND).max() <= 46
    (worse,) = told(both, volume=1.0)
    assert (worse.vertices // AROUND).min() >= 79 and worse.change > one.change > 0.8
    assert [own.kind for own in told(both, volume=0.01)] == [StrainKind.VOLUME]


def test_the_largest_change_of_a_limb() -> None:
    mesh = rod()
    meter = StrainMeter(parts_of(mesh), rest=mesh[0])
    assert meter.limb_change(mesh[0], mesh[0]) == 0.0
    # Slices whose every ring is drawn in have that share of their section.
    assert meter.limb_change(mesh[0], pinched(0.5, 30, 60)) == pytest.approx(0.75)
    assert StrainMeter(parts_of(mesh)).limb_change(mesh[0], pinched(0.5, 30, 60)) == 0.0


def test_limbs_of_one_slice_are_pieces_of_their_own() -> None:
    mesh = crossed_legs(0.0, 0.0)
    pieces = limbs(parts_of(mesh), mesh[0], LimbOptions())[0][0]
    sides = [np.sign(mesh[0][pieces.vertices(k), 0]) for k in range(pieces.count)]
    single = [own for own in sides if len(own) and (own == own[0]).all()]
    assert len(single) > 0.8 * sum(len(own) > 0 for own in sides)


def test_garments_slivers_and_saddles_are_no_limbs() -> None:
    points, faces = tube(AROUND, 40, 0.2, 3.0)
    assert all(own.count == 0 for own in limbs(parts_of((points, faces)), points, LimbOptions())[0])
    mesh = rod()
    holed = (mesh[0], mesh[1][:-6])
    assert limbs(parts_of(holed), mesh[0], LimbOptions())[0][0].count > 8
    few = LimbOptions(triangles=10_000)
    assert all(own.count == 0 for own in limbs(parts_of(mesh), mesh[0], few)[0])
    plate = (mesh[0] * [1.0, 1.0, 0.02], mesh[1])
    assert judged(plate, plate[0] * [1.0, 1.0, 0.2]) == []


def test_each_part_has_limbs_whatever_its_distance_from_the_others() -> None:
    mesh = rod()
    parts = parts_of(joined(mesh, (mesh[0] + [0.0, 4.0, 0.0], mesh[1])))
    both = np.concatenate([mesh[0], mesh[0] + [0.0, 4.0, 0.0]])
    pieces = limbs(parts, both, LimbOptions())[0][0]
    owners = [np.unique(parts.of_vertex[pieces.vertices(k)]) for k in np.unique(pieces.piece)]
    assert {len(own) for own in owners} == {1}
    assert (np.bincount(np.concatenate(owners)) > 8).all()
