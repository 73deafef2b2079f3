"""Each measure of strain: beyond its bound where a shape is ruined, within it where it is not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtrepair.diagnosis import StrainKind
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attached.overlaps import find_attachments
from dtrepair.numerics.attachments import Attachments, Reference
from dtrepair.numerics.geometry import FloatArray, IntArray, diagonal, vector_areas
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.scene.bounds import share_search
from dtrepair.repair.scene.props import with_rigid
from dtrepair.repair.strain.bounds import Excess, StrainOptions
from dtrepair.repair.strain.meter import StrainMeter
from dtrepair.repair.strain.parts import ConnectedParts
from dtrepair.repair.strain.shares import ShareOptions
from tests.meshes import Mesh, elbow, icosphere, joined, torus, tube

BALL, FACES = icosphere(3)
AWAY = np.array([2.0, 0.0, 0.0])
TURN = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
TURN *= np.sign(np.linalg.det(TURN))


def meter(mesh: Mesh, attachments: Attachments | None = None, **values: Any) -> StrainMeter:
    points, faces = mesh
    owner = np.zeros(len(points), dtype=np.int32)
    return StrainMeter(ConnectedParts(faces, owner, attachments), options=StrainOptions(**values))


def kinds(found: list[Excess]) -> set[StrainKind]:
    return {excess.kind for excess in found}


@given(st.floats(0.0, 0.2), st.integers(0, 5))
def test_what_moves_as_a_whole_or_little_is_not_strained(amount: float, seed: int) -> None:
    wobble = 0.1 * amount * np.sin(3.0 * BALL + seed)
    assert meter((BALL, FACES))(BALL, (BALL + wobble) @ TURN.T + [3.0, 2.0, 1.0]) == []


def test_a_pose_that_did_not_move_is_not_strained() -> None:
    assert meter((BALL, FACES))(BALL, BALL.copy()) == []


def pinched(points: FloatArray, far: float, scale: float) -> FloatArray:
    """Points (V, 3) with those beyond `far` along z drawn together, or apart."""
    result, own = points.copy(), points[:, 2] > far
    centre = points[own].mean(axis=0)
    result[own] = centre + scale * (points[own] - centre)
    return result


@pytest.mark.parametrize("scale", [0.05, 8.0])
def test_edges_that_got_four_times_longer_or_shorter(scale: float) -> None:
    (found,) = [
        e for e in meter((BALL, FACES))(BALL, pinched(BALL, 0.9, scale)) if e.kind == "edges"
    ]
    assert found.value > found.bound == 5
    assert (BALL[found.vertices, 2] > 0.6).all() and BALL[found.worst, 2] > 0.6
    assert StrainKind.EDGES not in kinds(meter((BALL, FACES))(BALL, pinched(BALL, 0.9, 0.4)))


def test_a_share_of_many_edges_is_allowed_and_points_are_not_edges() -> None:
    moved = pinched(BALL, 0.97, 0.1)
    assert kinds(meter((BALL, FACES))(BALL, moved)) == {StrainKind.EDGES}
    assert meter((BALL, FACES), edges_share=0.05)(BALL, moved) == []
    assert meter((BALL, FACES), point=0.5)(BALL, moved) == []


def test_a_small_part_is_judged_for_itself() -> None:
    mesh = joined((BALL, FACES), (0.1 * icosphere(1)[0] + [2.0, 0.0, 0.0], icosphere(1)[1]))
    points, count = mesh[0], len(BALL)
    flat = points.copy()
    flat[count:] = points[count:].mean(axis=0) + 0.1 * (
        points[count:] - points[count:].mean(axis=0)
    )
    found = meter(mesh, edges_share=0.2)(points, flat)
    assert {excess.part for excess in found} == {1}
    assert kinds(found) == {StrainKind.EDGES, StrainKind.VOLUME}
    assert meter(mesh).parts.number_of(1) == (2, 2)


def arm_in_sleeve() -> tuple[Mesh, Attachments, int]:
    """Two tubes end to end that overlap, what is attached, and the vertices of the first."""
    first, second = tube(12, 40, 0.2, 4.0), tube(12, 40, 0.23, 4.0)
    mesh = joined(first, (second[0] + [0.05, 0.01, 3.7], second[1]))
    points, faces = mesh
    reference = Reference(points, Detector(points, faces)(points))
    return mesh, find_attachments(faces, len(points), [reference]), len(first[0])


@pytest.mark.parametrize("degrees", [10.0, 25.0, 90.0])
def test_what_swings_together_has_not_come_apart(degrees: float) -> None:
    mesh, attachments, _ = arm_in_sleeve()
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    assert meter(mesh, attachments)(mesh[0], mesh[0] @ turn.T) == []


def test_parts_that_came_off_each_other() -> None:
    mesh, attachments, count = arm_in_sleeve()
    points, size = mesh[0], diagonal(mesh[0])
    measure = meter(mesh, attachments)
    for away, kind in (
        (0.03, StrainKind.DRIFT),
        (0.015, StrainKind.SLIDE),
        (0.006, StrainKind.SLIDE),
    ):
        moved = points.copy()
        moved[:count] -= [0.0, 0.0, away * size]
        (found,) = measure(points, moved)
        assert found.kind == kind and abs(found.value - away) < 1e-9 and found.value > found.bound
        assert {found.part, found.other} == {0, 1}
        assert set(found.vertices) & set(range(count))
        assert set(found.vertices) & set(range(count, len(points)))
    moved[:count] = points[:count] - [0.0, 0.0, 0.003 * size]
    assert measure(points, moved) == []
    assert meter(mesh)(points, points + (np.arange(len(points)) < count)[:, None]) == []


def test_closed_parts_keep_their_volume_and_sheets_have_none() -> None:
    swollen = BALL * [1.0, 1.0, 1.3]
    (found,) = meter((BALL, FACES))(BALL, swollen)
    assert found.kind == StrainKind.VOLUME and abs(found.value - 0.3) < 1e-9
    assert meter((BALL, FACES))(BALL, BALL * [1.0, 1.0, 1.1]) == []
    plate = BALL * [1.0, 1.0, 0.002]
    assert meter((BALL, FACES))(plate, plate * [1.0, 1.0, 1.3]) == []
    opened = (BALL, FACES[1:])
    assert meter(opened)(BALL, swollen) == []


def test_a_ring_that_is_widened_does_not_swell() -> None:
    points, faces = torus(24, 8, 1.0, 0.1)
    wide = points + 0.4 * points * [1.0, 1.0, 0.0] / np.linalg.norm(points[:, :2], axis=1)[:, None]
    assert meter((points, faces))(points, wide) == []
    assert kinds(meter((points, faces))(points, 1.4 * points)) == {StrainKind.VOLUME}
    assert kinds(meter((points, faces))(wide, points)) == {StrainKind.VOLUME}


def swells(lump: Mesh, after: FloatArray) -> tuple[bool, bool]:
    """Whether a closed mesh that becomes `after` is told to swell: alone, with a pin attached."""
    points = lump[0]
    mesh = joined(lump, (icosphere(1)[0] * 0.05 + points[0], icosphere(1)[1]))
    reference = Reference(mesh[0], Detector(*mesh)(mesh[0]))
    attachments = find_attachments(mesh[1], len(mesh[0]), [reference])
    assert attachments.pairs_of_parts == [(0, 1)]
    both = np.concatenate([after, mesh[0][len(points) :]])
    found = meter(lump)(points, after), meter(mesh, attachments)(mesh[0], both)
    alone, held = (StrainKind.VOLUME in kinds(own) for own in found)
    return alone, held


def test_what_is_attached_and_goes_round_nothing_swells_however_thin_it_is() -> None:
    """A piece of a finger drawn out by two fifths; a ring is widened for what it goes round."""
    rod, ring = elbow(0.0, 60, 12, 0.1), torus(24, 8, 1.0, 0.1)
    assert swells(rod, rod[0] * [1.0, 1.0, 1.4]) == (False, True)
    assert swells(rod, rod[0] * [1.0, 1.0, 1.1]) == (False, False)
    flat = ring[0] * [1.0, 1.0, 0.0]
    wide = ring[0] + 0.4 * flat / np.linalg.norm(flat, axis=1)[:, None]
    assert swells(ring, wide) == (False, False)


def plain_cap(height: float) -> FloatArray:
    """A ball whose cap is turned over within itself: each triangle of it faces down."""
    result, own = BALL.copy(), BALL[:, 2] > height
    result[own, 0] *= -1.0
    return result


def test_patches_that_turned_over() -> None:
    loose: dict[str, Any] = {"edges_share": 1.0, "volume": 9.0}
    (found,) = meter((BALL, FACES), **loose)(BALL, plain_cap(0.8))
    assert found.kind == StrainKind.FLIPS and found.value > found.bound == pytest.approx(0.035)
    assert (BALL[found.vertices, 2] > 0.7).all()
    # A few triangles are a crease, and what is small to the eye is no patch.
    assert meter((BALL, FACES), patch_triangles=200, **loose)(BALL, plain_cap(0.8)) == []
    assert meter((BALL, FACES), patch=0.5, **loose)(BALL, plain_cap(0.8)) == []


def test_a_pocket_that_is_turned_inside_out_is_told_by_the_rest() -> None:
    """As folded as before, it would be taken for a fold that was there before."""
    top = np.exp(-((np.linalg.norm(BALL[:, :2], axis=1) / 0.4) ** 4)) * (BALL[:, 2] > 0.0)
    pocket, other = (BALL * [2.0, 2.0, 0.1] for _ in range(2))
    pocket[:, 2] += 2.0 * top
    other[:, 2] -= 1.5 * top
    parts = ConnectedParts(FACES, np.zeros(len(BALL), dtype=np.int32))
    numbers = StrainOptions(volume=99.0, edges_share=1.0, patch_rolls=0.9)

    def turns(
        rest: FloatArray | None,
        before: FloatArray,
        after: FloatArray,
        crossed: IntArray | None = None,
    ) -> bool:
        found = StrainMeter(parts, rest=rest, options=numbers, crossed=crossed)(before, after)
        return StrainKind.FLIPS in kinds(found)

    assert turns(pocket, pocket, other)
    # A model that crosses itself there does not tell, nor none; and back to the model is no fault.
    assert not turns(None, pocket, other)
    crossed = parts.crossed(np.stack([np.arange(len(FACES))] * 2, axis=1))
    assert not turns(pocket, pocket, other, crossed=crossed)
    assert not turns(other, pocket, other)
    # So much of a part may have rolled.
    numbers = replace(numbers, patch_rolls=0.1)
    assert not turns(pocket, pocket, other)


def test_what_crosses_its_own_part_is_numbered_without_what_has_no_area() -> None:
    faces = np.array([[0, 0, 1], [0, 1, 2], [0, 2, 3], [4, 4, 5], [4, 5, 6], [4, 6, 7]], np.int32)
    parts = ConnectedParts(faces, np.zeros(8, dtype=np.int32))
    # Two of one part, two of different ones, one without area.
    assert parts.crossed(np.array([[4, 5], [1, 4], [0, 2]])).tolist() == [2, 3]
    mesh = elbow(2.0)
    for mode in ("both", "inter"):
        scene = SceneRepairer([Body(*mesh)], options=RepairOptions(mode=mode)).scene
        crossed = scene.strain_meter.crossed
        assert crossed is not None and len(crossed) > 10


def test_what_turns_with_its_surroundings_did_not_turn_over() -> None:
    half = BALL @ np.diag([-1.0, 1.0, -1.0])
    assert meter((BALL, FACES))(BALL, half) == []


def test_a_part_that_is_mostly_inside_out_is_told_however_small() -> None:
    grain = 0.02 * BALL
    mesh = joined((BALL, FACES), (grain + AWAY, FACES))
    turned = mesh[0].copy()
    turned[len(BALL) :] = 0.02 * plain_cap(-0.2) + AWAY
    found = meter(mesh, edges_share=1.0, volume=99.0)(mesh[0], turned)
    assert kinds(found) == {StrainKind.FLIPS} and {excess.part for excess in found} == {1}


def test_measures_do_not_depend_on_the_size_of_a_scene() -> None:
    moved = pinched(BALL, 0.9, 0.05)
    for scale in (2.0**-10, 2.0**13):
        small, large = (
            meter((BALL, FACES))(BALL, moved),
            meter((BALL, FACES))(scale * BALL, scale * moved),
        )
        assert [(e.kind, e.worst) for e in small] == [(e.kind, e.worst) for e in large]
        assert [e.value for e in small] == pytest.approx([e.value for e in large])


def test_degenerate_triangles_are_left_out() -> None:
    faces: IntArray = np.concatenate([FACES, [[0, 0, 1]]]).astype(np.int32)
    assert kinds(meter((BALL, faces))(BALL, BALL * [1.0, 1.0, 1.3])) == {StrainKind.VOLUME}


OFF = np.array([0.8, 0.0, 0.0])


def band_on_an_arm(**values: Any) -> tuple[SceneRepairer, list[FloatArray]]:
    arm, band = tube(24, 40, 0.2, 4.0), torus(48, 12, 0.32, 0.06)
    bodies = [Body(*arm, name="arm"), Body(*band, name="band", **values)]
    return SceneRepairer(bodies), [arm[0], band[0]]


def test_a_band_that_came_off_is_told_and_put_back_on() -> None:
    repairer, (arm, band) = band_on_an_arm()
    assert repairer.strains([arm, band], [arm, band + 0.125 * OFF]) == ()
    (found,) = repairer.strains([arm, band], [arm, band + OFF])
    assert (found.kind, found.body, found.value) == (StrainKind.WORN, "band", 1.0)
    assert found.value > found.bound
    # Some share of such a correction leaves it on.
    scene = repairer.scene
    before = np.concatenate([arm, band])
    after = np.concatenate([arm, band + OFF])
    search = share_search(scene, before, after, ShareOptions())
    kept = search.blend(next(iter(search.shares())))
    assert not scene.strain_meter(before, kept)
    assert (kept[: len(arm)] == arm).all()


def test_a_rigid_band_may_come_off() -> None:
    repairer, (arm, band) = band_on_an_arm(rigid=True)
    assert repairer.strains([arm, band], [arm, band + OFF]) == ()


def test_what_becomes_rigid_may_come_off_then() -> None:
    repairer, (arm, band) = band_on_an_arm()
    scene, before = repairer.scene, np.concatenate([arm, band])
    after = np.concatenate([arm, band + OFF])
    # Whether or not the meter was asked before.
    assert scene.strain_meter(before, after)
    assert with_rigid(scene, [1]).strain_meter(before, after) == []


def test_a_pose_is_measured_once_for_all_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = list[int]()

    def areas(points: FloatArray, faces: IntArray) -> FloatArray:
        asked.append(len(points))
        return vector_areas(points, faces)

    monkeypatch.setattr("dtrepair.repair.strain.meter.vector_areas", areas)
    own, spoilt = meter((BALL, FACES)), pinched(BALL, 0.5, 0.05)
    strict, usual = own(BALL, spoilt, strict=True), own(BALL, spoilt)
    assert kinds(strict) == kinds(usual) != set() and len(asked) == 2
    # Another correction of it, and another input.
    assert own(BALL, BALL + 1e-3) == [] and len(asked) == 3
    assert kinds(own(2.0 * BALL, 2.0 * spoilt)) == kinds(usual) and len(asked) == 5
