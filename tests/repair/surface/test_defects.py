"""Defects, near and far contacts, contact regions."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csgraph

from dtrepair.intersect.detector import find_intersections
from dtrepair.numerics.geometry import IntArray
from dtrepair.repair.surface.defects import (
    Defects,
    contact_regions,
    find_defects,
    near_contacts,
    update_defects,
)
from dtrepair.repair.surface.surface import Surface
from tests.meshes import armed_body, crossing_tubes, elbow, icosphere, joined, overlapping_spheres


def surface_and_pose(kind: str) -> tuple[Surface, NDArray[np.float64]]:
    poses = {
        "elbow": (elbow(2.4), elbow(0.0)),
        "arm": (armed_body(4.2), armed_body(0.0)),
        "tubes": (crossing_tubes(8, 20), crossing_tubes(8, 20)),
    }
    (points, faces), (rest, _) = poses[kind]
    surface = Surface(rest, faces)
    return surface, points / surface.size


def as_sets(defects: Defects) -> list[set[tuple[int, ...]]]:
    for pairs in defects:
        assert len(np.unique(pairs, axis=0)) == len(pairs)
    return [set(map(tuple, pairs.tolist())) for pairs in defects]


def test_defects_are_the_pairs_and_folds_of_the_written_pose() -> None:
    surface, pose = surface_and_pose("elbow")
    defects = find_defects(surface, pose)
    written = surface.written(pose)
    assert np.array_equal(defects.crossings, find_intersections(written, surface.faces))
    assert np.array_equal(defects.folds, surface.queries.folds(written))
    assert len(defects.crossings) > 0 and len(defects.folds) > 0
    every = np.concatenate([defects.crossings, defects.folds])
    assert defects.rank == (len(defects.crossings), len(every))
    assert np.array_equal(defects.triangles, np.unique(every))


def test_fewer_crossings_rank_before_fewer_folds() -> None:
    one, none = np.array([[0, 5]], np.int32), np.zeros((0, 2), np.int32)
    three = np.array([[0, 5], [1, 5], [2, 5]], np.int32)
    assert Defects(none, three).rank < Defects(one, none).rank < Defects(one, one).rank


@pytest.mark.parametrize("kind", ["elbow", "arm", "tubes"])
@pytest.mark.parametrize("amount", [0.004, 0.03])
def test_updated_defects_are_those_found_anew(kind: str, amount: float) -> None:
    surface, pose = surface_and_pose(kind)
    known = find_defects(surface, pose)
    random = np.random.default_rng(0)
    gone_and_new = 0
    for _ in range(6):
        centre = random.integers(surface.count)
        moved = surface.dilate(np.arange(surface.count) == centre, int(random.integers(1, 5)))
        assert 3 * moved.sum() <= surface.count
        trial = pose + amount * moved[:, None] * random.normal(size=pose.shape)
        updated = as_sets(update_defects(surface, known, trial, moved))
        anew = as_sets(find_defects(surface, trial))
        assert updated == anew
        gone_and_new += sum(len(a ^ b) for a, b in zip(anew, as_sets(known), strict=True))
    assert gone_and_new > 0


def test_moving_most_of_the_mesh_finds_everything_anew() -> None:
    surface, pose = surface_and_pose("arm")
    wrong = Defects(np.zeros((0, 2), np.int32), np.array([[0, 1]], np.int32))
    everything = np.ones(surface.count, dtype=bool)
    assert as_sets(update_defects(surface, wrong, pose, everything)) == as_sets(
        find_defects(surface, pose)
    )


def test_nothing_moved_keeps_the_known_defects() -> None:
    surface, pose = surface_and_pose("elbow")
    known = find_defects(surface, pose)
    still = np.zeros(surface.count, dtype=bool)
    assert as_sets(update_defects(surface, known, pose, still)) == as_sets(known)


def test_a_crease_is_near_and_two_parts_are_far() -> None:
    surface, pose = surface_and_pose("elbow")
    pairs = surface.contacts.pairs(pose)
    assert near_contacts(surface, pairs, 12).mean() > 0.5
    assert near_contacts(surface, pairs, 20).all()
    apart, crossed = surface_and_pose("tubes")
    assert not near_contacts(apart, apart.contacts.pairs(crossed), 20).any()
    # A pair at ring distance r is near from a limit of r on.
    rings = surface.contacts.ring_distance(pairs)
    for limit in range(1, 6):
        assert np.array_equal(near_contacts(surface, pairs, limit), rings <= limit)


def regions_by_graph(
    surface: Surface, pairs: IntArray, buried: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Labels (V,) from the dense graph of the definition; -1 outside."""
    touched = buried.copy()
    touched[surface.faces[pairs].ravel()] = True
    graph = np.zeros((surface.count, surface.count), dtype=bool)
    for i, j in surface.edges:
        graph[i, j] = touched[i] and touched[j]
    for i, j in pairs:
        graph[surface.faces[i, 0], surface.faces[j, 0]] = True
    labels = csgraph.connected_components(graph, directed=False)[1]
    return np.where(touched, labels, -1)


def test_contact_regions_are_connected_through_pairs_and_edges() -> None:
    # Two separate contacts: a small sphere at either end of a pair of crossing tubes.
    ball, ball_faces = icosphere(1, radius=0.25)
    mesh = joined(
        crossing_tubes(8, 20),
        (ball + np.array([0.0, 0.2, 0.95]), ball_faces),
        (ball + np.array([0.95, 0.2, 0.0]), ball_faces),
    )
    surface = Surface(*mesh)
    pairs = surface.contacts.pairs(surface.rest)
    random = np.random.default_rng(0)
    buried = random.random(surface.count) < 0.05
    for mask in (np.zeros(surface.count, dtype=bool), buried):
        number, regions = contact_regions(surface, pairs, mask)
        expected = regions_by_graph(surface, pairs, mask)
        assert np.array_equal(regions < 0, expected < 0)
        used = regions >= 0
        joint = np.unique(np.stack([regions[used], expected[used]]), axis=1)
        assert joint.shape[1] == number == len(np.unique(expected[used]))
        assert set(regions[used]) == set(range(number))
    assert contact_regions(surface, pairs, np.zeros(surface.count, dtype=bool))[0] == 3


def test_no_pairs_make_no_regions() -> None:
    surface = Surface(*overlapping_spheres(1, 3.0))
    none = np.zeros((0, 2), np.int32)
    number, regions = contact_regions(surface, none, np.zeros(surface.count, dtype=bool))
    assert number == 0 and (regions == -1).all()


def test_rest_contacts_can_be_left_alone() -> None:
    points, faces = elbow(2.4)
    surface = Surface(points, faces, leave_rest=True)
    assert find_defects(surface, surface.rest).rank == (0, 0)
    assert find_defects(Surface(points, faces), surface.rest).rank[0] > 0
    # What comes on top still counts.
    further = elbow(2.6)[0] / surface.size
    own, every = find_defects(surface, further), find_defects(Surface(points, faces), further)
    assert 0 < len(own.crossings) < len(every.crossings)
    assert (
        as_sets(own)[1]
        == as_sets(every)[1] - as_sets(find_defects(Surface(points, faces), surface.rest))[1]
    )
