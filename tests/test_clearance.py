"""Clearance: contacts opened to a distance, or as far as there is room."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.repair.clearance import open_contacts
from dtrepair.repair.contact import find_defects
from dtrepair.repair.relax import relax
from dtrepair.repair.surface import Surface
from tests.test_tighten import loosely_solved


@pytest.mark.parametrize("kind", ["knot", "arm"])
def test_contacts_open_to_the_clearance(kind: str) -> None:
    surface, original, clean = loosely_solved(kind)
    reach = np.ones(surface.count)
    tight, _ = relax(surface, original, clean, cycles=8, folds=0, reach=reach)
    clearance = 0.004
    before = len(surface.close_pairs(tight, clearance))
    assert before > 10
    opened, left = open_contacts(surface, tight, clearance)
    assert left == len(surface.close_pairs(opened, clearance)) == 0
    assert find_defects(surface, opened).rank[0] == 0
    # It opens the contacts and nothing else.
    assert np.linalg.norm(opened - tight, axis=1).max() < 3 * clearance


def test_without_room_the_best_pose_is_kept_and_the_rest_counted() -> None:
    surface, original, clean = loosely_solved("knot")
    tight, _ = relax(surface, original, clean, cycles=8, folds=0, reach=np.ones(surface.count))
    opened, left = open_contacts(surface, tight, 0.004, limit=lambda pose: tight)
    assert np.array_equal(opened, tight)
    assert left == len(surface.close_pairs(tight, 0.004)) > 0


def test_an_open_pose_stays() -> None:
    points, faces = loosely_solved("knot")[0].rest, loosely_solved("knot")[0].faces
    surface = Surface(points, faces)
    opened, left = open_contacts(surface, surface.rest, 1e-4)
    assert left == 0 and np.array_equal(opened, surface.rest)
