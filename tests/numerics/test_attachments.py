"""Modelled contacts: zones around overlaps of a reference pose, whole parts, two hops, ties."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attached.attachment_options import AttachmentOptions
from dtrepair.numerics.attached.overlaps import find_attachments
from dtrepair.numerics.attachments import MOST_WORDS, NO_TIES, Attachments, Reference
from dtrepair.numerics.geometry import FloatArray, IntArray
from tests.measures.modelled_zones import attach
from tests.measures.surfaces import make_surface
from tests.meshes import Mesh, grid, icosphere, joined, tube


def moved(mesh: Mesh, offset: tuple[float, float, float], scale: float = 1.0) -> Mesh:
    return scale * mesh[0] + offset, mesh[1]


def pairs_of(mesh: Mesh) -> IntArray:
    return Detector(*mesh)(mesh[0])


def attached(mesh: Mesh, **values: Any) -> Attachments:
    points, faces = mesh
    reference = Reference(points, pairs_of(mesh))
    return find_attachments(faces, len(points), [reference], options=AttachmentOptions(**values))


def sleeve(far: float = 0.0) -> tuple[Mesh, int]:
    """Two tubes end to end that overlap, and a third that is `far` from the first one's far end."""
    first, second = tube(12, 40, 0.2, 4.0), tube(12, 40, 0.23, 4.0)
    third = moved(tube(12, 10, 0.1, 1.0), (0.0, 0.0, -2.4 - far))
    return joined(first, moved(second, (0.05, 0.01, 3.7)), third), len(first[1])


def test_an_overlap_is_modelled_near_where_the_parts_meet_and_a_fault_elsewhere() -> None:
    mesh, count = sleeve(far=1.0)
    found = attached(mesh)
    assert found.pairs_of_parts == [(0, 1)]
    assert found.modelled(pairs_of(mesh)).all()
    # Were the far end of one led into the other, that would be a fault.
    far_of_first = int(np.argmin(mesh[0][mesh[1][:count]].mean(axis=1)[:, 2]))
    far_of_second = count + int(np.argmax(mesh[0][mesh[1][count : 2 * count]].mean(axis=1)[:, 2]))
    near_of_first = int(np.argmax(mesh[0][mesh[1][:count]].mean(axis=1)[:, 2]))
    asked = np.array([[far_of_first, far_of_second], [near_of_first, far_of_second]])
    assert not found.modelled(asked).any()


def test_zones_grow_with_the_overlap() -> None:
    mesh, _ = sleeve(far=1.0)
    small, large = (attached(mesh, reach=reach).triangles.sum() for reach in (0.5, 4.0))
    assert 0 < small < large


def test_contacts_of_a_part_with_itself_are_faults() -> None:
    from tests.meshes import bent_tube

    mesh = bent_tube(6.5)
    assert len(pairs_of(mesh))
    found = attached(mesh)
    assert found.pairs_of_parts == [] and not found.modelled(pairs_of(mesh)).any()


def test_a_small_part_that_is_mostly_inside_is_attached_as_a_whole() -> None:
    head, eye = icosphere(3), moved(icosphere(1), (0.0, 0.0, 0.9), 0.2)
    mesh = joined(head, eye)
    found = attached(mesh)
    eye_triangles = np.arange(len(head[1]), len(mesh[1]))
    assert found.triangles[eye_triangles].all()
    height = head[0][head[1]][:, :, 2].max(axis=1)
    # What holds it may meet any of it within the longest side of the eye, not at the neck.
    for beside, modelled in ((height > 0.92, True), (height < 0.5, False)):
        across = np.stack(
            np.broadcast_arrays(np.flatnonzero(beside)[:, None], eye_triangles), axis=-1
        )
        assert (found.modelled(across.reshape(-1, 2)) == modelled).all()
    # Half out is not mostly inside.
    mesh = joined(head, moved(icosphere(1), (0.0, 0.0, 1.15), 0.2))
    assert not attached(mesh).triangles[eye_triangles].all()


def test_what_is_small_by_area_is_attached_as_a_whole_however_fine_it_is() -> None:
    head, eye = icosphere(1), moved(icosphere(3), (0.0, 0.0, 0.85), 0.2)
    found = attached(joined(head, eye))
    assert found.triangles[len(head[1]) :].all() and found.pairs_of_parts == [(0, 1)]


@pytest.mark.parametrize("copied", [(0.37, 0.21, 0.11), (-0.3, 0.0, 0.1)])
def test_of_two_copies_none_is_attached_as_a_whole(copied: tuple[float, float, float]) -> None:
    found = attached(joined(icosphere(2), moved(icosphere(2), copied)))
    assert found.pairs_of_parts == [(0, 1)] and not found.triangles.all()


def test_two_parts_on_the_same_host_may_meet_there() -> None:
    host = tube(12, 40, 0.3, 4.0)
    first = moved(tube(12, 6, 0.35, 0.6), (0.0, 0.02, 0.0))
    second = moved(tube(12, 6, 0.36, 0.6), (0.01, 0.0, 0.75))
    mesh = joined(host, first, second)
    # Cuffs whose rims cut into the host.
    points = mesh[0].copy()
    middle = len(host[0]) + len(first[0])
    for own in (slice(len(host[0]), middle), slice(middle, len(points))):
        rim = np.abs(points[own, 2] - points[own, 2].mean()) > 0.29
        points[own][rim, :2] *= 0.7
    found = attached((points, mesh[1]))
    assert found.pairs_of_parts == [(0, 1), (0, 2)]
    count, size = len(host[1]), len(first[1])
    one, other = np.arange(count, count + size), np.arange(count + size, count + 2 * size)
    meeting = np.stack([np.repeat(one, 4), np.tile(other[:4], size)], axis=1)
    assert found.modelled(meeting.astype(np.int32)).any()


def ties_hold(found: Attachments, points: FloatArray, faces: IntArray) -> NDArray[np.float64]:
    """Distance of each tied vertex to where it is tied, in a pose."""
    vertices, triangles, weights, _ = found.ties
    there = np.einsum("ik,ikj->ij", weights, points[faces[triangles]])
    return np.asarray(np.linalg.norm(points[vertices] - there, axis=1))


def test_ties_join_what_overlaps_and_sum_to_one() -> None:
    mesh, _ = sleeve(far=1.0)
    found = attached(mesh)
    assert len(found.ties.vertices)
    assert found.ties.weights.sum(axis=1) == pytest.approx(1.0)
    assert (found.ties.weights >= 0.0).all()
    parts = found.part_of
    of_vertex = np.zeros(len(mesh[0]), dtype=np.int32)
    of_vertex[mesh[1]] = parts[:, None]
    assert (of_vertex[found.ties.vertices] != parts[found.ties.triangles]).all()
    # The tubes differ by 0.03 in radius and are shifted by 0.03 at most.
    assert ties_hold(found, *mesh).max() < 0.25


def test_a_mesh_of_some_of_the_triangles_knows_the_same_contacts() -> None:
    mesh, count = sleeve(far=1.0)
    found, pairs = attached(mesh), pairs_of(mesh)
    kept = np.setdiff1d(np.arange(len(mesh[1])), [0, 5, count + 3]).astype(np.int32)
    fewer = found.of_triangles(kept, np.arange(len(mesh[0])))
    there = np.isin(pairs, kept).all(axis=1)
    numbered = np.searchsorted(kept, pairs[there])
    assert (fewer.modelled(numbered) == found.modelled(pairs[there])).all()
    assert len(fewer.ties.vertices) <= len(found.ties.vertices)


def test_without_references_nothing_is_modelled() -> None:
    mesh, _ = sleeve()
    found = find_attachments(mesh[1], len(mesh[0]), [])
    assert not found.modelled(pairs_of(mesh)).any() and not found.triangles.any()


def test_zones_end_within_the_reach_or_a_few_edges() -> None:
    mesh, _ = sleeve(far=1.0)
    near, usual, wide = (attached(mesh, reach=4.0, rings=n).triangles for n in (0, 3, 99))
    assert near.sum() < wide.sum() and not (near & ~wide).any()
    # Here the reach is more than three edges.
    assert (usual == near).all()


@pytest.mark.parametrize("first", [tube(8, 4, 0.3, 1.0), icosphere(2, 0.3)], ids=["open", "closed"])
def test_zones_lie_within_those_of_an_independent_measure(first: Mesh) -> None:
    # What counts as modelled and is none would be left, and called clean.
    ball, of_ball = icosphere(3, 1.0)
    rng, met = np.random.default_rng(0), 0
    for turn in Rotation.random(40, random_state=0):
        flat, size, out, height = rng.uniform([0.1, 0.05, 0.3, -0.5], [1.0, 0.35, 0.6, 0.5])
        second = size * turn.apply(ball * [1.0, 1.0, flat]) + [out, 0.01, height]
        points, faces = joined(first, (second, of_ball))
        surface = make_surface(points, faces.astype(np.int64))
        pairs = pairs_of((points, faces)).astype(np.int64)
        known = np.zeros(len(faces), dtype=bool)
        for own in attach(surface, points[surface.point_of], pairs):
            known |= own.sides[0].zone | own.sides[1].zone
        found = attached((points, faces)).triangles
        assert not (found & ~known).any()
        assert found.any() == known.any() == bool(len(pairs))
        met += bool(len(pairs))
    assert met > 10


def cape(inside_out: bool) -> Mesh:
    """A trunk, and a sheet behind it whose upper rim is sunk in it."""
    sheet, faces = grid(16, 40, 1.0)
    across, along = sheet[:, 0] - sheet[:, 0].mean(), sheet[:, 1] - sheet[:, 1].mean()
    down = 2.0 * along / np.ptp(along)
    points = np.stack([0.8 * across, np.where(down > 0.85, -0.15, -0.3), down], axis=1)
    return joined(tube(24, 40, 0.2, 2.4), (points, faces[:, [0, 2, 1]] if inside_out else faces))


@pytest.mark.parametrize("inside_out", [False, True])
def test_a_body_is_not_attached_to_its_cape_all_over(inside_out: bool) -> None:
    mesh = cape(inside_out)
    found = attached(mesh)
    assert found.pairs_of_parts == [(0, 1)]
    assert not whole_length(mesh[0], found)
    # What a tube encloses is attached to it, as an arm in its sleeve.
    trunk, collar = tube(24, 40, 0.2, 2.4), tube(24, 24, 0.25, 1.2)
    around = joined(trunk, collar)
    rim = len(trunk[0]) + np.flatnonzero(collar[0][:, 2] > 0.55)
    around[0][rim, :2] *= 0.6
    assert whole_length(around[0], attached(around))


def whole_length(points: FloatArray, found: Attachments) -> bool:
    """Whether ties of the trunk lie far below the sunken rim."""
    own = points[found.ties.vertices[found.part_of[found.ties.triangles] == 1]]
    assert (own[:, 2] > 0.3).any()
    return bool((own[:, 2] < -0.3).any())


def skirted(flare: float) -> tuple[Mesh, int]:
    """A body, and an open skirt that cuts into its waist and stands off by `flare` at the hem."""
    body, (points, faces) = tube(16, 120, 0.2, 6.0), tube(16, 40, 0.2, 2.0)
    down = (1.0 - points[:, 2]) / 2.0
    wide = 0.995 + np.where(down < 0.1, 0.0, 0.01 + flare / 0.2 * (down - 0.1) / 0.9)
    turned = np.pi / 16  # so that edges of one do not lie over edges of the other
    x, y = points[:, 0] * wide, points[:, 1] * wide
    skirt = np.stack(
        [
            x * np.cos(turned) - y * np.sin(turned),
            x * np.sin(turned) + y * np.cos(turned),
            points[:, 2],
        ],
        axis=1,
    )
    return joined(body, (skirt, faces)), len(body[0])


@pytest.mark.parametrize("flare", [0.02, 0.05, 0.1, 0.3])
def test_a_skirt_holds_on_to_the_waist_and_not_to_the_knees(flare: float) -> None:
    """Its winding number is above a half around all of them."""
    mesh, _ = skirted(flare)
    height = mesh[0][attached(mesh).ties.vertices][:, 2]
    assert height.max() > 0.9 and height.min() > 0.2


def test_tights_lie_on_all_of_the_leg() -> None:
    mesh, count = skirted(0.0)
    own = attached(mesh).ties.vertices
    assert mesh[0][own[own < count]][:, 2].min() < -0.5


@pytest.mark.parametrize("covered", [0.0, 0.75])
def test_a_leg_that_grazes_its_robe_may_not_come_out_of_it_elsewhere(covered: float) -> None:
    leg, robe = icosphere(4), tube(32, 40, 0.5, 2.0)
    mesh = joined((leg[0] * [0.2, 0.2, 0.8] + [0.31, 0.0, 0.0], leg[1]), robe)
    found = attached(mesh, covered=covered)
    assert found.modelled(pairs_of(mesh)).all()
    height = mesh[0][mesh[1]].mean(axis=1)[:, 2]
    knee, hem = (
        np.flatnonzero((height < -0.5) & (found.part_of == part) & (height > -0.7))
        for part in (0, 1)
    )
    hem = hem[mesh[0][mesh[1][hem]][:, :, 0].min(axis=1) > 0.3]
    across = np.stack([np.resize(knee, len(hem)), hem], axis=1)
    # What is attached as a whole may go anywhere within its length, as an eye in its head.
    assert found.modelled(across).all() == (covered == 0.0)
    assert found.modelled(across).any() == (covered == 0.0)
    held = len(attached(mesh).ties.vertices)
    assert 0 < held < len(attached(mesh, hangs=1.0).ties.vertices)


@pytest.mark.parametrize("depth", [0.9, 0.85])
def test_an_eye_in_a_head_that_is_open_at_the_neck_is_attached_as_a_whole(depth: float) -> None:
    points, faces = icosphere(3)
    head = points, faces[(points[faces][:, :, 2] > -0.6).all(axis=1)]
    found = attached(joined(head, moved(icosphere(2), (0.0, 0.0, depth), 0.2)))
    eye = np.flatnonzero(found.part_of == found.part_of[-1])
    near = np.full_like(eye, np.argmax(head[0][head[1]][:, :, 2].min(axis=1)))
    assert found.modelled(np.stack([near, eye], axis=1)).all()


def modelled_one_by_one(known: Attachments, pair: tuple[int, int]) -> bool:
    """The definition, of sets: both in the zones of the same two parts, or of a common third."""
    towards = dict[int, set[int]]()
    for key in known.zones.tolist():
        towards.setdefault(key // known.count, set()).add(key % known.count)
    first, second = (towards.get(triangle, set()) for triangle in pair)
    a, b = (int(known.part_of[triangle]) for triangle in pair)
    if b in first and a in second:
        return True
    told = min(a, b) * known.count + max(a, b) in known.by_third
    return a != b and told and bool(first & second)


@pytest.mark.parametrize("count", [2, 7, 140, 64 * MOST_WORDS, 64 * MOST_WORDS + 1])
def test_modelled_pairs_are_those_of_the_definition(count: int) -> None:
    random = np.random.default_rng(count)
    for _ in range(20):
        part_of = random.integers(0, count, 60).astype(np.int32)
        part_of[0] = count - 1
        # Of many parts only few towards which there are zones: else they never agree.
        hosts = random.choice(count, min(count, 4), replace=False)
        zones = random.integers(0, 60, 90) * count + random.choice(hosts, 90)
        # A third part tells of most pairs of the parts.
        both = np.argwhere(np.triu(random.random((count, count)) < 0.8, k=1))
        third = both @ np.array([count, 1])
        known = Attachments(part_of, np.unique(zones), NO_TIES, by_third=third)
        pairs = random.integers(0, 60, (200, 2))
        expected = [modelled_one_by_one(known, (int(a), int(b))) for a, b in pairs]
        assert np.array_equal(known.modelled(pairs), expected) and 0 < sum(expected) < 200
