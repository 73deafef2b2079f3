"""Metrics with values known by hand."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.numerics.geometry import diagonal, unique_edges
from dtrepair.numerics.metrics import (
    JitterMeter,
    displacements,
    distortion,
    edge_log_ratio,
    jitter,
    normal_consistency,
    volume,
)
from tests.meshes import grid, icosphere, joined, torus

SPHERE = icosphere(3)
EDGES = unique_edges(SPHERE[1])


def test_displacements_are_relative_to_the_diagonal() -> None:
    points = SPHERE[0]
    moved = points.copy()
    moved[7] += (3.0, 0.0, 4.0)
    found = displacements(points, moved)
    assert found.shape == (len(points),)
    assert found[7] == pytest.approx(5.0 / diagonal(points), rel=1e-12)
    assert (np.delete(found, 7) == 0).all()
    assert displacements(10 * points, 10 * moved) == pytest.approx(found, rel=1e-12)


def test_normals_are_as_consistent_as_the_turn_is_small() -> None:
    points, faces = SPHERE
    c, s = np.cos(0.3), np.sin(0.3)
    turned = points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    assert normal_consistency(points, 3.0 * points + 1.0, faces) == pytest.approx(1.0)
    assert normal_consistency(points, points, faces[:, ::-1]) == pytest.approx(1.0)
    # A mirror turns what it does not flip: a third of the squares lies along its axis.
    mirrored = points * (-1.0, 1.0, 1.0)
    assert normal_consistency(points, mirrored, faces) == pytest.approx(-1.0 / 3.0, abs=1e-3)
    # About an axis normals turn by the sine of their angle to it: two thirds, squared.
    expected = 1.0 - (1.0 - c) * 2.0 / 3.0
    assert normal_consistency(points, turned, faces) == pytest.approx(expected, abs=1e-3)


def test_triangles_without_area_have_no_normal() -> None:
    flat, faces = grid(1, 1)
    closed = np.concatenate([faces, [[0, 0, 1]]]).astype(np.int32)
    assert normal_consistency(flat, flat, closed) == pytest.approx(1.0)
    assert normal_consistency(flat, flat, closed[-1:]) == 1.0


def test_displacements_of_a_point_are_absolute() -> None:
    point = np.zeros((2, 3))
    assert displacements(point, point + np.array([0.0, 2.0, 0.0])).tolist() == [2.0, 2.0]
    assert displacements(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)


def test_rigid_motions_change_no_edge() -> None:
    points = SPHERE[0]
    turned = points[:, [1, 2, 0]] + (5.0, -3.0, 1.0)
    assert edge_log_ratio(points, turned, EDGES) < 1e-12


@pytest.mark.parametrize("factor", [0.5, 1.1, 4.0])
def test_scaling_changes_every_edge_by_its_logarithm(factor: float) -> None:
    points = SPHERE[0]
    found = edge_log_ratio(points, factor * points, EDGES)
    assert found == pytest.approx(abs(np.log(factor)), rel=1e-12)
    assert edge_log_ratio(factor * points, points, EDGES) == pytest.approx(found, rel=1e-12)


def test_edge_change_is_the_root_mean_square() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0]])
    longer = np.array([[0.0, 0, 0], [2, 0, 0], [4, 0, 0]])
    edges = np.array([[0, 1], [1, 2]])
    expected = np.sqrt(np.log(2.0) ** 2 / 2)
    assert edge_log_ratio(points, longer, edges) == pytest.approx(expected, rel=1e-12)


def test_collapsed_edges_are_finite() -> None:
    points = SPHERE[0]
    assert np.isfinite(edge_log_ratio(points, 0 * points, EDGES))
    assert np.isfinite(edge_log_ratio(0 * points, points, EDGES))
    assert edge_log_ratio(0 * points, 0 * points, EDGES) == 0.0
    assert edge_log_ratio(points, points, EDGES[:0]) == 0.0


def test_volumes_converge_and_count_orientation() -> None:
    exact = 4 / 3 * np.pi
    errors = [exact - volume(*icosphere(level)) for level in (1, 2, 3)]
    assert errors[2] > 0
    # Second order: a quarter at each level, within a tenth.
    assert errors[1] / errors[0] == pytest.approx(0.25, rel=0.1)
    assert errors[2] / errors[1] == pytest.approx(0.25, rel=0.1)
    points, faces = SPHERE
    assert volume(points, faces[:, ::-1]) == pytest.approx(-volume(points, faces), rel=1e-12)
    assert volume(points + 1e3, faces) == pytest.approx(volume(points, faces), rel=1e-9)
    assert volume(*torus(128, 64)) == pytest.approx(2 * np.pi**2 * 0.3**2, rel=3e-3)
    both = joined(SPHERE, (points + 5.0, faces))
    assert volume(*both) == pytest.approx(2 * volume(points, faces), rel=1e-9)
    assert volume(*grid(4, 4)) == pytest.approx(0.0, abs=1e-15)


def test_steady_corrections_have_no_jitter() -> None:
    times = np.arange(5.0)[:, None, None]
    before = np.broadcast_to(SPHERE[0], (5, *SPHERE[0].shape))
    moving = before + times * 0.1 + 0.3
    assert jitter(before, moving) < 1e-12
    assert jitter(before[:2], before[:2] + 1.0) == 0.0


def test_jitter_of_one_shaking_vertex() -> None:
    points = SPHERE[0]
    before = np.broadcast_to(points, (3, *points.shape))
    after = before.copy()
    after[1, 4, 0] += 0.5
    # Second difference: -2 x 0.5 at one of V vertices.
    expected = 1.0 / np.sqrt(len(points)) / diagonal(points)
    assert jitter(before, after) == pytest.approx(expected, rel=1e-12)


def test_distortion_is_edge_change_and_displacement() -> None:
    pose, faces = torus()
    edges = unique_edges(faces)
    assert distortion(pose, pose, edges) == 0.0
    turned = pose[:, [1, 2, 0]]
    moved = displacements(pose, turned).mean()
    assert distortion(pose, turned, edges) == pytest.approx(2 * moved, rel=1e-12)
    bigger = 1.5 * pose
    expected = np.log(1.5) + 2 * np.linalg.norm(0.5 * pose, axis=1).mean() / diagonal(pose)
    assert distortion(pose, bigger, edges) == pytest.approx(expected, rel=1e-12)


def measured(before: NDArray[np.float64], after: NDArray[np.float64]) -> float:
    meter = JitterMeter()
    for a, b in zip(before, after, strict=True):
        meter.add(a, b)
    return meter.value


def test_the_running_jitter_is_that_of_the_whole_clip() -> None:
    random = np.random.default_rng(3)
    before = random.normal(size=(7, 20, 3))
    after = before + 0.01 * random.normal(size=before.shape)
    assert measured(before, after) == pytest.approx(jitter(before, after), rel=1e-12)
    assert measured(before, after) > 1e-3


def test_steady_corrections_have_none() -> None:
    before = np.random.default_rng(4).normal(size=(5, 9, 3))
    ramp = np.arange(5)[:, None, None] * np.array([0.1, 0, 0])
    assert measured(before, before + ramp) == pytest.approx(0, abs=1e-14)
    assert measured(before[:2], before[:2] + 1) == 0.0
