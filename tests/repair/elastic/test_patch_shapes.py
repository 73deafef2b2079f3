"""Patches that go all round something keep their shapes, turned and stretched as their rims are."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray, unique_edges
from dtrepair.repair.elastic.patch_shapes import PatchShapeOptions, patch_shapes
from dtrepair.repair.full.biharmonic_fill import bilaplacian_fill, membrane_fill
from dtrepair.repair.surface.surface import BoolArray, Surface
from tests.meshes import tube

TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])


def ribbon() -> Surface:
    """A flat tube along z: a tie, .1 wide and .02 thick, 2 long."""
    points, faces = tube(16, 60, 1.0, 2.0)
    return Surface(points * (0.05, 0.01, 1.0), faces)


def middle(surface: Surface, height: float = 0.15) -> BoolArray:
    return np.asarray(np.abs(surface.rest[:, 2]) < height)


def crumpled(pose: FloatArray, mask: BoolArray) -> FloatArray:
    result = pose.copy()
    result[mask] += np.random.default_rng(1).normal(size=(mask.sum(), 3)) * 0.01
    return result


def shapes_of(surface: Surface, pose: FloatArray, mask: BoolArray) -> FloatArray | None:
    """The shapes of patches that go round something, whatever a film makes of them."""
    return patch_shapes(surface, pose, pose, mask, options=PatchShapeOptions(shrunk=99.0))


def width(surface: Surface, points: FloatArray) -> float:
    """The least extent along x of a ring of vertices."""
    rings = points[:, 0].reshape(-1, 16)
    return float((rings.max(axis=1) - rings.min(axis=1)).min())


@pytest.mark.parametrize("scale", [1.0, 1.4])
def test_a_patch_is_as_at_rest_where_all_only_turned_and_grew(scale: float) -> None:
    surface = ribbon()
    mask, pose = middle(surface), scale * surface.rest @ TURN.T + (1.0, 2.0, 3.0)
    before = crumpled(pose, mask)
    shapes = shapes_of(surface, before, mask)
    assert shapes is not None
    filled = bilaplacian_fill(surface.uniform, before, mask, None, lambda _: shapes)
    assert np.abs(filled - pose).max() < 1e-6  # what keeps patches definite
    assert np.abs(bilaplacian_fill(surface.uniform, before, mask) - pose).max() > 1e-3


def test_a_ribbon_is_not_wrung_to_a_thread() -> None:
    surface = ribbon()
    mask = middle(surface)
    share = surface.rest[:, 2:] / 2.0
    bent = surface.rest + np.hstack([np.zeros_like(share), share**2, np.zeros_like(share)])
    before = crumpled(bent, mask)
    shapes = shapes_of(surface, before, mask)
    kept = bilaplacian_fill(surface.uniform, before, mask, None, lambda _: shapes)
    film = membrane_fill(surface.uniform, before, mask)
    assert width(surface, kept) > 0.95 * width(surface, bent) > 1.5 * width(surface, film)
    edges = unique_edges(surface.faces)
    long = [np.linalg.norm(np.diff(pose[edges], axis=1)[:, 0], axis=1) for pose in (kept, bent)]
    assert np.abs(np.log(long[0] / long[1])).max() < 0.1


def test_half_of_a_tube_is_left_to_the_smoothest_continuation() -> None:
    surface = ribbon()
    half = middle(surface) & (surface.rest[:, 1] > 0.001)
    assert shapes_of(surface, surface.rest, half) is None
    options = PatchShapeOptions(flat=2.0, shrunk=99.0)
    rest = surface.rest
    assert patch_shapes(surface, rest, rest, half, options=options) is not None


def test_only_patches_that_go_round_something_have_shapes() -> None:
    surface = ribbon()
    away = surface.rest[:, 2] - 0.3
    half = (np.abs(away) < 0.05) & (surface.rest[:, 1] > 0.001)
    ring = middle(surface, 0.08)
    shapes = shapes_of(surface, surface.rest, half | ring)
    assert shapes is not None and not shapes[half].any()
    assert np.allclose(shapes[ring], (surface.uniform @ surface.rest)[ring], atol=1e-9)


def test_without_surroundings_there_are_no_shapes() -> None:
    surface = ribbon()
    everything = np.ones(surface.count, dtype=bool)
    assert shapes_of(surface, surface.rest, everything) is None
    assert shapes_of(surface, surface.rest, np.zeros_like(everything)) is None


@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_only_what_a_film_makes_a_thread_has_a_shape(scale: float) -> None:
    surface = ribbon()
    pose = scale * surface.rest
    for height, thread in ((0.02, False), (0.35, True)):
        mask = middle(surface, height)
        film = bilaplacian_fill(surface.uniform, pose, mask)
        assert (patch_shapes(surface, pose, film, mask) is not None) == thread
        # What keeps its area is none.
        assert patch_shapes(surface, pose, pose, mask) is None
