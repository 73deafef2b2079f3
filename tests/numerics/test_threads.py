"""The bound on threads of linear algebra."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from functools import cache

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController, threadpool_limits

import dtrepair
from dtrepair.numerics import threads
from dtrepair.numerics.operators import Factor
from dtrepair.numerics.threads import one_thread
from dtrepair.repair.parallel.process_pool import can_fork, map_in_processes
from dtrepair.transfer import Pins, Transfer
from tests.meshes import bent_tube, icosphere


@cache
def libraries() -> ThreadpoolController:
    """The libraries of linear algebra, looked for once: that takes longer than a solve."""
    torch.ones(2).sum()  # loads OpenMP
    return ThreadpoolController()


def numbers() -> set[int]:
    """Threads that each library of linear algebra would use, called from this thread."""
    return {library["num_threads"] for library in libraries().info()}


@pytest.fixture(autouse=True)
def two() -> Iterator[None]:
    with threadpool_limits(2):
        if numbers() != {2}:
            pytest.skip("linear algebra has a single thread here")
        yield


def test_blocks_nest_and_restore_what_was_set() -> None:
    with one_thread():
        with one_thread():
            assert numbers() == {1}
        assert numbers() == {1}
    assert numbers() == {2}
    with pytest.raises(ValueError, match="failed"), one_thread():
        raise ValueError("failed")
    assert numbers() == {2}


def test_overlapping_blocks_of_several_threads_end_with_the_last() -> None:
    entered, left = threading.Event(), threading.Event()
    found: list[set[int]] = []

    def other() -> None:
        with one_thread():
            entered.set()
            assert left.wait(60)
            found.append(numbers())

    thread = threading.Thread(target=other)
    with one_thread():
        thread.start()
        assert entered.wait(60)
    left.set()
    thread.join()
    assert found == [{1}] and numbers() == {2}


@pytest.mark.skipif(not can_fork(), reason="needs processes that can be forked")
def test_a_forked_process_does_not_wait_for_threads_that_it_does_not_have() -> None:
    def enter(_: int) -> set[int]:
        signal.alarm(20)  # instead of waiting forever
        with one_thread():
            return numbers()

    with threads._shared.lock:
        assert list(map_in_processes(enter, range(2), jobs=2)) == [{1}, {1}]


def repair(method: str) -> None:
    rest, faces = bent_tube(0.0)
    repairer = dtrepair.Repairer(rest, faces, options=dtrepair.RepairOptions(method=method))
    repairer(bent_tube(6.5)[0])


def repair_clip() -> None:
    rest, faces = bent_tube(0.0)
    poses = np.stack([bent_tube(angle)[0] for angle in (6.4, 6.45, 6.5)])
    dtrepair.Repairer(rest, faces).animation(poses, jobs=1)


def transfer() -> Transfer:
    points, faces = icosphere(2)
    same = np.stack([np.arange(len(faces))] * 2, axis=1)
    return Transfer(points, faces, points, faces, same)


def transfer_pinned() -> None:
    points, free = icosphere(2)[0], transfer()
    Pins(free, [0, 5])(points, points[[0, 5]])


def register_spheres() -> None:
    points, faces = icosphere(2)
    six = np.array([[k, k] for k in (0, 20, 45, 70, 100, 130)])
    dtrepair.register(points, faces, 2.0 * points, faces, six)


CALLS: dict[str, Callable[[], object]] = {
    "full": lambda: repair("full"),
    "paper": lambda: repair("paper"),
    "clip": repair_clip,
    "transfer": transfer,
    "pins": transfer_pinned,
    "registration": register_spheres,
}


@pytest.mark.parametrize("name", CALLS)
def test_the_library_solves_on_one_thread(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    found, solve = [], Factor.__call__

    def watched(factor: Factor, right: NDArray[np.floating]) -> NDArray[np.float64]:
        found.append(numbers())
        return solve(factor, right)

    monkeypatch.setattr(Factor, "__call__", watched)
    CALLS[name]()
    assert found and all(each == {1} for each in found)
    assert numbers() == {2}
