"""Poses between a rest and a pose: rigid motions stay rigid, bends are shared out evenly."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from dtrepair.numerics.geometry import lengths
from dtrepair.repair.elastic.poses_between import PosesBetween, unwound
from dtrepair.repair.surface.rigid_bodies import RigidBodies
from dtrepair.repair.surface.surface import Surface
from tests.meshes import armed_body, elbow, joined, torus

TURN = np.array([[0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [0.8, 0.0, 0.6]])


def test_the_ends_of_the_way_are_the_rest_and_the_pose() -> None:
    surface = Surface(*elbow(0.3))
    pose = elbow(1.2)[0] / surface.size
    between = PosesBetween(surface, pose)
    assert between(1.0) is pose
    assert np.abs(between(0.0) - between.start).max() < 1e-8
    # The rest moved as a whole.
    edges = surface.edges
    before, after = (own[edges[:, 0]] - own[edges[:, 1]] for own in (surface.rest, between.start))
    assert np.allclose(lengths(before), lengths(after), rtol=1e-9)


def test_what_only_moved_has_no_way_to_go() -> None:
    surface = Surface(*torus())
    pose = surface.rest @ TURN.T + (3.0, 0.0, -1.0)
    between = PosesBetween(surface, pose)
    for share in (0.0, 0.3, 0.7):
        assert np.abs(between(share) - pose).max() < 1e-8


@pytest.mark.parametrize("curl", [2.0, 5.0])
def test_halfway_an_arm_is_curled_by_half(curl: float) -> None:
    """By 5 radians more than half a turn: the shorter way round would uncurl it."""
    surface = Surface(*armed_body(0.0))
    pose, expected = (armed_body(own)[0] / surface.size for own in (curl, 0.5 * curl))
    between = PosesBetween(surface, pose)
    whole = RigidBodies([(0, surface.count)], surface.mass)
    halfway, chord = between(0.5), 0.5 * (between.start + pose)
    off, far = (lengths(own - whole.fitted(expected, own)).max() for own in (halfway, chord))
    assert off < 0.002 < 0.05 < far


def test_components_each_have_their_own_way() -> None:
    straight, ring = elbow(0.2), torus()
    surface = Surface(*joined(straight, ring))
    bent = joined(elbow(1.0), ring)[0] / surface.size
    halfway = PosesBetween(surface, bent)(0.5)
    own = surface.edges[surface.edges[:, 0] >= len(straight[0])]
    before, after = (points[own[:, 0]] - points[own[:, 1]] for points in (surface.rest, halfway))
    assert np.allclose(lengths(before), lengths(after), rtol=1e-4)


def test_turns_along_a_chain_go_on_beyond_half_a_turn() -> None:
    angle, axis = np.linspace(0.0, 7.0, 50), np.array([0.0, 0.6, 0.8])
    # Every rotation vector as it comes out of a matrix: at most half a turn.
    shortest = angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))
    assert np.abs(shortest).max() <= np.pi < angle.max()
    chain = sparse.diags([np.ones(49), np.ones(49)], [1, -1]).tocsr()
    assert np.allclose(unwound(chain, shortest[:, None] * axis), angle[:, None] * axis)
