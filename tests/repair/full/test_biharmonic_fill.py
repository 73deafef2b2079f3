"""Fills: residuals of their equations, exact fields, and creases that come out clean."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.intersect.detector import find_intersections
from dtrepair.numerics.geometry import FloatArray, extent
from dtrepair.numerics.operators import uniform_laplacian
from dtrepair.repair.full.biharmonic_fill import (
    FillOptions,
    biharmonic_fill,
    bilaplacian_fill,
    membrane_fill,
)
from dtrepair.repair.surface.defects import Defects, find_defects, update_defects
from dtrepair.repair.surface.surface import Surface
from tests.meshes import Mesh, elbow, grid, icosphere, joined, tube
from tests.repair.surface.test_ties import attachments_of

FILLS = [membrane_fill, bilaplacian_fill]


def patch(mesh: Mesh, centre: int, rings: int) -> tuple[Surface, NDArray[np.bool_]]:
    surface = Surface(*mesh)
    return surface, surface.dilate(np.arange(surface.count) == centre, rings)


def field_of(count: int) -> FloatArray:
    return np.random.default_rng(0).normal(size=(count, 3))


@pytest.mark.parametrize("fill", FILLS)
@pytest.mark.parametrize("mesh", [icosphere(3), tube(12, 20), grid(16, 16)])
def test_only_masked_vertices_change(fill: Callable[..., NDArray[np.float64]], mesh: Mesh) -> None:
    surface, mask = patch(mesh, 100, 3)
    field = field_of(surface.count)
    kept = field.copy()
    filled = fill(surface.uniform, field, mask)
    assert np.array_equal(field, kept)
    assert np.array_equal(filled[~mask], field[~mask])
    assert (filled[mask] != field[mask]).all()


@pytest.mark.parametrize("mesh", [icosphere(3), tube(12, 20)])
def test_a_membrane_is_harmonic(mesh: Mesh) -> None:
    surface, mask = patch(mesh, 100, 3)
    filled = membrane_fill(surface.uniform, field_of(surface.count), mask)
    assert np.abs((surface.uniform @ filled)[mask]).max() < 1e-8
    # Harmonic: within the range of its surroundings.
    ring = surface.dilate(mask) & ~mask
    assert (filled[mask].max(axis=0) <= filled[ring].max(axis=0) + 1e-8).all()
    assert (filled[mask].min(axis=0) >= filled[ring].min(axis=0) - 1e-8).all()


@pytest.mark.parametrize("mesh", [icosphere(3), tube(12, 20)])
def test_a_bilaplacian_patch_is_the_smoothest(mesh: Mesh) -> None:
    surface, mask = patch(mesh, 100, 3)
    laplacian = surface.uniform
    filled = bilaplacian_fill(laplacian, field_of(surface.count), mask)
    assert np.abs((laplacian @ (laplacian @ filled))[mask]).max() < 1e-7
    least = np.square(laplacian @ filled).sum()
    random = np.random.default_rng(1)
    for _ in range(5):
        other = filled + 0.01 * mask[:, None] * random.normal(size=filled.shape)
        assert np.square(laplacian @ other).sum() > least


@pytest.mark.parametrize("fill", FILLS)
def test_linear_fields_on_a_regular_grid_come_back(
    fill: Callable[..., NDArray[np.float64]],
) -> None:
    # The umbrella of the inner vertices of a regular grid is symmetric: linear is harmonic.
    surface, mask = patch(grid(16, 16), 8 * 17 + 8, 4)
    points = surface.rest
    spoiled = points + mask[:, None] * field_of(surface.count)
    filled = fill(surface.uniform, spoiled, mask)
    assert np.abs(filled - points).max() < 1e-6


@pytest.mark.parametrize("fill", FILLS)
def test_fills_do_not_depend_on_what_they_replace(fill: Callable[..., NDArray[np.float64]]) -> None:
    surface, mask = patch(icosphere(3), 100, 3)
    one = field_of(surface.count)
    other = np.where(mask[:, None], 1e6, one)
    difference = fill(surface.uniform, one, mask) - fill(surface.uniform, other, mask)
    assert np.abs(difference).max() < 1e-9


@pytest.mark.parametrize("fill", FILLS)
def test_a_patch_without_surroundings_stays_finite(
    fill: Callable[..., NDArray[np.float64]],
) -> None:
    points, faces = icosphere(1)
    everything = np.ones(len(points), dtype=bool)
    filled = fill(uniform_laplacian(faces, len(points)), points, everything)
    assert np.isfinite(filled).all()


@pytest.mark.parametrize("angle", [1.6, 2.0, 2.4])
def test_creases_come_out_clean(angle: float) -> None:
    (points, faces), (rest, _) = elbow(angle), elbow(0.0)
    surface = Surface(rest, faces)
    pose = points / surface.size
    before = find_defects(surface, pose)
    assert len(before.crossings) > 20
    filled, left = biharmonic_fill(surface, pose)
    assert left.rank[0] == 0 and len(left.folds) <= len(before.folds)
    again = find_defects(surface, filled)
    assert again.rank == left.rank
    assert len(find_intersections(surface.written(filled), faces)) == 0
    # Only the surroundings of the crease are replaced: both ends stay.
    moved = (filled != pose).any(axis=1)
    assert 0 < moved.mean() < 0.5
    assert not moved[:12].any() and not moved[-14:].any()


def test_a_pose_without_defects_comes_back() -> None:
    points, faces = elbow(0.0)
    surface = Surface(points, faces)
    filled, left = biharmonic_fill(surface, surface.rest)
    assert filled is surface.rest and left.rank == (0, 0)


def test_fixed_vertices_are_never_replaced() -> None:
    (points, faces), (rest, _) = elbow(2.0), elbow(0.0)
    fixed = points[:, 1] > 0
    surface = Surface(rest, faces, mobility=np.where(fixed, 0.0, 1.0))
    pose = points / surface.size
    filled, left = biharmonic_fill(surface, pose)
    assert np.array_equal(filled[fixed], pose[fixed])
    assert left.rank <= find_defects(surface, pose).rank


def test_known_defects_save_a_detection_and_change_nothing() -> None:
    (points, faces), (rest, _) = elbow(2.0), elbow(0.0)
    surface = Surface(rest, faces)
    pose = points / surface.size
    known = find_defects(surface, pose)
    one, other = biharmonic_fill(surface, pose), biharmonic_fill(surface, pose, known=known)
    assert np.array_equal(one.points, other.points)


def test_the_best_state_is_returned_when_it_never_comes_clean() -> None:
    # One round of tiny patches cannot open this; what it returns is never worse than the pose.
    (points, faces), (rest, _) = elbow(3.0), elbow(0.0)
    surface = Surface(rest, faces)
    pose = points / surface.size
    before = find_defects(surface, pose)
    filled, left = biharmonic_fill(surface, pose, known=before, options=FillOptions(rounds=1))
    assert isinstance(left, Defects)
    assert left.rank <= before.rank
    assert find_defects(surface, filled).rank == left.rank


def test_a_small_part_that_a_patch_would_cover_does_not_shrink_to_a_point(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ball, faces = icosphere(3)
    small = 0.1 * icosphere(0)[0] + np.array([0.95, 0.0, 0.1])
    own, sizes = slice(len(ball), None), []
    surface = Surface(*joined((ball, faces), (small, icosphere(0)[1])))
    assert len(find_defects(surface, surface.rest).crossings) > 0

    def looked_at(surface: Surface, known: Defects, points: FloatArray, moved: Any) -> Defects:
        sizes.append(extent(points[own]))
        return update_defects(surface, known, points, moved)

    monkeypatch.setattr("dtrepair.repair.full.biharmonic_fill.update_defects", looked_at)
    biharmonic_fill(surface, surface.rest)
    assert min(sizes) > 0.5 * extent(surface.rest[own])


@pytest.mark.parametrize("attached", [True, False])
def test_a_crumpled_ribbon_of_attached_parts_is_no_thread(attached: bool) -> None:
    # A tie, 2 long and .1 wide, that a knot holds at one end.
    points, faces = tube(16, 60, 1.0, 2.0)
    ribbon, knot = points * (0.05, 0.01, 1.0), 0.04 * icosphere(2)[0] + (0.0, 0.0, 0.95)
    mesh = joined((ribbon, faces), (knot, icosphere(2)[1]))
    surface = Surface(*mesh, attachments=attachments_of(mesh) if attached else None)
    middle, pose = np.abs(surface.rest[:, 2]) < 0.2, surface.rest.copy()
    pose[middle] += np.random.default_rng(1).normal(size=(middle.sum(), 3)) * 0.02
    known = update_defects(surface, find_defects(surface, surface.rest), pose, middle)
    filled = biharmonic_fill(surface, pose, known=known).points
    rows = filled[: len(ribbon), 0].reshape(-1, 16)
    width = np.ptp(rows, axis=1).min() / np.ptp(surface.rest[: len(ribbon), 0])
    assert width > 0.8 if attached else width < 0.4


def test_at_most_half_of_a_part_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    # A sleeve of few rings that a plate cuts through: patches would reach its ends at once.
    sleeve, plate = tube(12, 6), grid(40, 40)
    middle = sleeve[0].mean(axis=0) - plate[0].mean(axis=0)
    surface = Surface(*joined(sleeve, (plate[0] + middle, plate[1])))
    own = np.arange(surface.count) < len(sleeve[0])
    shares: list[tuple[float, float]] = []
    assert len(find_defects(surface, surface.rest).crossings) > 0

    def looked_at(surface: Surface, known: Defects, points: FloatArray, moved: Any) -> Defects:
        shares.append((moved[own].mean(), moved[~own].mean()))
        return update_defects(surface, known, points, moved)

    monkeypatch.setattr("dtrepair.repair.full.biharmonic_fill.update_defects", looked_at)
    biharmonic_fill(surface, surface.rest)
    of_sleeve, of_plate = zip(*shares, strict=True)
    assert 0.2 < max(of_sleeve) <= 0.5
    # There the patch stays, while that of the plate still grows.
    assert of_sleeve[-1] == of_sleeve[-2] == max(of_sleeve) and of_plate[-1] > of_plate[-2]


def test_what_fills_all_that_is_free_becomes_a_membrane(monkeypatch: pytest.MonkeyPatch) -> None:
    (points, faces), (rest, _) = elbow(1.4), elbow(0.0)
    crease = Surface(rest, faces).vertices_of(find_intersections(points, faces))
    surface = Surface(rest, faces, mobility=np.where(crease, 1.0, 0.0))
    kinds = []

    def membrane(*given: Any) -> FloatArray:
        kinds.append(int(given[2].sum()))
        return membrane_fill(*given)

    monkeypatch.setattr("dtrepair.repair.full.biharmonic_fill.membrane_fill", membrane)
    biharmonic_fill(surface, points / surface.size)
    assert kinds
