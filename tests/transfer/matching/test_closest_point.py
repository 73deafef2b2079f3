"""Closest points of triangles and of surfaces with agreeing normals."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.closest_point import closest_on_triangles
from dtrepair.transfer.matching.closest_point import ClosestSurface
from tests.meshes import icosphere


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((0.2, 0.2, 3.0), (0.2, 0.2, 0.0)),  # face
        ((0.5, -2.0, 1.0), (0.5, 0.0, 0.0)),  # edge ab
        ((-1.0, 0.25, 1.0), (0.0, 0.25, 0.0)),  # edge ca
        ((1.0, 1.0, 0.0), (0.5, 0.5, 0.0)),  # edge bc
        ((-1.0, -1.0, 1.0), (0.0, 0.0, 0.0)),  # corner a
        ((3.0, -0.5, 0.0), (1.0, 0.0, 0.0)),  # corner b
        ((-0.5, 3.0, 0.0), (0.0, 1.0, 0.0)),  # corner c
    ],
)
def test_every_region_of_a_triangle(
    point: tuple[float, float, float], expected: tuple[float, float, float]
) -> None:
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    found = closest_on_triangles(np.array([point]), corners)
    np.testing.assert_allclose(found, [expected], atol=1e-15)


def test_no_sample_of_the_triangle_is_closer() -> None:
    rng = np.random.default_rng(0)
    points, corners = rng.normal(size=(200, 3)), rng.normal(size=(200, 3, 3))
    corners[:20, 2] = 0.5 * (corners[:20, 0] + corners[:20, 1])  # no area
    found = closest_on_triangles(points, corners)
    best = np.linalg.norm(found - points, axis=1)
    weights = rng.dirichlet(np.ones(3), size=500)
    samples = np.einsum("sk,tkj->tsj", weights, corners)
    others = np.linalg.norm(samples - points[:, None], axis=2).min(axis=1)
    assert (best <= others + 1e-12).all()
    assert (others - best).mean() < 0.05


def test_the_closest_compatible_point_of_a_sphere_is_the_projection() -> None:
    points, faces = icosphere(3)
    queries = 1.3 * icosphere(1)[0]
    found, valid = ClosestSurface(points, faces, 16)(queries, queries)
    assert valid.all()
    np.testing.assert_allclose(found, queries / 1.3, atol=5e-3)


def test_queries_that_face_the_other_way_have_no_closest_point() -> None:
    points, faces = icosphere(3)
    queries = 1.3 * icosphere(1)[0]
    assert not ClosestSurface(points, faces, 4)(queries, -queries)[1].any()
    with pytest.raises(ValueError, match="neighbors should be at least 1"):
        ClosestSurface(points, faces, 0)
