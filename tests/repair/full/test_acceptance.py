"""Acceptance: what is too small is left out, what collides is rolled back."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.repair.full.acceptance import (
    AcceptanceOptions,
    changed_defects,
    reach_of,
    roll_back,
    without_still,
)
from dtrepair.repair.surface.defects import find_defects
from dtrepair.repair.surface.surface import Surface
from tests.meshes import elbow, torus

RINGS, STILL = AcceptanceOptions.reach_rings, AcceptanceOptions.still


def test_reach_fades_over_rings_from_what_moved() -> None:
    surface = Surface(*torus(60, 8))
    displacement = np.zeros((surface.count, 3))
    displacement[0, 2] = 0.1
    reach = reach_of(surface, displacement)
    rings = surface.rings_from((displacement != 0).any(axis=1), 2 * RINGS)
    assert (reach[rings <= RINGS // 2] == 1).all()
    assert (reach[rings >= RINGS] == 0).all()
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
    (points, faces), (rest, _) = elbow(2.0), elbow(0.0)
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
    (points, faces), (rest, _) = elbow(2.0), elbow(0.0)
    surface = Surface(rest, faces)
    pose = points / surface.size
    known = find_defects(surface, pose)
    options = AcceptanceOptions(rollback_tries=1)
    assert roll_back(surface, pose, pose + 0.01, known, folds=0, options=options) is None
