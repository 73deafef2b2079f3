"""Triangle pairs: identity, matching, averaging and the harmonic fill."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from dtrepair.numerics.geometry import triangle_normals
from dtrepair.transfer import measure_coverage, register
from dtrepair.transfer.matching.correspondence import (
    HarmonicFill,
    averaging_operator,
    checked_pairs,
    identity_pairs,
    match_triangles,
)
from tests.meshes import Mesh, grid, icosphere, joined, torus
from tests.quadruped import SOURCE, TARGET, markers


def test_identity_pairs_are_every_triangle_with_itself() -> None:
    faces = icosphere(1)[1]
    pairs = identity_pairs(faces, faces.copy())
    assert pairs.dtype == np.int32
    np.testing.assert_array_equal(pairs, np.stack([np.arange(80)] * 2, axis=1))


@pytest.mark.parametrize("other", [icosphere(0)[1], icosphere(1)[1][::-1]])
def test_identity_pairs_refuse_another_topology(other: NDArray[np.int32]) -> None:
    with pytest.raises(ValueError, match=r"same triangles.*give markers"):
        identity_pairs(icosphere(1)[1], other)


@pytest.mark.parametrize("mesh", [icosphere(3), torus(), grid(12, 9)])
def test_a_rest_matches_itself_exactly(mesh: Mesh) -> None:
    points, faces = mesh
    np.testing.assert_array_equal(
        match_triangles(points, faces, points, faces), identity_pairs(faces)
    )


def test_matching_is_the_closest_compatible_centroid_both_ways() -> None:
    rng = np.random.default_rng(3)
    (first, first_faces), (second, second_faces) = icosphere(2), torus(14, 9, 0.9, 0.25)
    first = first + 0.02 * rng.normal(size=first.shape)
    found = match_triangles(
        first, first_faces, second, second_faces, neighbors=len(second_faces) + len(first_faces)
    )
    centroids = first[first_faces].mean(axis=1), second[second_faces].mean(axis=1)
    facing = triangle_normals(first, first_faces) @ triangle_normals(second, second_faces).T > 0
    distances = np.linalg.norm(centroids[0][:, None] - centroids[1][None], axis=2)
    distances[~facing] = np.inf
    expected = {(i, int(distances[i].argmin())) for i in range(len(first_faces))}
    expected |= {(int(distances[:, j].argmin()), j) for j in range(len(second_faces))}
    assert {tuple(pair) for pair in found.tolist()} == expected


def test_normals_that_disagree_do_not_match() -> None:
    points, faces = icosphere(1)
    with pytest.raises(ValueError, match="wound outward"):
        match_triangles(points, faces, points, faces[:, ::-1], neighbors=1)


def test_the_distance_limit_leaves_far_triangles_out() -> None:
    near, far = icosphere(1), icosphere(1)
    target = joined(near, (far[0] + (10.0, 0, 0), far[1]))
    pairs = match_triangles(*near, *target, max_distance=0.5)
    assert pairs[:, 1].max() < len(near[1])
    assert match_triangles(*near, *target)[:, 1].max() >= len(near[1])


def test_matching_checks_its_arguments_and_answers_torch_with_torch() -> None:
    points, faces = icosphere(1)
    with pytest.raises(ValueError, match="neighbors should be at least 1, got 0"):
        match_triangles(points, faces, points, faces, neighbors=0)
    with pytest.raises(ValueError, match="index 41"):
        match_triangles(points, faces, points[:41], faces)
    pairs = match_triangles(*(torch.from_numpy(a) for a in (points, faces, points, faces)))
    assert isinstance(pairs, torch.Tensor)
    np.testing.assert_array_equal(pairs.numpy(), identity_pairs(faces))


def test_registered_animals_are_covered() -> None:
    (source, source_faces), (target, target_faces) = SOURCE.mesh(), TARGET.mesh()
    rows = markers(SOURCE, source, TARGET, target)
    registered = register(source, source_faces, target, target_faces, rows)
    pairs = match_triangles(registered, source_faces, target, target_faces)
    coverage = measure_coverage(pairs, source_faces, target, target_faces)
    assert coverage.unmatched_part < 0.005
    assert coverage.source_used > 0.99
    assert coverage.warnings == ()


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        (np.zeros((3, 3), int), r"shape \(K, 2\)"),
        (np.zeros((0, 2), int), "K > 0"),
        (np.zeros((2, 2)), "integers"),
        (np.array([[0, 0], [5, 0]]), "source triangles 0..4, got index 5 in row 1"),
        (np.array([[0, -1]]), "target triangles 0..7, got index -1 in row 0"),
    ],
)
def test_wrong_pairs_are_refused(pairs: NDArray[Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        checked_pairs(pairs, 5, 8)


def test_pairs_come_back_sorted_and_once() -> None:
    rows = checked_pairs(np.array([[3, 1], [0, 2], [3, 1], [0, 1]]), 5, 8)
    assert rows.tolist() == [[0, 1], [0, 2], [3, 1]]


def test_the_average_leaves_out_unusable_source_triangles() -> None:
    pairs = np.array([[0, 0], [1, 0], [2, 0], [2, 1]], dtype=np.int32)
    average = averaging_operator(pairs, np.array([True, True, False]), 2).toarray()
    np.testing.assert_array_equal(average, [[0.5, 0.5, 0.0], [0.0, 0.0, 0.0]])


def test_the_fill_is_harmonic_and_within_the_bounds_of_its_surroundings() -> None:
    points, faces = icosphere(2)
    matched = points[faces].mean(axis=1)[:, 2] < 0.6
    fill = HarmonicFill(points, faces, matched)
    values = np.random.default_rng(0).normal(size=(int(matched.sum()), 9))
    filled = fill(values)
    everything = np.empty((len(faces), 9))
    everything[matched], everything[~matched] = values, filled
    neighbours: list[list[int]] = [[] for _ in faces]
    edges: dict[frozenset[int], list[int]] = {}
    for triangle, corners in enumerate(faces.tolist()):
        for k in range(3):
            edges.setdefault(frozenset((corners[k], corners[k - 1])), []).append(triangle)
    for first, second in edges.values():
        neighbours[first].append(second)
        neighbours[second].append(first)
    for triangle in np.flatnonzero(~matched).tolist():
        mean = everything[neighbours[triangle]].mean(axis=0)
        np.testing.assert_allclose(everything[triangle], mean, atol=1e-12)
    assert (filled.max(axis=0) <= values.max(axis=0)).all()
    assert (filled.min(axis=0) >= values.min(axis=0)).all()
    np.testing.assert_allclose(fill(np.ones((len(values), 2))), 1.0, atol=1e-13)


def test_a_piece_without_partners_takes_the_value_of_the_nearest_matched_triangle() -> None:
    body, piece = icosphere(1), icosphere(0)
    points, faces = joined(body, (0.1 * piece[0] + (0.0, 0.0, 1.2), piece[1]))
    matched = np.arange(len(faces)) < len(body[1])
    centroids = points[faces].mean(axis=1)
    values = centroids[matched]
    filled = HarmonicFill(points, faces, matched)(values)
    distances = np.linalg.norm(centroids[~matched][:, None] - values[None], axis=2)
    nearest = values[np.unravel_index(distances.argmin(), distances.shape)[1]]
    np.testing.assert_allclose(filled, np.broadcast_to(nearest, filled.shape), atol=1e-12)


def test_the_fill_needs_something_matched() -> None:
    points, faces = icosphere(0)
    with pytest.raises(ValueError, match="no target triangle has a usable source"):
        HarmonicFill(points, faces, np.zeros(len(faces), dtype=bool))
