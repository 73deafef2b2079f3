"""Parts that hold each other: zones, what rides along as a whole, and what is held."""

from __future__ import annotations

import numpy as np

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attached.overlaps import find_attachments
from dtrepair.numerics.attachments import Reference
from dtrepair.repair.scene.attached_parts import AttachedParts
from dtrepair.repair.surface.containment import Enclosures
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


def test_a_sunken_button_may_end_inside_its_coat_and_an_arm_may_not() -> None:
    found, own = parts()
    points, faces = joined(COAT, BUTTON, ARM)
    enclosures = Enclosures(points, faces)
    inside = np.array([[1, 0], [2, 0], [1, 2]])
    assert found.meant_inside(inside, points, enclosures).tolist() == [True, True, False]
    # Small in the middle of the coat, which has no lids: but for these it is around everything.
    sunk = points.copy()
    sunk[own[1]] = 0.1 * sunk[own[1]]
    sunk[own[2]] = 0.1 * sunk[own[2]]
    assert found.meant_inside(inside, sunk, enclosures).tolist() == [True, False, False]


def test_without_attachments_nothing_is_held() -> None:
    points, faces = joined(COAT, BUTTON)
    part = np.repeat([0, 1], [len(COAT[0]), len(BUTTON[0])]).astype(np.int32)
    found = AttachedParts(None, faces, part)
    assert found.zone(0, 1) is None and len(found.held(0)) == 0 and found.wholes_on(0) == []
    assert not found.attached(np.array([[0, 1]])).any()
    pairs = Detector(points, faces)(points)
    assert len(pairs) and found.unmodelled(pairs) is pairs
