"""A part that a correction turned inside out goes as a whole with what holds it."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair import Body, RepairOptions
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.relief.relief import relieved_poses
from dtrepair.repair.relief.wholes import with_wholes
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from tests.meshes import Mesh, icosphere, joined, torus

# A ring, and a pin across it that ends in it.
RING = torus(32, 12, 1.0, 0.1)
PIN = icosphere(2)[0] * (1.0, 0.05, 0.05), icosphere(2)[1]
TURN = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
SHIFT = np.array([0.3, 0.2, 0.0])


def buckle(*others: Mesh, pinned: bool = False) -> tuple[Scene, OpenedPose]:
    """The scene of ring, pin and other bodies, and the pose that is its rest."""
    rest, faces = joined(RING, PIN, *others)
    shown = Reference(rest, Detector(rest, faces)(rest))
    held = np.arange(len(PIN[0])) == 5
    bodies = [
        Body(*RING),
        Body(*PIN, pin=held if pinned else None),
        *(Body(*own) for own in others),
    ]
    scene = make_scene(bodies, RepairOptions(), references=[shown])
    return scene, detected(scene, gathered(scene, [body.rest for body in bodies]))


def inside_out(pose: OpenedPose) -> FloatArray:
    """Ring and pin turned and moved, the pin reflected as well."""
    points = pose.centred.copy()
    pin = slice(len(RING[0]), len(RING[0]) + len(PIN[0]))
    points[pin, 2] *= -1.0
    points[: pin.stop] = points[: pin.stop] @ TURN.T + SHIFT
    return points


def test_a_pin_that_was_turned_inside_out_lies_in_its_ring_again() -> None:
    scene, pose = buckle()
    found = inside_out(pose)
    assert scene.strain_meter(pose.centred, found)
    expected = pose.centred @ TURN.T + SHIFT
    assert np.abs(with_wholes(scene, pose, found, most=8) - expected).max() < 0.01
    # Without a try nothing of it is changed, nor where nothing lost its shape.
    assert with_wholes(scene, pose, found, most=0) is found
    assert with_wholes(scene, pose, expected, most=8) is expected
    mesh = WeldedMeshes(scene)([pose.weld])
    (relieved,) = relieved_poses(scene, mesh, [pose], [found])
    assert not scene.strain_meter(pose.centred, relieved)


def test_a_part_that_is_fixed_somewhere_stays_as_it_was_found() -> None:
    scene, pose = buckle(pinned=True)
    found = inside_out(pose)
    assert with_wholes(scene, pose, found, most=8) is found


def test_no_part_comes_off_what_holds_it() -> None:
    """A pin that swelled with its ring, by a little too much, would no longer reach it."""
    scene, pose = buckle()
    found = pose.centred * (1.2, 1.0, 1.0)
    found[len(RING[0]) :, 1:] *= 1.05
    assert scene.strain_meter(pose.centred, found)
    assert with_wholes(scene, pose, found, most=8) is found


def test_no_contact_comes_back() -> None:
    """A ball lies where the pin would; what was found of the pin goes round it."""
    ball, faces = icosphere(2, 0.08)
    scene, pose = buckle((ball + np.array([0.0, 3.0, 0.0]), faces))
    found = inside_out(pose)
    assert with_wholes(scene, pose, found, most=8) is not found
    found[-len(ball) :] = (ball - (0.0, 0.0, 0.1)) @ TURN.T + SHIFT
    pin = slice(len(RING[0]), len(RING[0]) + len(PIN[0]))
    found[pin, 2] -= 0.3 * np.clip(1.0 - 1.2 * np.abs(PIN[0][:, 0]), 0.0, 1.0)
    assert not len(scene.pairs(found, pose.weld))
    assert with_wholes(scene, pose, found, most=8) is found


@pytest.mark.parametrize("inside", [True, False])
def test_no_part_ends_inside_another(inside: bool) -> None:
    """A ring that widened round a ball would lie in it, with no contact between the two."""
    ring, ball = torus(24, 10, 0.1, 0.03), icosphere(2, 0.5)
    bodies = [Body(ring[0] + (2.0, 0.0, 0.0), ring[1]), Body(*ball)]
    scene = make_scene(bodies, RepairOptions())
    pose = detected(scene, gathered(scene, [body.rest for body in bodies]))
    found = pose.centred.copy()
    found[: len(ring[0])] = 8.0 * ring[0] + (0.0, 0.0, 0.0 if inside else 2.0)
    assert scene.strain_meter(pose.centred, found) and not len(scene.pairs(found, pose.weld))
    assert (with_wholes(scene, pose, found, most=8) is found) == inside


@pytest.mark.parametrize("turned", [True, False])
def test_no_part_goes_farther_than_what_was_found(turned: bool) -> None:
    """The ends of a pin that shrank went little more than half as far as if it turned round."""
    scene = make_scene([Body(*PIN)], RepairOptions())
    pose = detected(scene, gathered(scene, [PIN[0]]))
    found = 0.1 * pose.centred * ((-1.0, -1.0, 1.0) if turned else 1.0)
    assert (with_wholes(scene, pose, found, most=8) is found) == turned
