"""Work is counted by what was done and not by the time that it took."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
from scipy import sparse

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.operators import Factor, patch_factor
from dtrepair.numerics.work import Repeats, add_work, counted, uncounted, work_done
from tests.meshes import icosphere


def test_a_thread_counts_its_own_work() -> None:
    before = work_done()
    add_work(2.5)
    assert work_done() - before == 2.5
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(work_done).result() == 0.0


def test_what_is_made_once_and_kept_does_not_count() -> None:
    def made() -> str:
        add_work(3.0)
        return "made"

    def failed() -> None:
        add_work(3.0)
        raise ValueError

    before = work_done()
    assert uncounted(made) == "made"
    with pytest.raises(ValueError):
        uncounted(failed)
    assert work_done() == before
    assert counted(made) == ("made", 3.0)
    assert work_done() - before == 3.0


def test_sums_do_not_depend_on_their_order() -> None:
    amounts, spent = [0.025, 1e4, 1.0, 0.175] * 100, list[float]()
    for own in (amounts, sorted(amounts), sorted(amounts)[::-1]):
        spent.append(counted(partial(list, map(add_work, own)))[1])
    assert spent[0] == spent[1] == spent[2] == pytest.approx(1e6 + 120.0)


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


def test_what_is_found_again_counts_as_much_work_as_the_first_time() -> None:
    poses, repeats, asked = [np.zeros((2, 3)), np.zeros((2, 3))], Repeats[int](), list[int]()

    def find() -> int:
        add_work(3.0)
        asked.append(len(asked))
        return asked[-1]

    before = work_done()
    # Poses are told apart as objects, and so are the choices by their values.
    calls = [(poses[0], 0.1), (poses[0], 0.1), (poses[1], 0.1), (poses[0], 0.2), (poses[0], 0.1)]
    assert [repeats(find, pose, choice) for pose, choice in calls] == [0, 0, 1, 2, 0]
    assert work_done() - before == 15.0
    assert asked == [0, 1, 2]


def test_a_pose_that_nobody_else_keeps_is_not_mistaken_for_another() -> None:
    repeats = Repeats[float]()
    for value in range(50):
        pose = np.full((2, 3), float(value))
        assert repeats(partial(pose.item, 0), pose) == value
        del pose
