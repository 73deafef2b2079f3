"""Bent edges: their angles, the gradients of these, and the motion that opens them."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.elastic.dihedral_angles import (
    DihedralAngles,
    DihedralOptions,
    angles_and_gradients,
    bent_edges,
)
from dtrepair.repair.surface.surface import Surface
from tests.meshes import grid


def folded(angle: float) -> tuple[Surface, FloatArray]:
    """A sheet of 20 x 20 squares and its pose folded by an angle about its middle line."""
    points, faces = grid(20, 20)
    surface = Surface(points, faces)
    pose = surface.rest - surface.rest.mean(axis=0)
    right = np.maximum(pose[:, 0], 0.0)
    pose[:, 0] = np.minimum(pose[:, 0], 0.0) + np.cos(angle) * right
    pose[:, 2] = np.sin(angle) * right
    return surface, pose


def test_the_angle_is_that_of_the_fold_with_its_sign() -> None:
    for angle in (2.4, -2.4, 0.3):
        surface, pose = folded(angle)
        dihedral = DihedralAngles(surface, surface.rest)
        angles, _ = angles_and_gradients(pose, dihedral.corners)
        along = np.abs(surface.rest[dihedral.corners[:, :2], 0] - surface.rest[:, 0].mean()) < 1e-9
        middle = along.all(axis=1)
        assert middle.sum() == 20
        assert np.allclose(np.abs(angles[middle]), abs(angle))
        assert len({*np.sign(angles[middle])}) == 1
        assert np.allclose(angles[~middle], 0.0, atol=1e-9)
        assert bent_edges(surface, pose).sum() == (
            20 if np.cos(angle) < DihedralOptions.sharp else 0
        )
    assert (
        np.sign(angles_and_gradients(folded(2.4)[1], dihedral.corners)[0]).sum()
        == -np.sign(angles_and_gradients(folded(-2.4)[1], dihedral.corners)[0]).sum()
    )


def test_gradients_agree_with_differences() -> None:
    points = np.random.default_rng(3).normal(size=(4, 3))
    corners = np.array([[0, 1, 2, 3]])
    _, gradients = angles_and_gradients(points, corners)
    for vertex in range(4):
        for axis in range(3):
            turned = []
            for step in (-1e-6, 1e-6):
                moved = points.copy()
                moved[vertex, axis] += step
                turned.append(angles_and_gradients(moved, corners)[0][0])
            assert abs((turned[1] - turned[0]) / 2e-6 - gradients[0, vertex, axis]) < 1e-6
    assert np.abs(gradients).min() > 1e-3
    # Neither moving nor turning all of it changes the angle.
    assert np.allclose(gradients.sum(axis=1), 0.0, atol=1e-12)
    assert np.allclose(np.cross(points, gradients[0]).sum(axis=0), 0.0, atol=1e-12)


def test_opening_moves_little_and_only_what_is_near() -> None:
    surface, pose = folded(2.4)
    dihedral = DihedralAngles(surface, surface.rest)
    (cluster,) = dihedral.clusters(pose)
    assert len(cluster) == dihedral.excess(pose)[0] == 20
    opened = dihedral.cured(pose, cluster, 2)
    assert dihedral.excess(opened)[0] == 0
    far = np.abs(surface.rest[:, 0] - surface.rest[:, 0].mean()) > 3.5 / 20
    assert np.array_equal(opened[far], pose[far])
    assert np.abs(opened - pose).max() < 2.0 * surface.edge_length
    assert dihedral.cured(opened, cluster, 2) is opened


def test_what_the_original_bends_is_left_alone() -> None:
    surface, pose = folded(2.4)
    dihedral = DihedralAngles(surface, pose)
    assert dihedral.allowed == 20 and dihedral.clusters(pose) == []
    assert dihedral.cured(pose, np.flatnonzero(dihedral.given), 2) is pose


def test_triangles_without_area_are_no_trouble() -> None:
    surface, pose = folded(2.4)
    dihedral = DihedralAngles(surface, surface.rest)
    (cluster,) = dihedral.clusters(pose)
    pose[dihedral.corners[cluster[0]]] = pose[dihedral.corners[cluster[0], 0]]
    assert np.isfinite(dihedral.cured(pose, cluster, 2)).all()


def test_edges_that_the_original_bends_less_keep_their_angle() -> None:
    surface, original = folded(1.9)
    dihedral = DihedralAngles(surface, original)
    assert dihedral.allowed == 0
    (cluster,) = dihedral.clusters(folded(2.4)[1])
    opened = dihedral.cured(folded(2.4)[1], cluster, 2)
    angles, _ = angles_and_gradients(opened, dihedral.corners[cluster])
    assert np.all((np.abs(angles) <= 1.9) & (np.abs(angles) > 1.6))
