"""Parts that hold each other: zones, what rides along as a whole, and what is held."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attached.overlaps import find_attachments
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.scene.attached_parts import AttachedParts
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.scene import Scene
from tests.meshes import icosphere, joined, tube

COAT = tube(24, 30, 0.3, 2.0)
BUTTON = icosphere(1, 0.05)[0] + [0.29, 0.0, 0.5], icosphere(1)[1]
ARM = tube(12, 20, 0.1, 1.2)[0][:, [2, 1, 0]] + [0.5, 0.0, -0.4], tube(12, 20)[1]


def parts() -> tuple[AttachedParts, list[slice]]:
    """A coat, a button that is sunk in it, and an arm that comes out of it."""
    meshes = (COAT, BUTTON, ARM)
    points, faces = joined(*meshes)
    ends = np.cumsum([0, *(len(own) for own, _ in meshes)])
    part = np.repeat(np.arange(3), np.diff(ends)).astype(np.int32)
    reference = Reference(points, Detector(points, faces)(points))
    found = find_attachments(faces, len(points), [reference])
    own = [slice(a, b) for a, b in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)]
    return AttachedParts(found, faces, part), own


def test_a_button_rides_on_its_coat_and_an_arm_does_not() -> None:
    found, _ = parts()
    assert found.wholes_on(0) == [1] and found.wholes_on(1) == [] and found.wholes_on(2) == []
    assert found.attached(np.array([[0, 1], [2, 0], [1, 2]])).tolist() == [True, True, False]


def test_a_part_is_held_where_others_hold_it_but_for_its_riders() -> None:
    found, own = parts()
    held = found.held(0)
    towards = found.zone(0, 2)
    assert towards is not None and held.tolist() == towards.tolist()
    middle = joined(COAT, BUTTON, ARM)[0][held].mean(axis=0)
    assert 0 < len(held) < 0.6 * len(COAT[0]) and middle[2] < 0.0
    everything = found.zone(1, 0)
    assert everything is not None and len(everything) == own[1].stop - own[1].start


def pouch_on_a_hip(*, rod: bool) -> tuple[Scene, FloatArray]:
    """A closed body and a ball that sits on it, and a pose with the ball wholly in it."""
    hip, pouch = icosphere(3, 1.0), icosphere(1, 0.2)
    on_it = pouch[0] + (1.1, 0.0, 0.0)
    points, faces = joined(hip, (on_it, pouch[1]))
    sunk = points.copy()
    sunk[len(hip[0]) :] -= (0.7, 0.0, 0.0)
    pairs = Detector(points, faces)(points)
    shown = [Reference(points, pairs)]
    if rod:
        half = points.copy()
        half[len(hip[0]) :] -= (0.05, 0.0, 0.0)
        shown.append(Reference(half, Detector(points, faces)(half), slid=True))
    return make_scene([Body(points, faces)], RepairOptions(), references=shown), sunk


@pytest.mark.parametrize("rod", [False, True])
def test_a_pouch_may_not_end_in_its_hip_but_a_rod_in_its_cylinder(rod: bool) -> None:
    scene, sunk = pouch_on_a_hip(rod=rod)
    assert scene.attached_parts.attached(np.array([[0, 1]])).all()
    none = np.zeros((0, 2), dtype=np.int32)
    inside = scene.enclosed_parts(sunk - sunk.mean(axis=0), none)
    assert inside.tolist() == ([] if rod else [[1, 0]])
    # As long as it comes out it only sits there.
    out = sunk + np.where(np.arange(len(sunk))[:, None] >= len(sunk) - 42, (0.5, 0.0, 0.0), 0.0)
    assert len(scene.enclosed_parts(out - out.mean(axis=0), none)) == 0


def test_without_attachments_nothing_is_held() -> None:
    points, faces = joined(COAT, BUTTON)
    part = np.repeat([0, 1], [len(COAT[0]), len(BUTTON[0])]).astype(np.int32)
    found = AttachedParts(None, faces, part)
    assert found.zone(0, 1) is None and len(found.held(0)) == 0 and found.wholes_on(0) == []
    assert not found.attached(np.array([[0, 1]])).any()
    pairs = Detector(points, faces)(points)
    assert len(pairs) and found.unmodelled(pairs) is pairs
