"""Doubtful contacts: what touches nothing is left alone, what may touch is not."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.intersect.detector import Detector
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.surface.surface import BodyRange, Surface
from tests.meshes import bent_tube

ALONG = np.array([1.0, 0.0, 0.0])


def capped_cylinder(
    around: int = 24, along: int = 4
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """A cylinder along x, closed by fans of slivers that lie in one plane each."""
    angles = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    ring = np.stack([np.zeros(around), np.cos(angles), np.sin(angles)], axis=1)
    points = np.concatenate([ring + 0.5 * k * ALONG for k in range(along + 1)])
    faces = []
    for row in range(0, along * around, around):
        for k in range(around):
            a, b = row + k, row + (k + 1) % around
            faces += [[a, b, b + around], [a, b + around, a + around]]
    for start, turn in ((0, -1), (along * around, 1)):
        faces += [[start, start + k, start + k + 1][::turn] for k in range(1, around - 1)]
    return points, np.array(faces, dtype=np.int32)


def test_the_caps_are_in_doubt_and_touch_nothing() -> None:
    points, faces = capped_cylinder()
    detector = Detector(points, faces)
    assert len(detector(points)) == 0 and len(detector(points, exact=False)) > 0


@pytest.mark.parametrize("together", [False, True])
def test_what_touches_nothing_is_left_alone(together: bool) -> None:
    tube, tube_faces = bent_tube(6.5, 8, 24)
    rest = bent_tube(5.0, 8, 24)[0]
    cylinder, cylinder_faces = capped_cylinder()
    cylinder = cylinder - 50.0 * ALONG
    scene = SceneRepairer([Body(rest, tube_faces), Body(cylinder, cylinder_faces)])
    pose = [tube, cylinder]
    frames = [(0.0, pose), (1.0, pose)]
    stream = scene.animator.stream(frames, jobs=1)
    moved, left = next(iter(stream)).results if together else scene(pose)
    assert moved.before.pairs > 0 and moved.after.pairs == 0
    assert np.array_equal(left.points, cylinder)


def test_coplanar_contact_is_still_a_contact() -> None:
    points, faces = capped_cylinder()
    both = np.concatenate([points, points + 2.0 * ALONG])  # cap on cap
    joined = np.concatenate([faces, faces + len(points)]).astype(np.int32)
    count = len(points)
    bodies = [BodyRange(0, count, 99.0), BodyRange(count, 2 * count, 99.0)]
    surface = Surface(both, joined, bodies=bodies)
    found = surface.contacts.pairs(both / surface.size)
    exact = Detector(both, joined)(both)
    assert len(exact) > 0 and {*map(tuple, exact)} <= {*map(tuple, found)}


def test_what_is_flattened_does_not_pass_for_clean() -> None:
    points, faces = capped_cylinder()
    surface = Surface(points, faces)
    flat = points / surface.size * ALONG
    exact = Detector(points, faces)(flat)
    assert len(exact) > 0 and {*map(tuple, exact)} <= {*map(tuple, surface.contacts.pairs(flat))}


def test_what_has_no_area_is_settled() -> None:
    # The needle passes the triangle's plane beside it, and leans over it.
    points = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0], [4, 4, -1], [3, 3, 0], [1, 1, 2]])
    faces = np.array([[0, 1, 2], [3, 4, 5]], dtype=np.int32)
    rest = points + np.repeat([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]], 3, axis=0)
    surface = Surface(rest, faces)
    assert len(surface.detector(points, exact=False)) == 1
    assert len(surface.contacts.pairs(points / surface.size)) == 0
    points[3:, :2] -= 1.0
    assert surface.contacts.pairs(points / surface.size).tolist() == [[0, 1]]


def test_the_answer_does_not_depend_on_what_else_is_asked() -> None:
    points, faces = capped_cylinder()
    surface = Surface(points, faces)
    bent = points / surface.size + 0.1 * np.sin(7.0 * points)[:, [1, 2, 0]]
    active = np.arange(len(faces)) < 40
    every, some = surface.contacts.pairs(bent), surface.contacts.pairs(bent, active=active)
    assert np.array_equal(some, every[active[every].any(axis=1)])
