"""Tightening: never dirty, never more distorted, always back towards the input."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import distortion
from dtrepair.repair.full.biharmonic_fill import biharmonic_fill
from dtrepair.repair.full.pull_back import PullBackOptions, pull_back
from dtrepair.repair.full.push import PushOptions, push
from dtrepair.repair.surface.defects import find_defects
from dtrepair.repair.surface.surface import BodyRange, Surface
from tests.meshes import (
    Mesh,
    armed_body,
    elbow,
    icosphere,
    joined,
    knot,
    overlapping_spheres,
    torus,
)

POSES: dict[str, tuple[Mesh, Mesh]] = {
    "spheres": (overlapping_spheres(2, 1.6), overlapping_spheres(2, 1.6)),
    "knot": (knot(), knot(tube_radius=0.3)),
    "arm": (armed_body(4.2), armed_body(0.0)),
    "elbow": (elbow(2.0), elbow(0.0)),
}


def loosely_solved(kind: str) -> tuple[Surface, FloatArray, FloatArray]:
    """A surface, a pose, and a clean pose farther from it than it has to be."""
    (points, faces), (rest, _) = POSES[kind]
    surface = Surface(rest, faces)
    original = points / surface.size
    pushed = push(surface, original, near=12, step=0.02, options=PushOptions(iterations=40))
    clean, left = biharmonic_fill(surface, pushed.points)
    assert left.rank[0] == 0
    return surface, original, clean


def crossings_and_folds(surface: Surface, points: FloatArray) -> tuple[int, int]:
    defects = find_defects(surface, points)
    return len(defects.crossings), len(defects.folds)


@pytest.mark.parametrize("kind", POSES)
@pytest.mark.parametrize("fraction", [0.35, 1.0])
def test_pulling_back_is_never_dirty_or_more_distorted(kind: str, fraction: float) -> None:
    surface, original, clean = loosely_solved(kind)
    folds = crossings_and_folds(surface, clean)[1]
    before = distortion(original, clean, surface.edges)
    pulled = pull_back(
        surface,
        original,
        clean,
        near=12,
        folds=folds,
        cycles=2,
        options=PullBackOptions(fraction=fraction),
    )
    crossings, folds_left = crossings_and_folds(surface, pulled)
    assert crossings == 0 and folds_left <= folds
    if not np.array_equal(pulled, clean):
        assert distortion(original, pulled, surface.edges) < 0.996 * before


def test_pulling_back_gains_where_there_is_room() -> None:
    # A clean input bent far out of shape: nothing is in the way of its return.
    points, faces = torus()
    surface = Surface(points, faces)
    original = surface.rest
    bent = original + 0.05 * np.sin(9 * original[:, [1, 2, 0]])
    assert crossings_and_folds(surface, bent) == (0, 0)
    before = distortion(original, bent, surface.edges)
    pulled = pull_back(surface, original, bent, near=6, folds=0)
    assert distortion(original, pulled, surface.edges) == pytest.approx(0.65 * before, rel=0.05)


def test_of_several_bodies_those_that_cross_all_the_same_stay_out() -> None:
    """A ball comes back freely, while another one has no room between two that are held."""
    ball, faces = icosphere(2, 0.5)
    places = [(-0.8, 0, 0), (0, 0, 0), (0.8, 0, 0), (5, 0, 0), (5.8, 0, 0)]
    points, all_faces = joined(*[(ball + place, faces) for place in places])
    count = len(ball)
    bodies = [BodyRange(k * count, (k + 1) * count, 99.0) for k in range(5)]
    own = [slice(body.start, body.stop) for body in bodies]
    mobility = np.ones(len(points))
    for still in (0, 2, 3):
        mobility[own[still]] = 0.0
    surface = Surface(points, all_faces, bodies=bodies, mobility=mobility)
    original, clean = surface.rest.copy(), surface.rest.copy()
    clean[own[1]] += np.array([0.0, 1.05, 0.0]) / surface.size
    clean[own[4]] += np.array([0.6, 0.0, 0.0]) / surface.size
    assert crossings_and_folds(surface, clean) == (0, 0)
    options = PullBackOptions(fraction=1.0, step=1e-9)
    pulled = pull_back(surface, original, clean, near=0, folds=0, options=options)
    # Pushing by nothing leaves all in each other: all are back, where they were.
    assert np.array_equal(pulled, clean)
    original[own[4]] += np.array([0.25, 0.0, 0.0]) / surface.size
    pulled = pull_back(surface, original, clean, near=0, folds=0, options=options)
    assert crossings_and_folds(surface, pulled) == (0, 0)
    assert np.array_equal(pulled[own[1]], clean[own[1]])
    assert np.array_equal(pulled[own[4]], original[own[4]])
