"""Flaws are fewer after a cure, nothing else is touched, and only where there are too many."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.elastic.dihedral_angles import DihedralAngles, bent_edges
from dtrepair.repair.elastic.edge_lengths import EdgeLengths
from dtrepair.repair.full.cure import CureOptions, cure
from dtrepair.repair.full.method import FullMethod, FullOptions
from dtrepair.repair.full.relax import RelaxOptions
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


def unbent(
    surface: Surface, pose: FloatArray, options: CureOptions | None = None
) -> tuple[FloatArray, int]:
    """A pose whose bent edges are opened towards the rest, and how many changes that took."""
    angles = DihedralAngles(surface, surface.rest)
    return cure(angles, surface.rest, pose, folds=0, options=options or CureOptions())


def test_a_sharp_fold_opens_and_the_rest_stays() -> None:
    surface, pose = folded_sheet(2.4)
    assert bent_edges(surface, pose).sum() == 40
    opened, rounds = unbent(surface, pose)
    assert rounds >= 1
    assert bent_edges(surface, opened).sum() == 0
    assert len(find_defects(surface, opened).crossings) == 0
    # The surroundings of the fold are a ring on either side and at most 4 more.
    far = np.abs(surface.rest[:, 0] - 0.5) > 5.5 / 40
    assert np.array_equal(opened[far], pose[far])


def test_what_was_bent_before_may_stay() -> None:
    surface, pose = folded_sheet(2.4)
    same, rounds = cure(DihedralAngles(surface, pose), pose, pose, folds=0)
    assert rounds == 0 and same is pose


def test_no_more_opens_than_is_needed() -> None:
    surface, pose = zigzag({15: 2.4, 45: 2.4})
    _, original = zigzag({30: 2.4})
    assert bent_edges(surface, pose).sum() == 2 * bent_edges(surface, original).sum() == 24
    opened, rounds = cure(DihedralAngles(surface, original), original, pose, folds=0)
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
    options = CureOptions(dearest=1e-9, rounds=1, relax=RelaxOptions(tries=0))
    same, rounds = cure(
        DihedralAngles(surface, surface.rest), surface.rest, pose, folds=0, options=options
    )
    assert rounds == 0 and same is pose


def test_contacts_make_room_for_what_does_not_open_alone() -> None:
    surface, pose = folded_sheet(2.4)
    options = CureOptions(most_clusters=0)
    opened, rounds = cure(
        DihedralAngles(surface, surface.rest), surface.rest, pose, folds=0, options=options
    )
    assert rounds >= 1
    assert bent_edges(surface, opened).sum() == 0
    assert len(find_defects(surface, opened).crossings) == 0


def test_fixed_vertices_stay() -> None:
    surface, pose = folded_sheet(2.4)
    fixed = surface.rest[:, 1] < 0.3
    held = Surface(surface.rest, surface.faces, mobility=np.where(fixed, 0.0, 1.0))
    opened, rounds = unbent(held, pose)
    assert rounds > 0
    assert np.array_equal(opened[fixed], pose[fixed])
    assert (opened[~fixed] != pose[~fixed]).any()


def test_a_repair_bends_no_more_edges_than_the_input_has() -> None:
    (points, faces), (rest, _) = elbow(1.4), elbow(0.0)
    surface = Surface(rest, faces)
    pose = points / surface.size
    before = bent_edges(surface, pose).sum()
    # Short steps zip the crease up.
    options = FullOptions(relax=RelaxOptions(first=1.0, longer=1.0, settle=()))
    zipped = FullMethod(surface, skip=("unbend",), options=options)(pose).points
    assert bent_edges(surface, zipped).sum() > before
    solved = FullMethod(surface, options=options)(pose)
    assert solved.stages[-1].name == "unbend"
    assert bent_edges(surface, solved.points).sum() <= before
    assert len(find_defects(surface, solved.points).crossings) == 0


def crushed_sheet(factor: float) -> tuple[Surface, FloatArray]:
    """A square sheet and its pose with one column of squares `factor` times as wide."""
    points, faces = grid(20, 20)
    surface = Surface(points, faces)
    pose = surface.rest.copy()
    width = float(np.ptp(pose[:, 0])) / 20
    right = pose[:, 0] > pose[:, 0].min() + 10.5 * width
    pose[right, 0] += (factor - 1.0) * width
    return surface, pose


@pytest.mark.parametrize("factor", [0.1, 6.0])
def test_edges_that_are_crushed_or_drawn_out_get_their_lengths_back(factor: float) -> None:
    surface, pose = crushed_sheet(factor)
    lengths = EdgeLengths(surface, surface.rest)
    assert lengths.excess(pose)[0] >= 21
    cured, done = cure(lengths, surface.rest, pose, folds=0)
    assert done >= 1
    assert lengths.excess(cured) == (0, 0.0)
    assert len(find_defects(surface, cured).crossings) == 0
    # What is farther than the rings that make room keeps every bit.
    far = np.abs(surface.rest[:, 0] - surface.rest[:, 0].mean()) > 8.5 / 20 / surface.size
    assert far.any() and np.array_equal(cured[far], pose[far])


def test_edges_within_the_factor_stay() -> None:
    surface, pose = crushed_sheet(0.5)
    same, done = cure(EdgeLengths(surface, surface.rest), surface.rest, pose, folds=0)
    assert done == 0 and same is pose


def test_a_cure_stays_clean_beside_a_wall() -> None:
    points, faces = grid(20, 20)
    wall = np.array([[1.0, -9.0, -9.0], [1.0, 9.0, -9.0], [1.0, 0.5, 9.0]])
    together = np.concatenate([points, wall + np.array([0.1, 0.0, 0.0])])
    surface = Surface(
        together,
        np.concatenate([faces, [[len(points), len(points) + 1, len(points) + 2]]]).astype(np.int32),
        mobility=np.repeat([1.0, 0.0], [len(points), 3]),
    )
    pose = surface.rest.copy()
    width, border = 1.0 / (20 * surface.size), np.flatnonzero(points[:, 0] == 1.0)
    pose[border, 0] -= 0.9 * width
    pose[-3:, 0] = pose[border, 0].mean() + 0.05 * width
    lengths = EdgeLengths(surface, surface.rest)
    alone = lengths.cured(pose, np.concatenate(lengths.clusters(pose)), 2)
    assert len(find_defects(surface, alone).crossings) > 0
    cured, _ = cure(lengths, surface.rest, pose, folds=0)
    assert lengths.excess(cured) < lengths.excess(pose)
    assert len(find_defects(surface, cured).crossings) == 0
    assert np.array_equal(cured[-3:], pose[-3:])
