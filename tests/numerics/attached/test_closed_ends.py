"""Closed ends that go into an open part: a wrist in its cuff is held all of it, a thigh is not."""

from __future__ import annotations

import numpy as np

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attached.hidden_ends import closed_ends
from dtrepair.numerics.attached.overlaps import find_attachments
from dtrepair.numerics.attachments import Reference
from tests.meshes import Mesh, icosphere, joined, tube


def arm() -> Mesh:
    """A round bar along z with closed ends."""
    points, faces = icosphere(4)
    return points * [0.2, 0.2, 1.0] * np.sqrt(1.0 + points[:, 2:] ** 2), faces


def held(mesh: Mesh, low: float, high: float, away: float) -> float:
    """The share that counts as an end of what lies between two heights, as far from a sleeve."""
    points, faces = mesh
    inner = np.flatnonzero((points[:, 2] > low) & (points[:, 2] < high)).astype(np.int32)
    return float(closed_ends(points, faces, inner, np.full(len(inner), away)).mean())


def test_an_end_is_held_where_its_sleeve_is_within_half_of_its_radius() -> None:
    assert held(arm(), 0.3, 2.0, away=0.07) == 1.0
    assert held(arm(), 0.3, 2.0, away=0.1) == 0.0


def test_what_comes_out_again_or_begins_and_ends_inside_is_no_end() -> None:
    assert held(arm(), -0.3, 0.3, away=0.01) == 0.0
    assert held(arm(), -2.0, 2.0, away=0.01) == 0.0
    assert held(tube(), 0.3, 2.0, away=0.01) == 0.0


def test_each_end_is_asked_by_itself() -> None:
    below, above = arm(), (arm()[0] + [1.0, 0.0, 0.0], arm()[1])
    points, faces = joined(below, above)
    height, first = points[:, 2], np.arange(len(points)) < len(below[0])
    inner = np.flatnonzero(np.where(first, height > 0.3, np.abs(height) < 0.3)).astype(np.int32)
    found = closed_ends(points, faces, inner, np.zeros(len(inner)))
    assert (found == first[inner]).all()


def test_nothing_behind_has_no_end() -> None:
    assert len(closed_ends(*arm(), np.zeros(0, dtype=np.int32), np.zeros(0))) == 0


def test_a_wrist_that_touches_its_cuff_in_one_place_is_held_to_its_end() -> None:
    points, faces = arm()
    cuff, around = tube(24, 40, 0.21, 2.2)
    cuff[:, 2] += 1.7
    angle = np.arctan2(cuff[:, 1], cuff[:, 0])
    cuff[(np.abs(angle) < 0.3) & (np.abs(cuff[:, 2] - 0.7) < 0.06), :2] *= 0.19 / 0.21
    mesh = joined((points, faces), (cuff, around))
    pairs = Detector(mesh[0], mesh[1])(mesh[0])
    ties = find_attachments(mesh[1], len(mesh[0]), [Reference(mesh[0], pairs)]).ties
    tied = mesh[0][ties.vertices[ties.vertices < len(points)]]
    deep = tied[tied[:, 2] > 0.8]
    assert (deep[:, 0] > 0.1).any() and (deep[:, 0] < -0.1).any()
