"""Tightening: never dirty, never more distorted, always back towards the input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray, diagonal
from dtrepair.numerics.metrics import displacements
from dtrepair.repair.full.biharmonic_fill import fill_creases
from dtrepair.repair.full.pull_back import (
    REACH_RINGS,
    STILL,
    changed_defects,
    distortion,
    pull_back,
    reach_of,
    roll_back,
    without_still,
)
from dtrepair.repair.full.push import push
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
    pushed = push(surface, original, near=12, step=0.02, iterations=40)
    clean, left = fill_creases(surface, pushed.points)
    assert left.rank[0] == 0
    return surface, original, clean


def crossings_and_folds(surface: Surface, points: FloatArray) -> tuple[int, int]:
    defects = find_defects(surface, points)
    return len(defects.crossings), len(defects.folds)


def test_distortion_is_edge_change_and_displacement() -> None:
    surface = Surface(*torus())
    pose = surface.rest
    assert distortion(surface, pose, pose) == 0.0
    turned = pose[:, [1, 2, 0]]
    moved = displacements(pose, turned).mean()
    assert distortion(surface, pose, turned) == pytest.approx(2 * moved, rel=1e-12)
    bigger = 1.5 * pose
    expected = np.log(1.5) + 2 * np.linalg.norm(0.5 * pose, axis=1).mean() / diagonal(pose)
    assert distortion(surface, pose, bigger) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("kind", POSES)
@pytest.mark.parametrize("fraction", [0.35, 1.0])
def test_pulling_back_is_never_dirty_or_more_distorted(kind: str, fraction: float) -> None:
    surface, original, clean = loosely_solved(kind)
    folds = crossings_and_folds(surface, clean)[1]
    before = distortion(surface, original, clean)
    pulled = pull_back(surface, original, clean, near=12, fraction=fraction, folds=folds, cycles=2)
    crossings, folds_left = crossings_and_folds(surface, pulled)
    assert crossings == 0 and folds_left <= folds
    if not np.array_equal(pulled, clean):
        assert distortion(surface, original, pulled) < 0.996 * before


def test_pulling_back_gains_where_there_is_room() -> None:
    # A clean input bent far out of shape: nothing is in the way of its return.
    points, faces = torus()
    surface = Surface(points, faces)
    original = surface.rest
    bent = original + 0.05 * np.sin(9 * original[:, [1, 2, 0]])
    assert crossings_and_folds(surface, bent) == (0, 0)
    before = distortion(surface, original, bent)
    pulled = pull_back(surface, original, bent, near=6, fraction=0.35, folds=0)
    assert distortion(surface, original, pulled) == pytest.approx(0.65 * before, rel=0.05)


def test_reach_fades_over_rings_from_what_moved() -> None:
    surface = Surface(*torus(60, 8))
    displacement = np.zeros((surface.count, 3))
    displacement[0, 2] = 0.1
    reach = reach_of(surface, displacement)
    rings = surface.rings_from((displacement != 0).any(axis=1), 2 * REACH_RINGS)
    assert (reach[rings <= REACH_RINGS // 2] == 1).all()
    assert (reach[rings >= REACH_RINGS] == 0).all()
    assert (np.diff(reach[np.argsort(rings, kind="stable")]) <= 0).all()
    assert (reach_of(surface, 0 * displacement) == 0).all()


def test_motions_too_small_to_matter_are_left_out() -> None:
    current = np.zeros((4, 3))
    trial = np.zeros((4, 3))
    trial[:, 1] = [0.0, 0.5 * STILL, 1.5 * STILL, 3 * STILL]
    kept = without_still(current, trial)
    assert (kept[[0, 1]] == 0).all()
    assert kept[2, 1] == pytest.approx(0.75 * STILL, rel=1e-9)
    assert kept[3, 1] == 3 * STILL


def test_changed_defects_are_those_of_the_trial() -> None:
    (points, faces), (rest, _) = POSES["elbow"]
    surface = Surface(rest, faces)
    pose = points / surface.size
    trial = pose.copy()
    trial[surface.dilate(np.arange(surface.count) == 240, 3)] += 0.01
    known = find_defects(surface, pose)
    found = changed_defects(surface, known, pose, trial)
    expected = find_defects(surface, trial)
    for one, other in zip(found, expected, strict=True):
        assert set(map(tuple, one.tolist())) == set(map(tuple, other.tolist()))


def test_rolling_back_keeps_what_does_not_collide() -> None:
    # A long tube: one end is moved freely, the other end's ring is thrown through its far side.
    points, faces = elbow(0.0, along=80)
    surface = Surface(points, faces)
    current = surface.rest
    trial = current + (0.0, 0.003, 0.0) * (current[:, 2:] < 0)
    thrown = np.arange(12 * 70, 12 * 70 + 3)
    trial[thrown] -= 2.2 * (current[thrown] - current[12 * 70 : 12 * 71].mean(axis=0))
    known = find_defects(surface, current)
    defects = find_defects(surface, trial)
    assert known.rank == (0, 0) and defects.rank[1] > 0
    rolled = roll_back(surface, current, trial, defects, folds=0)
    assert rolled is not None
    assert rolled.defects.rank == (0, 0) == find_defects(surface, rolled.points).rank
    assert np.array_equal(rolled.points[: 12 * 20], trial[: 12 * 20])
    assert np.array_equal(rolled.points[thrown], current[thrown])


def test_rolling_back_a_step_from_a_dirty_pose_is_refused() -> None:
    (points, faces), (rest, _) = POSES["elbow"]
    surface = Surface(rest, faces)
    pose = points / surface.size
    known = find_defects(surface, pose)
    assert roll_back(surface, pose, pose + 0.01, known, folds=0, tries=1) is None


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
    options: dict[str, Any] = {"near": 0, "fraction": 1.0, "folds": 0, "step": 1e-9}
    pulled = pull_back(surface, original, clean, **options)
    # Pushing by nothing leaves all in each other: all are back, where they were.
    assert np.array_equal(pulled, clean)
    original[own[4]] += np.array([0.25, 0.0, 0.0]) / surface.size
    pulled = pull_back(surface, original, clean, **options)
    assert crossings_and_folds(surface, pulled) == (0, 0)
    assert np.array_equal(pulled[own[1]], clean[own[1]])
    assert np.array_equal(pulled[own[4]], original[own[4]])
