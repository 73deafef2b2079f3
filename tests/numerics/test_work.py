"""Work is counted for each thread, by what was done and not by the time that it took."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy import sparse

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.operators import Factor, patch_factor
from dtrepair.numerics.work import add_work, work_done
from tests.meshes import icosphere


def test_a_thread_counts_its_own_work() -> None:
    before = work_done()
    add_work(2.5)
    assert work_done() - before == 2.5
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(work_done).result() == 0.0


def test_detections_count_what_they_look_at() -> None:
    points, faces = icosphere(2)
    detect = Detector(points, faces)
    before = work_done()
    detect(points)
    assert work_done() - before == len(faces)
    few = np.arange(len(faces)) < 10
    detect(np.stack([points, points]), active=few)
    assert work_done() - before == len(faces) + 20


def test_factorisations_and_solves_count() -> None:
    before = work_done()
    solve = Factor(sparse.identity(50, format="csc"))
    factored = work_done()
    assert factored > before
    solve(np.ones(50))
    one = work_done() - factored
    solve(np.ones((50, 3)))
    assert one > 0.0
    assert work_done() - factored == pytest.approx(4.0 * one)


def test_patches_count_by_their_rows() -> None:
    spent = []
    for rows in (10, 20):
        before = work_done()
        patch_factor(sparse.identity(rows, format="csc"))(np.ones((rows, 3)))
        spent.append(work_done() - before)
    assert 0.0 < spent[0] < spent[1]
