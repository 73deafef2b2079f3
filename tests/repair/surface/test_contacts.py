"""Contacts of a surface: which pairs and folds count, and what is close."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from dtrepair.intersect.detector import find_intersections
from dtrepair.numerics.geometry import FloatArray, extent, pair_keys
from dtrepair.repair.surface.surface import BodyRange, Surface, SurfaceOptions
from tests.meshes import crossing_tubes, elbow, icosphere, joined, overlapping_spheres, torus


def test_pairs_are_those_of_the_written_coordinates() -> None:
    points, faces = crossing_tubes(8, 20)
    surface = Surface(points, faces)
    expected = find_intersections(surface.written(surface.rest), faces)
    assert len(expected) > 20
    assert np.array_equal(surface.contacts.pairs(surface.rest), expected)
    batch = surface.contacts.batch_pairs(np.stack([surface.rest, surface.rest]))
    assert np.array_equal(batch[batch[:, 0] == 1, 1:], expected)


def test_active_pairs_have_an_active_triangle() -> None:
    points, faces = crossing_tubes(8, 20)
    surface = Surface(points, faces)
    every = surface.contacts.pairs(surface.rest)
    active = np.zeros(len(faces), dtype=bool)
    active[every[::3, 0]] = True
    expected = every[active[every].any(axis=1)]
    assert 0 < len(expected) < len(every)
    assert np.array_equal(surface.contacts.pairs(surface.rest, active=active), expected)


def test_mode_chooses_the_pairs() -> None:
    # Two bodies, the first of which also meets itself.
    crossing = crossing_tubes(8, 20)
    sphere = icosphere(1, radius=0.3)
    points, faces = joined(crossing, (sphere[0] + (0.0, 0.1, 0.0), sphere[1]))
    split = len(crossing[0])
    bodies = [BodyRange(0, split, 99.0), BodyRange(split, len(points), 99.0)]
    found = {
        mode: Surface(points, faces, bodies=bodies, mode=mode).contacts.pairs(
            points / extent(points)
        )
        for mode in ("both", "self", "inter")
    }
    side = faces[:, 0] >= split
    between = side[found["both"][:, 0]] != side[found["both"][:, 1]]
    assert 0 < between.sum() < len(between)
    assert np.array_equal(found["inter"], found["both"][between])
    assert np.array_equal(found["self"], found["both"][~between])


def test_pairs_of_two_fixed_triangles_do_not_count() -> None:
    points, faces = overlapping_spheres()
    mobility = np.ones(len(points))
    mobility[: len(points) // 2] = 0.0
    half_fixed = Surface(points, faces, mobility=mobility)
    assert (
        len(half_fixed.contacts.pairs(half_fixed.rest))
        == len(find_intersections(points, faces))
        > 0
    )
    still = Surface(points, faces, mobility=np.zeros(len(points)))
    assert len(still.contacts.pairs(still.rest)) == 0


def test_pairs_within_a_rigid_body_do_not_count() -> None:
    points, faces = joined(crossing_tubes(8, 20), icosphere(1, radius=0.3))
    split = len(crossing_tubes(8, 20)[0])
    ranges = [(0, split), (split, len(points))]
    free = Surface(points, faces, bodies=[BodyRange(*own, 99.0) for own in ranges])
    whole = [BodyRange(*own, 99.0, rigid=own == ranges[0]) for own in ranges]
    rigid = Surface(points, faces, bodies=whole)
    every, some = free.contacts.pairs(free.rest), rigid.contacts.pairs(rigid.rest)
    within = (faces[every] < split).all(axis=(1, 2))
    assert 0 < within.sum() < len(every)
    assert np.array_equal(some, every[~within])
    assert np.array_equal(rigid.contacts.counts(every), ~within)


def test_what_the_rest_has_is_left_alone() -> None:
    points, faces = overlapping_spheres()
    plain, left = Surface(points, faces), Surface(points, faces, leave_rest=True)
    assert len(plain.contacts.pairs(plain.rest)) > 0 == len(left.contacts.pairs(left.rest))
    moved = left.rest.copy()
    moved[: len(points) // 2, 0] += 0.05
    at_rest = pair_keys(plain.contacts.pairs(plain.rest))
    every = plain.contacts.pairs(moved)
    expected = every[~np.isin(pair_keys(every), at_rest)]
    assert 0 < len(expected) < len(every)
    assert np.array_equal(left.contacts.pairs(moved), expected)


def test_folds_between_fixed_triangles_do_not_count() -> None:
    points, faces = elbow(2.8)
    fixed = Surface(points, faces, mobility=np.zeros(len(points)))
    free = Surface(points, faces)
    assert len(free.contacts.folds(free.rest)) > 0 == len(fixed.contacts.folds(fixed.rest))


def test_neighbours_need_no_clearance() -> None:
    bent, faces = elbow(2.0)
    rest = elbow(0.0)[0]
    near, far = (
        Surface(rest, faces, options=SurfaceOptions(neighbour_rings=rings)) for rings in (2, 12)
    )
    pose = bent / near.size
    found = [len(surface.contacts.close_pairs(pose, 0.02)) for surface in (near, far)]
    assert found[0] > found[1] >= 0


def test_threads_share_one_surface() -> None:
    points, faces = torus(24, 12)
    random = np.random.default_rng(0)
    poses = [points + 0.2 * random.normal(size=points.shape) for _ in range(12)]

    def contacts(surface: Surface, pose: FloatArray) -> list[bytes]:
        found = surface.contacts
        pairs = found.pairs(pose)
        close = found.close_pairs(pose, 0.01)
        return [part.tobytes() for part in (pairs, close, found.ring_distance(pairs))]

    expected = [contacts(Surface(points, faces), pose) for pose in poses]
    shared = Surface(points, faces)
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda pose: contacts(shared, pose), poses)) == expected
