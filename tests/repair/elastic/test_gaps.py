"""Gaps: nearest points, what a vertex faces, and steps that do not close them."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.elastic.arap import ArapSystem
from dtrepair.repair.elastic.contact_step import step_with_gaps
from dtrepair.repair.elastic.gaps import GapOptions, Gaps
from dtrepair.repair.surface.defects import Defects
from dtrepair.repair.surface.surface import BodyRange, Surface
from tests.meshes import Mesh, grid, icosphere, torus

NONE = np.zeros((0, 2), dtype=np.int32)


def two_spheres(distance: float) -> Mesh:
    points, faces = icosphere(3)
    both = np.concatenate([points, points + np.array([distance, 0.0, 0.0])])
    return both, np.concatenate([faces, faces + len(points)])


def gaps_of(surface: Surface) -> Gaps:
    return Gaps(surface, np.ones(surface.count))


def add_facing(gaps: Gaps, surface: Surface, radius: float) -> NDArray[np.int64]:
    """Add the gaps of a surface that is about to stay where it is."""
    areas = surface.vector_areas(surface.rest)
    return gaps.add_facing(surface.rest, areas, np.zeros_like(areas), radius)


def sampled_distance(first: FloatArray, second: FloatArray) -> float:
    """Least distance of two triangles (3, 3) over a fine grid of weights: never too small."""
    steps = np.linspace(0.0, 1.0, 41)
    weights = np.array([(1 - u - v, u, v) for u, v in product(steps, steps) if u + v <= 1 + 1e-9])
    offsets = (weights @ first)[:, None] - (weights @ second)[None]
    return float(np.linalg.norm(offsets, axis=2).min())


def test_nearest_points_are_as_near_as_any() -> None:
    random = np.random.default_rng(0)
    faces = np.arange(12, dtype=np.int32).reshape(4, 3)
    surface = Surface(random.normal(size=(12, 3)), faces)
    gaps = gaps_of(surface)
    gaps.add_defects(Defects(np.array([(i, j) for i in range(4) for j in range(i)], "i4"), NONE))
    apart = np.repeat(2.0 * np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1.0)]), 3, axis=0)
    for _ in range(5):
        points = random.normal(size=(12, 3)) + 2.0 * apart
        first, second, vectors = gaps._nearest(points)
        for corners, u, v, vector in zip(gaps.corners, first, second, vectors, strict=True):
            assert u.sum() == pytest.approx(1.0) and v.sum() == pytest.approx(1.0)
            assert min(u.min(), v.min()) > -1e-12
            one, other = points[corners[:3]], points[corners[3:]]
            assert np.allclose(u @ one - v @ other, vector, atol=1e-12)
            sampled = sampled_distance(one, other)
            assert sampled - 0.15 < np.linalg.norm(vector) <= sampled + 1e-12


def test_vertices_face_the_other_sphere_and_never_their_own() -> None:
    points, faces = two_spheres(2.1)
    surface = Surface(points, faces)
    gaps = gaps_of(surface)
    keys = add_facing(gaps, surface, 0.5 / surface.size)
    half = surface.count // 2
    assert len(keys) == len(gaps) > 20
    assert ((gaps.corners[:, 0] < half) != (gaps.corners[:, 3] < half)).all()
    # All are on the side towards the other sphere.
    assert (points[gaps.corners[:, 0][gaps.corners[:, 0] < half], 0] > 0.5).all()
    # Nothing is within a shorter reach, and nothing is in front of a lone sphere.
    assert len(add_facing(gaps_of(surface), surface, 0.05 / surface.size)) == 0
    alone = Surface(*icosphere(3))
    assert len(add_facing(gaps_of(alone), alone, 9.0)) == 0


def test_vertices_that_go_back_do_not_look() -> None:
    surface = Surface(*two_spheres(2.1))
    half, radius = surface.count // 2, 0.5 / surface.size
    areas, leaving = surface.vector_areas(surface.rest), np.zeros_like(surface.rest)
    leaving[:half, 0] = -0.2 * radius
    gaps = gaps_of(surface)
    gaps.add_facing(surface.rest, areas, leaving, radius)
    # The other sphere, which stays, still looks.
    assert len(gaps) > 10 and (gaps.corners[:, 0] >= half).all()
    # A little way back does not count, nor does a way ahead.
    both = len(add_facing(gaps_of(surface), surface, radius))
    for factor in (0.25, -1.0):
        assert (
            len(gaps_of(surface).add_facing(surface.rest, areas, factor * leaving, radius)) == both
        )


def test_contacts_that_do_not_count_have_no_gaps() -> None:
    points, faces = two_spheres(2.1)
    half = len(points) // 2
    bodies = [BodyRange(0, half, 99.0), BodyRange(half, 2 * half, 99.0)]
    for mode, some in (("self", False), ("inter", True)):
        surface = Surface(points, faces, bodies=bodies, mode=mode)
        assert (len(add_facing(gaps_of(surface), surface, 1.0)) > 0) == some


def test_folds_have_gaps_of_their_free_edges() -> None:
    # Two triangles at one vertex, leaves over each other.
    points = np.array([(0, 0, 0), (1, -1, 0), (1, 1, 0), (1, -1, 0.3), (1, 1, 0.3)], dtype=float)
    surface = Surface(points, np.array([(0, 1, 2), (0, 3, 4)], dtype=np.int32))
    gaps = gaps_of(surface)
    gaps.add_defects(Defects(NONE, np.array([(0, 1)], dtype=np.int32)))
    assert len(gaps) == 2
    gaps.linearise(points)
    assert (gaps.width(points) > 0.2).all()


def test_linearised_widths_are_distances_and_least_widths_are_smaller() -> None:
    surface = Surface(*two_spheres(2.1))
    gaps = gaps_of(surface)
    add_facing(gaps, surface, 0.2)
    gaps.linearise(surface.rest)
    widths = gaps.width(surface.rest)
    nearest = np.linalg.norm(gaps._nearest(surface.rest)[2], axis=1)
    assert np.allclose(widths, nearest, atol=1e-12)
    assert np.allclose(
        gaps.least, np.maximum(GapOptions.margin, GapOptions.shrink * nearest), atol=1e-12
    )
    # The second sphere moved away along the axis: every gap opens by the part along its normal.
    moved = surface.rest + (np.arange(surface.count) >= surface.count // 2)[:, None] * [0.1, 0, 0]
    assert (gaps.width(moved) - widths > 0).all()
    assert (gaps.width(moved) - widths <= 0.1 + 1e-12).all()
    # Forces and widths are transposes of each other.
    forces, pose = np.random.default_rng(0).random(len(gaps)), surface.rest**2
    assert np.vdot(gaps.spread(forces), pose) == pytest.approx(forces @ gaps.width(pose))


def test_gaps_seen_again_get_stiffer_and_soften_later() -> None:
    surface = Surface(*torus(16, 8))
    gaps = gaps_of(surface)
    found = Defects(np.array([(0, 100), (3, 120)], dtype=np.int32), NONE)
    gaps.add_defects(found)
    gaps.linearise(surface.rest)
    once = gaps.stiffness.copy()
    gaps.add_defects(found)
    assert len(gaps) == 2
    gaps.linearise(surface.rest)
    assert np.allclose(gaps.stiffness, GapOptions.stiffening * once)
    gaps.soften()
    gaps.linearise(surface.rest)
    assert np.allclose(gaps.stiffness, once)
    gaps.keep(np.array([False, True]))
    assert len(gaps) == 1


def test_a_step_keeps_gaps_open_and_pushes_both_sides() -> None:
    surface = Surface(*two_spheres(2.1))
    half = surface.count // 2
    # The original of the step: the spheres overlap by a tenth of their radius.
    target = surface.rest.copy()
    target[half:, 0] -= 0.2 / surface.size
    system = ArapSystem(surface, target)
    right = system.target(surface.rest)
    gaps = gaps_of(surface)
    add_facing(gaps, surface, 0.5)
    gaps.linearise(surface.rest)
    free = system.solve(right)
    assert (gaps.width(free) < 0).any()
    pose = surface.rest
    for _ in range(10):
        pose = step_with_gaps(system, right, gaps, pose)
    assert (gaps.width(pose) > gaps.least - 0.05 * GapOptions.margin - 1e-4).all()
    assert (gaps.forces >= 0).all() and gaps.forces.max() > 0
    # Contact forces are equal and opposite.
    assert np.abs(gaps.spread(gaps.forces).sum(axis=0)).max() < 1e-9 * gaps.forces.sum()
    pushed = pose - free
    assert pushed[:half, 0].mean() < 0 < pushed[half:, 0].mean()


def test_a_step_without_gaps_is_the_free_step() -> None:
    surface = Surface(*grid(8, 8))
    system = ArapSystem(surface, surface.rest)
    pose = surface.rest + 0.01 * np.random.default_rng(0).normal(size=surface.rest.shape)
    right = system.target(pose)
    step = step_with_gaps(system, right, gaps_of(surface), pose)
    assert np.abs(step - system.solve(right)).max() < 1e-12


def test_a_clearance_asks_narrow_gaps_to_open() -> None:
    surface = Surface(*two_spheres(2.1))
    gaps = gaps_of(surface)
    add_facing(gaps, surface, 0.2)
    gaps.linearise(surface.rest, clearance=0.1)
    widths = gaps.width(surface.rest)
    assert (widths < 0.1).any() and (widths > 0.1).any()
    assert np.allclose(gaps.least, np.minimum(0.1, widths + 0.05))
