"""Welded meshes: seams that stay closed are one, and everything else keeps its bits."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair import Body, RepairOptions
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from tests.meshes import icosphere, tube, with_seam

BALL, BALL_FACES = icosphere(2)
POINTS, FACES = with_seam(BALL, BALL_FACES, 3)


def scene() -> Scene:
    return make_scene([Body(POINTS, FACES)], RepairOptions())


def test_a_seam_is_welded_where_all_poses_keep_it_closed() -> None:
    of = scene()
    meshes = WeldedMeshes(of)
    closed = of.weld(POINTS)
    opened = POINTS.copy()
    opened[len(BALL) :] += 0.01
    assert meshes([closed]).surface.count == len(BALL)
    assert meshes([of.weld(opened)]).surface.count == len(POINTS)
    assert meshes([closed, of.weld(opened)]).surface.count == len(POINTS)


def test_each_mesh_is_built_once() -> None:
    of = scene()
    meshes, weld = WeldedMeshes(of), of.weld(POINTS)
    assert meshes([weld]) is meshes([weld, weld])
    assert meshes([weld]) is not meshes([np.arange(len(POINTS), dtype=np.int32)])


def test_points_are_reduced_and_expanded() -> None:
    of = scene()
    mesh = WeldedMeshes(of)([of.weld(POINTS)])
    before = mesh.reduced(POINTS)
    assert before.shape == (len(BALL), 3) and np.ptp(before, axis=0).max() == 1.0
    assert np.array_equal(mesh.expanded(POINTS, before, before), POINTS)
    after = before.copy()
    moved = int(mesh.place[len(POINTS) - 1])
    after[moved] += 0.1
    found = mesh.expanded(POINTS, before, after)
    changed = (found != POINTS).any(axis=1)
    assert np.array_equal(changed, mesh.place == moved) and changed.sum() == 2
    assert np.allclose(found[changed] - POINTS[changed], 0.1 * mesh.surface.size)


def test_the_least_mobility_of_a_seam_holds() -> None:
    pin = np.zeros(len(POINTS))
    pin[-1] = 1.0
    of = make_scene([Body(POINTS, FACES, pin=pin)], RepairOptions())
    mesh = WeldedMeshes(of)([of.weld(POINTS)])
    assert np.flatnonzero(mesh.surface.fixed).tolist() == [mesh.place[-1]]


def test_limits_are_in_units_of_the_size() -> None:
    options = RepairOptions(maximum_displacement=0.4, clearance=0.01)
    of = make_scene([Body(POINTS, FACES)], options)
    mesh = WeldedMeshes(of)([of.weld(POINTS)])
    assert mesh.farthest == 0.4 / mesh.surface.size
    assert mesh.clearance == 0.01 / mesh.surface.size
    assert WeldedMeshes(scene())([scene().weld(POINTS)]).farthest is None


@pytest.mark.parametrize("inner", [0.1, 0.3, 1.0])
def test_what_a_sleeve_lies_over_moves_less(inner: float) -> None:
    arm, sleeve, ball = tube(24, 40, 0.2, 4.0), tube(24, 12, 0.23, 1.0), icosphere(2, 0.3)
    bodies = [Body(*arm), Body(*sleeve), Body(ball[0] + [0.0, 0.0, 5.0], ball[1])]
    of = make_scene(bodies, RepairOptions(inner_mobility=inner))
    found = WeldedMeshes(of)([of.weld(of.rest)]).surface.mobility
    expected = np.repeat([inner, 1.0, 1.0], [len(arm[0]), len(sleeve[0]), len(ball[0])])
    assert np.allclose(found, expected)


def test_the_smaller_it_is_the_less_the_arm_moves() -> None:
    arm, sleeve = tube(24, 40, 0.2, 4.0), tube(24, 12, 0.23, 1.0)
    bodies = [Body(*arm), Body(*sleeve)]
    bent = sleeve[0] + np.stack(
        [0.05 * np.cos(3.0 * sleeve[0][:, 2]), np.zeros(len(sleeve[0])), np.zeros(len(sleeve[0]))],
        axis=1,
    )
    moved = []
    for inner in (0.05, 1.0):
        of = make_scene(bodies, RepairOptions(inner_mobility=inner))
        pose = np.concatenate([arm[0], bent])
        assert len(of.pairs(pose, of.weld(pose)))
        found = WeldedMeshes(of)([of.weld(pose)]).solve([pose])[0][0]
        assert not len(of.pairs(found, of.weld(found)))
        moved.append(np.linalg.norm((found - pose)[: len(arm[0])], axis=1).max())
    assert moved[0] < 0.5 * moved[1]
