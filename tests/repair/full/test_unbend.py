"""Sharply bent edges: fewer after it, nothing else touched, and only where there are too many."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.elastic.dihedral_angles import bent_edges
from dtrepair.repair.full.method import FullMethod
from dtrepair.repair.full.relax import RelaxOptions
from dtrepair.repair.full.unbend import UnbendOptions, unbend
from dtrepair.repair.surface.defects import find_defects
from dtrepair.repair.surface.surface import Surface
from tests.meshes import elbow, grid


def folded_sheet(angle: float) -> tuple[Surface, FloatArray]:
    """A square sheet of 40 x 40 squares and its pose folded by `angle` about its middle line."""
    points, faces = grid(40, 40)
    surface = Surface(points, faces)
    pose = points / surface.size - (0.5, 0.0, 0.0)
    right = np.maximum(pose[:, 0], 0.0)
    pose[:, 0] = np.minimum(pose[:, 0], 0.0) + np.cos(angle) * right
    pose[:, 2] = np.sin(angle) * right
    return surface, pose


def test_a_sharp_fold_opens_and_the_rest_stays() -> None:
    surface, pose = folded_sheet(2.4)
    assert bent_edges(surface, pose).sum() == 40
    opened, rounds = unbend(surface, surface.rest, pose, folds=0)
    assert rounds >= 1
    assert bent_edges(surface, opened).sum() == 0
    assert len(find_defects(surface, opened).crossings) == 0
    # The surroundings of the fold are a ring on either side and at most 4 more.
    far = np.abs(surface.rest[:, 0] - 0.5) > 5.5 / 40
    assert np.array_equal(opened[far], pose[far])


def test_what_was_bent_before_may_stay() -> None:
    surface, pose = folded_sheet(2.4)
    same, rounds = unbend(surface, pose, pose, folds=0)
    assert rounds == 0 and same is pose


def test_no_more_opens_than_is_needed() -> None:
    surface, pose = zigzag({15: 2.4, 45: 2.4})
    _, original = zigzag({30: 2.4})
    assert bent_edges(surface, pose).sum() == 2 * bent_edges(surface, original).sum() == 24
    opened, rounds = unbend(surface, original, pose, folds=0)
    assert rounds == 1
    assert bent_edges(surface, opened).sum() == 12
    moved = 60 * surface.rest[(opened != pose).any(axis=1), 0]
    assert np.ptp(moved) < 15


def zigzag(angles: dict[int, float]) -> tuple[Surface, FloatArray]:
    """A strip of 60 x 12 squares and its pose folded by an angle at each of some columns."""
    points, faces = grid(60, 12)
    surface = Surface(points * (1.0, 0.2, 1.0), faces)
    columns = np.rint((surface.rest[:, 0] - surface.rest[:, 0].min()) * 60).astype(int)
    turned = np.cumsum([angles.get(column, 0.0) for column in range(60)])
    steps = np.stack([np.cos(turned), np.sin(turned)], axis=1) / 60
    profile = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    pose = surface.rest.copy()
    pose[:, [0, 2]] = profile[columns]
    # Detection errs on the safe side where corners are coplanar.
    pose += 1e-4 * np.random.default_rng(0).normal(size=pose.shape)
    return surface, pose


def test_a_crease_that_costs_too_much_stays() -> None:
    surface, pose = folded_sheet(2.4)
    # Nor is room made: relaxing gives up at once.
    options = UnbendOptions(dearest=1e-9, rounds=1, relax=RelaxOptions(tries=0))
    same, rounds = unbend(surface, surface.rest, pose, folds=0, options=options)
    assert rounds == 0 and same is pose


def test_contacts_make_room_for_what_does_not_open_alone() -> None:
    surface, pose = folded_sheet(2.4)
    options = UnbendOptions(most_clusters=0)
    opened, rounds = unbend(surface, surface.rest, pose, folds=0, options=options)
    assert rounds >= 1
    assert bent_edges(surface, opened).sum() == 0
    assert len(find_defects(surface, opened).crossings) == 0


def test_fixed_vertices_stay() -> None:
    surface, pose = folded_sheet(2.4)
    fixed = surface.rest[:, 1] < 0.3
    held = Surface(surface.rest, surface.faces, mobility=np.where(fixed, 0.0, 1.0))
    opened, rounds = unbend(held, surface.rest, pose, folds=0)
    assert rounds > 0
    assert np.array_equal(opened[fixed], pose[fixed])
    assert (opened[~fixed] != pose[~fixed]).any()


def test_a_repair_bends_no_more_edges_than_the_input_has() -> None:
    (points, faces), (rest, _) = elbow(1.4), elbow(0.0)
    surface = Surface(rest, faces)
    pose = points / surface.size
    before = bent_edges(surface, pose).sum()
    zipped = FullMethod(surface, skip=("unbend",))(pose).points
    assert bent_edges(surface, zipped).sum() > before
    solved = FullMethod(surface)(pose)
    assert solved.stages[-1].name == "unbend"
    assert bent_edges(surface, solved.points).sum() <= before
    assert len(find_defects(surface, solved.points).crossings) == 0
