"""Clearance: contacts opened to a distance, or as far as there is room."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair import RepairOptions, repair
from dtrepair.intersect.detector import Detector
from dtrepair.intersect.proximity import close_pairs, face_each_other
from dtrepair.repair.full.clearance import open_contacts
from dtrepair.repair.full.relax import relax
from dtrepair.repair.surface.defects import find_defects
from dtrepair.repair.surface.surface import Surface
from tests.meshes import knot
from tests.repair.full.test_pull_back import loosely_solved


@pytest.mark.parametrize("kind", ["knot", "arm"])
def test_contacts_open_to_the_clearance(kind: str) -> None:
    surface, original, clean = loosely_solved(kind)
    reach = np.ones(surface.count)
    tight, _ = relax(surface, original, clean, cycles=8, folds=0, reach=reach)
    clearance = 0.004
    before = len(surface.contacts.close_pairs(tight, clearance))
    assert before > 10
    opened, left = open_contacts(surface, tight, clearance)
    assert left == len(surface.contacts.close_pairs(opened, clearance)) == 0
    assert find_defects(surface, opened).rank[0] == 0
    # It opens the contacts and nothing else.
    assert np.linalg.norm(opened - tight, axis=1).max() < 3 * clearance


def test_without_room_the_best_pose_is_kept_and_the_rest_counted() -> None:
    surface, original, clean = loosely_solved("knot")
    tight, _ = relax(surface, original, clean, cycles=8, folds=0, reach=np.ones(surface.count))
    opened, left = open_contacts(surface, tight, 0.004, limit=lambda pose: tight)
    assert np.array_equal(opened, tight)
    assert left == len(surface.contacts.close_pairs(tight, 0.004)) > 0


def test_an_open_pose_stays() -> None:
    points, faces = loosely_solved("knot")[0].rest, loosely_solved("knot")[0].faces
    surface = Surface(points, faces)
    opened, left = open_contacts(surface, surface.rest, 1e-4)
    assert left == 0 and np.array_equal(opened, surface.rest)


def test_a_mesh_without_a_rest_pose_opens_its_contacts_as_well() -> None:
    points, faces = knot()
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    wanted = 0.01 * size
    contacts = Surface(points, faces).contacts
    near = []
    for clearance in (0.0, wanted):
        result = repair(points, faces, options=RepairOptions(clearance=clearance))
        assert result.status == "clean" and not result.message
        pairs = close_pairs(Detector(points, faces), result.points.astype(np.float32), wanted)
        across = pairs[face_each_other(result.points, faces, pairs)]
        near.append(int((contacts.ring_distance(across) > contacts.neighbour_rings).sum()))
    assert near[0] > 10 and near[1] == 0


def test_a_clearance_beyond_all_reason_is_refused() -> None:
    points, faces = knot()
    with pytest.raises(ValueError, match=r"clearance should be at most .*, 5% of the diagonal"):
        repair(points, faces, options=RepairOptions(clearance=100.0))
