"""Seams: where the borders of two meshes lie on each other."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.attached.seams import find_seams, sewn
from dtrepair.numerics.geometry import weld_maps
from tests.meshes import grid, icosphere, joined

# Two sheets side by side, whose edges at x = 1 lie on each other.
LEFT, FACES = grid(4, 4)
RIGHT = LEFT + np.array([1.0, 0.0, 0.0])
POINTS, BOTH = joined((LEFT, FACES), (RIGHT, FACES))
OWNER = np.repeat([0, 1], len(LEFT))


def test_the_border_that_two_meshes_share_is_a_seam() -> None:
    seams = find_seams(POINTS, BOTH, OWNER).vertices
    assert len(seams) == 5
    assert (OWNER[seams] == [0, 1]).all()
    assert np.array_equal(POINTS[seams[:, 0]], POINTS[seams[:, 1]])


def test_what_lies_on_another_mesh_but_not_at_a_border_is_none() -> None:
    ball = icosphere(1)
    points, faces = joined(ball, ball)
    assert len(find_seams(points, faces, np.repeat([0, 1], len(ball[0]))).vertices) == 0


def test_shells_that_end_at_one_place_are_not_sewn() -> None:
    points, faces = joined((LEFT, FACES), (LEFT.copy(), FACES))
    assert len(find_seams(points, faces, np.repeat([0, 1], len(LEFT))).vertices) == 0
    # Nor where three meet: nobody knows which two go on.
    points, faces = joined((LEFT, FACES), (RIGHT, FACES), (RIGHT, FACES))
    assert len(find_seams(points, faces, np.repeat([0, 1, 2], len(LEFT))).vertices) == 0


def test_a_mesh_that_lies_on_seams_with_every_vertex_has_none() -> None:
    gap = np.delete(FACES, 0, axis=0)
    patch = LEFT[FACES[0]], np.array([[0, 1, 2]], dtype=np.int32)
    points, faces = joined((LEFT, gap), patch)
    assert len(find_seams(points, faces, np.repeat([0, 1], [len(LEFT), 3])).vertices) == 0
    assert len(find_seams(points, faces, np.zeros(len(points), dtype=int)).vertices) > 0


def test_a_split_that_rounding_opened_is_a_seam_within_one_mesh() -> None:
    points = POINTS.copy()
    points[len(LEFT) :] += 1e-7
    assert len(find_seams(points, BOTH, np.zeros(len(points), dtype=int)).vertices) == 5
    points[len(LEFT) :] += 1e-5
    assert len(find_seams(points, BOTH, np.zeros(len(points), dtype=int)).vertices) == 0


def test_what_only_rounding_keeps_apart_is_one_point() -> None:
    points, owner = LEFT.copy(), np.zeros(len(LEFT), dtype=int)
    points[6] = points[7] + 1e-7
    assert find_seams(points, FACES, owner).vertices.tolist() == [[6, 7]]
    points[6] = points[7] + 1e-5
    assert len(find_seams(points, FACES, owner).vertices) == 0


def test_small_meshes_are_measured_by_their_own_size() -> None:
    scale, shift = np.repeat([1.0, 1e-3], len(LEFT))[:, None], np.array([1.0, 0.0, 0.0])
    points = np.concatenate([LEFT, 1e-3 * LEFT + shift])
    points[len(LEFT) + 6] = points[len(LEFT) + 7] + 1e-7 * scale[-1]
    assert len(find_seams(points, BOTH, OWNER).vertices) == 1
    points[len(LEFT) + 6] = points[len(LEFT) + 7] + 1e-7
    assert len(find_seams(points, BOTH, OWNER).vertices) == 0


def test_a_stray_vertex_does_not_make_a_mesh_large() -> None:
    points = np.concatenate([POINTS, [[1e6, 0.0, 0.0]]])
    owner = np.append(OWNER, 0)
    assert np.array_equal(
        find_seams(points, BOTH, owner).vertices, find_seams(POINTS, BOTH, OWNER).vertices
    )


def test_seams_across_meshes_can_be_left_out() -> None:
    seams = find_seams(POINTS, BOTH, OWNER)
    assert seams.across(OWNER).all()
    assert len(seams.chosen(~seams.across(OWNER)).vertices) == 0


def test_closed_seams_are_one_and_open_ones_are_two() -> None:
    found = find_seams(POINTS, BOTH, OWNER)
    seams, weld = found.vertices, weld_maps([LEFT, RIGHT])
    whole = sewn(weld, found, POINTS)
    assert (whole[seams[:, 1]] == seams[:, 0]).all()
    assert np.array_equal(np.delete(whole, seams[:, 1]), np.delete(weld, seams[:, 1]))
    pose = POINTS.copy()
    pose[seams[:2, 1]] += 1e-4
    half = sewn(weld, found, pose)
    assert np.array_equal(half[seams[:2, 1]], weld[seams[:2, 1]])
    assert np.array_equal(half[seams[2:, 1]], seams[2:, 0])


def test_three_meshes_that_meet_in_a_point_are_one_there() -> None:
    third = LEFT + np.array([1.0, 1.0, 0.0])
    points, faces = joined((LEFT, FACES), (RIGHT, FACES), (third, FACES))
    owner = np.repeat([0, 1, 2], len(LEFT))
    whole = sewn(weld_maps([LEFT, RIGHT, third]), find_seams(points, faces, owner), points)
    met = np.flatnonzero((points == (1.0, 1.0, 0.0)).all(axis=1))
    assert len(met) == 3 and (whole[met] == met[0]).all()


def test_thousands_of_vertices_at_one_place_are_one_in_no_time() -> None:
    corner = 1e-7 * np.random.default_rng(0).normal(size=(3000, 3))
    points = np.concatenate([LEFT, corner])
    faces = np.concatenate([FACES, len(LEFT) + np.arange(3000).reshape(-1, 3)]).astype(np.int32)
    seams = find_seams(points, faces, np.zeros(len(points), dtype=int))
    assert len(seams.vertices) < 10 * len(points)
    whole = sewn(np.arange(len(points), dtype=np.int32), seams, points)
    assert len(np.unique(whole[len(LEFT) :])) == 1


def test_a_mesh_without_faces_has_none() -> None:
    none = np.zeros((0, 3), dtype=np.int32)
    assert len(find_seams(np.zeros((0, 3)), none, np.zeros(0, dtype=int)).vertices) == 0
    assert len(find_seams(LEFT, none, np.zeros(len(LEFT), dtype=int)).vertices) == 0
