"""Laplacians, mass and gradient against analytic values; the factor against its matrix."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.numerics.geometry import triangle_areas
from dtrepair.numerics.operators import (
    Factor,
    cotangent_laplacian,
    gradient_operator,
    lumped_mass,
    uniform_laplacian,
)
from tests import meshes

EQUILATERAL = np.array([[0, 0, 0], [1, 0, 0], [0.5, 3**0.5 / 2, 0]])
ONE_FACE = np.array([[0, 1, 2]], dtype=np.int32)


def test_equilateral_triangle_has_half_the_cotangent_of_sixty_degrees() -> None:
    weight = 0.5 / 3**0.5
    expected = weight * np.array([[2, -1, -1], [-1, 2, -1], [-1, -1, 2]])
    assert np.allclose(cotangent_laplacian(EQUILATERAL, ONE_FACE).toarray(), expected, atol=1e-15)


def test_cotangent_laplacian_is_symmetric_semidefinite_and_kills_constants() -> None:
    points, faces = meshes.bent_tube(2.0)
    laplacian = cotangent_laplacian(points, faces)
    assert abs(laplacian - laplacian.T).max() < 1e-15
    assert np.abs(laplacian @ np.ones(len(points))).max() < 1e-12
    assert (laplacian.diagonal() > 0).all()
    assert np.linalg.eigvalsh(laplacian.toarray()).min() > -1e-12


@pytest.mark.parametrize("last", [(0, 0, 0), (1, 0, 0), (0.3, 0, 0), (2.5, 0, 0)])
def test_cotangent_laplacian_of_a_triangle_without_area_is_semidefinite(
    last: tuple[float, float, float],
) -> None:
    laplacian = cotangent_laplacian(np.array([(0, 0, 0), (1, 0, 0), last], float), ONE_FACE)
    values = np.linalg.eigvalsh(laplacian.toarray())
    assert values.min() > -1e-12 and 0.1 < values.max() < 10.0


def test_linear_functions_are_harmonic_inside_a_flat_grid() -> None:
    points, faces = meshes.grid(6, 5)
    values = cotangent_laplacian(points, faces) @ (points @ [2.0, -3.0, 0.0])
    inside = ((points[:, :2] > 0.01) & (points[:, :2] < 0.99)).all(axis=1)
    assert np.abs(values[inside]).max() < 1e-13
    assert np.abs(values[~inside]).max() > 0.1


def test_laplacian_is_the_weighted_gradient_squared() -> None:
    points, faces = meshes.torus(12, 8)
    gradient = gradient_operator(points, faces)
    areas = sparse.diags(np.repeat(triangle_areas(points, faces), 3))
    difference = gradient.T @ areas @ gradient - cotangent_laplacian(points, faces)
    assert abs(difference).max() < 1e-12


def test_dirichlet_energy_of_the_sphere_converges() -> None:
    # The coordinate z on the unit sphere has the Dirichlet energy 8 pi / 3.
    errors = []
    for level in (2, 3):
        points, faces = meshes.icosphere(level)
        z = points[:, 2]
        errors.append(abs(z @ (cotangent_laplacian(points, faces) @ z) - 8 * np.pi / 3))
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)


def test_clamp_bounds_every_edge_and_keeps_the_maximum_principle() -> None:
    # An obtuse corner has a negative cotangent: the weight of the opposite edge is negative.
    points = np.array([[0, 0, 0], [10, 0, 0], [5, 1, 0.0]])
    assert cotangent_laplacian(points, ONE_FACE)[0, 1] > 0
    clamped = cotangent_laplacian(points, ONE_FACE, clamp=(0.01, 1.0)).toarray()
    weights = -clamped[~np.eye(3, dtype=bool)]
    assert weights.min() == pytest.approx(0.01) and weights.max() <= 1.0
    assert np.abs(clamped.sum(axis=1)).max() < 1e-15


def test_zero_area_triangle_stays_finite() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 0, 0.0]])
    faces = np.array([[0, 1, 2], [0, 3, 1]], dtype=np.int32)
    assert np.isfinite(cotangent_laplacian(points, faces).toarray()).all()
    assert gradient_operator(points, faces).nnz == 0 or not gradient_operator(points, faces).max()
    assert np.isfinite(lumped_mass(points, faces)).all()


def test_uniform_laplacian_counts_neighbours() -> None:
    laplacian = uniform_laplacian(np.array([[0, 1, 2], [1, 3, 2]], dtype=np.int32), 5).toarray()
    assert laplacian.diagonal().tolist() == [2, 3, 3, 2, 0]
    assert laplacian[1].tolist() == [-1, 3, -1, -1, 0]
    assert (laplacian.sum(axis=1) == 0).all()


def test_lumped_mass_has_mean_one_and_a_floor() -> None:
    points, faces = meshes.icosphere(1)
    mass = lumped_mass(points, faces)
    assert mass.mean() == pytest.approx(1, rel=1e-12)
    assert lumped_mass(1e3 * points, faces) == pytest.approx(mass, rel=1e-12)
    with_lone_vertex = lumped_mass(np.vstack([points, [[0, 0, 0]]]), faces, floor=0.25)
    assert with_lone_vertex[:-1] == pytest.approx(mass, rel=1e-12)
    assert with_lone_vertex[-1] == 0.25


def test_mass_of_a_mesh_without_faces_is_the_floor() -> None:
    mass = lumped_mass(np.zeros((3, 3)), np.zeros((0, 3), dtype=np.int32))
    assert mass.tolist() == [1e-2, 1e-2, 1e-2]


def test_gradient_of_a_linear_function_is_its_slope_in_the_plane() -> None:
    points, faces = meshes.grid(4, 3)
    slopes = (gradient_operator(points, faces) @ (points @ [2.0, -3.0, 7.0])).reshape(-1, 3)
    assert np.allclose(slopes, [2.0, -3.0, 0.0], atol=1e-12)


def test_factor_solves_vectors_and_columns() -> None:
    points, faces = meshes.icosphere(2)
    matrix = cotangent_laplacian(points, faces) + sparse.diags(lumped_mass(points, faces))
    factor = Factor(matrix.tocsr())
    wanted = np.random.default_rng(0).normal(size=(len(points), 5))
    assert np.allclose(factor(matrix @ wanted), wanted, atol=1e-10)
    assert np.allclose(factor(matrix @ wanted[:, 0]), wanted[:, 0], atol=1e-10)
    assert factor(matrix @ wanted[:, 0]).shape == (len(points),)


def test_frames_of_a_batch_have_the_bits_that_they_have_alone() -> None:
    points, faces = meshes.icosphere(3)
    matrix = cotangent_laplacian(points, faces) + sparse.diags(lumped_mass(points, faces))
    factor, random = Factor(matrix), np.random.default_rng(0)
    frames = random.normal(size=(7, len(points), 3))
    right: NDArray[np.floating]
    for right in (frames, frames.astype(np.float32)):
        found = factor.solve(right)
        assert found.dtype == np.float64 and found.shape == right.shape
        assert all(np.array_equal(one, factor(own)) for one, own in zip(found, right, strict=True))
        assert np.array_equal(factor.solve(right[2:4]), found[2:4])
        residual = np.stack([matrix @ one for one in found]) - right
        assert np.abs(residual).max() < 1e-12
    assert factor.solve(right[:0]).shape == (0, len(points), 3)
    with pytest.raises(ValueError, match="rows, got"):
        factor.solve(right[:, :-1])


def test_factor_keeps_its_right_hand_side_and_takes_float32_and_strides() -> None:
    factor = Factor(sparse.diags([2.0, 4.0, 8.0]).tocsr())
    rows = np.ones((3, 6), dtype=np.float32)[:, ::2]
    assert np.allclose(factor(rows), [[0.5] * 3, [0.25] * 3, [0.125] * 3])
    assert (rows == 1).all()
    assert np.allclose(
        factor(np.asfortranarray(np.ones((3, 2)))), [[0.5] * 2, [0.25] * 2, [0.125] * 2]
    )


def test_factor_counts_factorisations() -> None:
    before = Factor.count
    factor = Factor(sparse.identity(3, format="csr"))
    factor(np.ones(3))
    factor(np.ones(3))
    assert Factor.count == before + 1


def test_factor_names_what_is_wrong() -> None:
    with pytest.raises(ValueError, match=r"square, got \(2, 3\)"):
        Factor(sparse.csr_matrix(np.ones((2, 3))))
    with pytest.raises(ValueError, match="finite"):
        Factor(sparse.csr_matrix(np.array([[1.0, 0], [0, np.nan]])))
    with pytest.raises(ValueError, match="not positive definite"):
        Factor(sparse.diags([1.0, -1.0]).tocsr())
    with pytest.raises(ValueError, match="3 rows, got"):
        Factor(sparse.identity(3, format="csr"))(np.ones(4))
