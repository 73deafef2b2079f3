"""Deformation gradients as one sparse operator."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtrepair.transfer.gradients import (
    deformation_operator,
    degenerate_triangles,
    scaled_normals,
    stacked,
)
from tests.meshes import icosphere


def gradients(
    points: NDArray[np.float64], faces: NDArray[np.int32], pose: NDArray[np.float64]
) -> NDArray[np.float64]:
    operator = deformation_operator(points, faces, degenerate_triangles(points, faces))
    columns = (operator @ stacked(pose, faces)).reshape(-1, 3, 3)
    return np.swapaxes(columns, 1, 2)


def test_the_scaled_normal_scales_as_an_edge_and_has_the_root_of_the_double_area() -> None:
    points, faces = icosphere(1)
    once, twice = scaled_normals(points, faces), scaled_normals(2.0 * points, faces)
    np.testing.assert_allclose(twice, 2.0 * once, rtol=1e-14)
    corner = np.array([[0.0, 0, 0], [3, 0, 0], [0, 3, 0]])
    triangle = np.array([[0, 1, 2]], dtype=np.int32)
    np.testing.assert_allclose(scaled_normals(corner, triangle), [[0, 0, 3.0]], rtol=1e-15)


def test_a_similarity_is_the_gradient_of_every_triangle() -> None:
    points, faces = icosphere(1)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    pose = 2.5 * points @ turn.T + (1e3, -2e3, 5e2)
    expected = np.broadcast_to(2.5 * turn, (len(faces), 3, 3))
    np.testing.assert_allclose(gradients(points, faces, pose), expected, atol=1e-11)


def test_a_linear_map_is_met_in_the_plane_and_the_normal_follows_the_pose() -> None:
    points, faces = icosphere(1)
    shear = np.array([[1.0, 0.3, 0.0], [0.0, 1.2, 0.1], [0.2, 0.0, 0.9]])
    found = gradients(points, faces, points @ shear.T)
    edges = points[faces[:, 1:]] - points[faces[:, :1]]
    carried = np.einsum("tij,tkj->tki", found, edges)
    np.testing.assert_allclose(carried, edges @ shear.T, atol=1e-13)
    normals = np.einsum("tij,tj->ti", found, scaled_normals(points, faces))
    np.testing.assert_allclose(normals, scaled_normals(points @ shear.T, faces), atol=1e-13)


def test_triangles_are_degenerate_by_height_over_longest_edge() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 2e-6, 0], [0.5, 5e-7, 0], [0.5, 0, 0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 0, 1]], dtype=np.int32)
    for scale in (1e-6, 1.0, 1e6):
        mask = degenerate_triangles(scale * points, faces)
        assert mask.tolist() == [False, True, True, True]


def test_degenerate_triangles_have_zero_rows() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0, 0]])
    faces = np.array([[0, 1, 3], [0, 1, 2]], dtype=np.int32)
    operator = deformation_operator(points, faces, degenerate_triangles(points, faces))
    assert operator.shape == (6, 6)
    assert abs(operator[:3]).sum() == 0.0
    assert abs(operator[3:]).sum() > 0.0
