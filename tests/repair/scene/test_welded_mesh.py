"""Welded meshes: seams that stay closed are one, and everything else keeps its bits."""

from __future__ import annotations

import numpy as np

from dtrepair import Body, RepairOptions
from dtrepair.repair.scene.scene import Scene, make_scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from tests.meshes import icosphere, with_seam

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
