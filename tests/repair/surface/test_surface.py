"""Surface: operators and masks of a rest pose, units, bodies and what counts as a pair."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.geometry import extent, unique_edges, vector_areas
from dtrepair.numerics.operators import Factor
from dtrepair.repair.surface.surface import BodyRange, Surface, SurfaceOptions
from tests.meshes import (
    Mesh,
    grid,
    icosphere,
    joined,
    overlapping_spheres,
    torus,
)


def two_bodies(mode: str = "both", first: float = 99.0, second: float = 99.0) -> Surface:
    points, faces = overlapping_spheres()
    half = len(points) // 2
    bodies = [BodyRange(0, half, first), BodyRange(half, 2 * half, second)]
    return Surface(points, faces, bodies=bodies, mode=mode)


def sliver_grid() -> Mesh:
    """A grid whose columns crowd: cotangents of both signs before they are clamped."""
    points, faces = grid(12, 12)
    points = points.copy()
    points[:, 0] = points[:, 0] ** 3 + 0.3 * points[:, 1]
    return points, faces


@pytest.mark.parametrize("mesh", [icosphere(), torus(), sliver_grid()])
def test_diffused_fields_obey_the_maximum_principle(mesh: Mesh) -> None:
    surface = Surface(*mesh)
    random = np.random.default_rng(0)
    field = random.random((surface.count, 3)) + 0.1
    smooth = surface.diffuse(field)
    # A^-1 of an M-matrix is non-negative, and A^-1 M 1 = 1 because L 1 = 0.
    assert smooth.min() > 0
    source = field / surface.mass[:, None]
    assert smooth.max() <= source.max() * (1 + 1e-9)
    assert smooth.min() >= source.min() * (1 - 1e-9)


@pytest.mark.parametrize("mesh", [icosphere(), sliver_grid()])
def test_diffusion_keeps_constants_totals_and_symmetry(mesh: Mesh) -> None:
    surface = Surface(*mesh)
    ones = np.ones((surface.count, 1))
    assert np.allclose(surface.diffuse(surface.mass[:, None] * ones), ones, rtol=0, atol=1e-9)
    random = np.random.default_rng(1)
    a, b = random.normal(size=(2, surface.count, 1))
    smooth_a, smooth_b = surface.diffuse(a), surface.diffuse(b)
    assert (surface.mass @ smooth_a)[0] == pytest.approx(a.sum(), abs=1e-9 * np.abs(a).sum())
    assert (b.T @ smooth_a).item() == pytest.approx((a.T @ smooth_b).item(), abs=1e-9)


def test_diffusion_smooths() -> None:
    surface = Surface(*icosphere(3))
    peak = np.zeros((surface.count, 1))
    peak[0] = 1.0
    smooth = surface.diffuse(peak)
    first, second = surface.edges.T
    assert np.argmax(smooth) == 0 and smooth.min() > 0
    assert np.abs(smooth[first] - smooth[second]).max() < 0.2 * smooth.max()


def test_every_body_diffuses_on_its_own_with_its_own_strength() -> None:
    surface = two_bodies(first=1.0, second=1000.0)
    half = surface.count // 2
    field = np.zeros((surface.count, 1))
    field[0] = 1.0
    assert (surface.diffuse(field)[half:] == 0).all()
    field[half] = 1.0
    smooth = surface.diffuse(field)
    assert smooth[:half].max() > 5 * smooth[half:].max()


def test_factors_are_computed_once() -> None:
    surface = two_bodies()
    before = Factor.count
    for _ in range(3):
        surface.diffuse(np.ones((surface.count, 3)))
    assert Factor.count == before + 2
    assert surface.arap_factor is surface.arap_factor
    assert Factor.count == before + 3


@pytest.mark.parametrize("scale", [2.0**-20, 1.0, 2.0**20])
def test_lengths_are_in_units_of_the_size(scale: float) -> None:
    points, faces = torus()
    plain, scaled = Surface(points, faces), Surface(scale * points, faces)
    assert scaled.size == scale * plain.size == scale * extent(points)
    assert np.array_equal(scaled.rest, plain.rest)
    assert scaled.edge_length == plain.edge_length
    assert np.array_equal(scaled.written(plain.rest), np.float32(scale) * plain.written(plain.rest))
    edges = unique_edges(faces)
    lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    assert plain.edge_length * plain.size == pytest.approx(lengths.mean(), rel=1e-12)


def test_a_point_has_size_one() -> None:
    assert Surface(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32)).size == 1.0


def test_vector_areas_of_vertices_sum_to_those_of_triangles() -> None:
    points, faces = sliver_grid()
    surface = Surface(points, faces)
    total = surface.vector_areas(surface.rest).sum(axis=0)
    assert np.allclose(total, vector_areas(surface.rest, faces).sum(axis=0), rtol=0, atol=1e-12)
    closed = Surface(*icosphere())
    flux = closed.vector_areas(closed.rest)
    assert np.abs(flux.sum(axis=0)).max() < 1e-12
    assert (np.einsum("ij,ij->i", flux, closed.rest) > 0).all()


def test_diffused_field_of_a_thin_body_is_finite() -> None:
    points, faces = torus()
    flat = Surface(points * (1.0, 1.0, 1e-9), faces)
    assert np.isfinite(flat.diffuse(np.ones((len(points), 3)))).all()


def test_rings_and_diffusion_reach_as_far_on_finer_skins() -> None:
    fine, reached = SurfaceOptions(usual_edge=0.07), []
    for level in (4, 5):
        points, faces = icosphere(level)
        surface = Surface(points, faces, options=fine)
        finer = fine.usual_edge / surface.edge_length
        assert surface.rings(20) == round(20 * finer) == surface.contacts.ring_distance.limit > 20
        # The motion that forces on one side of an area lead to, and how far it spreads.
        field = np.zeros_like(points)
        field[points[:, 0] > 0.9] = (1.0, 0.0, 0.0)
        smooth = surface.diffuse(field)[:, 0]
        reached.append(float(smooth[points[:, 0] < 0.0].max() / smooth.max()))
    assert np.ptp(reached) < 0.1 * max(reached)
    plain = Surface(points, faces).diffuse(field)[:, 0]
    assert plain[points[:, 0] < 0.0].max() < 0.5 * max(reached) * plain.max()


def test_rings_mean_the_same_to_what_has_several_parts() -> None:
    fine = icosphere(4)
    for level, same in ((3, True), (0, False)):  # of a quarter of the triangles, and of few
        points, faces = icosphere(level)
        both = joined(fine, (points + 3.0, faces))
        assert (Surface(*both, options=SurfaceOptions(usual_edge=0.05)).rings(20) == 20) == same


def test_what_never_moves_does_not_change_how_fine_a_skin_is() -> None:
    fine, floor, options = icosphere(4), icosphere(3), SurfaceOptions(usual_edge=0.05)
    points, faces = joined(fine, (9.0 * floor[0], floor[1]))
    bodies = [BodyRange(0, len(fine[0]), 99.0), BodyRange(len(fine[0]), len(points), 99.0)]
    mobility = np.where(np.arange(len(points)) < len(fine[0]), 1.0, 0.0)
    both = Surface(points, faces, bodies=bodies, mobility=mobility, options=options)
    assert both.fineness == pytest.approx(Surface(*fine, options=options).fineness) and (
        both.fineness > 1.2
    )
    assert Surface(*fine, options=SurfaceOptions(usual_edge=99.0)).rings(20) == 80
