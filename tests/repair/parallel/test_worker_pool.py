"""Work on the frames of a window: here, on threads, and in forked processes, all alike."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable

import numpy as np
import pytest

from dtrepair.numerics.work import add_work, work_done
from dtrepair.repair.parallel.process_pool import ATTEMPTS, WorkerLost, can_fork
from dtrepair.repair.parallel.worker_pool import (
    ProcessWorkerPool,
    ThreadWorkerPool,
    WorkerPool,
    available_processors,
    make_worker_pool,
    with_workers,
    worthwhile_jobs,
)
from dtrepair.repair.surface.surface import BodyRange, Surface
from tests.meshes import icosphere

needs_fork = pytest.mark.skipif(not can_fork(), reason="needs processes that can be forked")
POOLS = [
    WorkerPool,
    lambda: ThreadWorkerPool(3),
    pytest.param(lambda: ProcessWorkerPool(3), marks=needs_fork),
]


class Work:
    """What worker pools work on here: frames that are counted and squared."""

    def __init__(self, pool: WorkerPool) -> None:
        self.surface = Surface(*icosphere(1))
        self.squares = pool.array((8, 2))
        self.calls = {frame: 0 for frame in range(8)}
        self.offset = 0

    def squared(self, surface: Surface, frame: int, factor: float) -> tuple[int, int, int]:
        assert surface.count == self.surface.count
        self.squares[frame] = factor * frame**2 + self.offset
        self.calls[frame] += 1
        return frame, self.calls[frame], os.getpid()

    def worked(self, surface: Surface, frame: int) -> None:
        add_work(frame)

    def asked(self, surface: Surface, frame: int) -> None:
        assert surface.cover.max() >= 0 and surface.arap_factor.size == surface.count
        surface.contacts.pairs((1.0 + 0.1 * frame) * surface.rest)

    def shift(self, offset: int) -> None:
        self.offset = offset

    def fail(self, surface: Surface, frame: int) -> None:
        raise ValueError(f"frame {frame}")

    def die(self, surface: Surface, frame: int) -> None:
        if frame == 1:
            os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize("make", POOLS)
def test_all_pools_work_alike(make: Callable[[], WorkerPool]) -> None:
    with make() as pool:
        work = Work(pool)
        pool.start(work)
        for call in (1, 2, 3):
            found = pool.map("squared", [5, 0, 2, 7], 10.0)
            assert [(frame, count) for frame, count, _ in found] == [
                (frame, call) for frame in (5, 0, 2, 7)
            ]
        assert work.squares[[5, 0, 2, 7, 3], 1].tolist() == [250, 0, 40, 490, 0]
        pool.tell("shift", 1)
        pool.map("squared", range(8), 1.0)
        assert np.array_equal(work.squares[:, 0], np.arange(8) ** 2 + 1)
        with pytest.raises(ValueError, match="frame 4"):
            pool.map("fail", [4])


@pytest.mark.parametrize("make", POOLS)
def test_pools_tell_how_far_they_are(make: Callable[[], WorkerPool]) -> None:
    with make() as pool:
        pool.start(Work(pool))
        told = list[float]()
        pool.map("squared", range(8), 1.0, told=told.append)
        assert len(told) > 1 and told[-1] == 1.0
        assert told == sorted(set(told)) and told[0] > 0.0
        pool.map("squared", [], 1.0, told=told.append)
        assert told[-1] == 1.0


@pytest.mark.parametrize("make", POOLS)
def test_pools_count_what_their_workers_did(make: Callable[[], WorkerPool]) -> None:
    with make() as pool:
        pool.start(Work(pool))
        begun = work_done()
        pool.map("worked", range(8))
        assert work_done() - begun == sum(range(8))


def test_work_does_not_depend_on_the_number_of_workers() -> None:
    """Neither on what each of them makes for itself, as factors and what covers what."""
    points, faces = icosphere(2)
    both = np.concatenate([points, 1.05 * points])
    bodies = [BodyRange(0, len(points), 99.0), BodyRange(len(points), len(both), 99.0)]
    spent = []
    for jobs in (1, 2, 3):
        faces_of_both = np.concatenate([faces, faces + len(points)])
        surface = Surface(both, faces_of_both, bodies=bodies, leave_rest=True)
        state = Work(WorkerPool())
        state.surface, begun = surface, work_done()

        def work(pool: WorkerPool, state: Work = state) -> None:
            pool.start(state)
            pool.map("asked", range(6))
            pool.map("asked", range(6))

        with_workers(surface, jobs, work)
        spent.append(work_done() - begun)
    assert spent == [12.0 * 2 * len(faces)] * 3


def test_work_that_a_lost_worker_makes_again_counts_once() -> None:
    pools: list[WorkerPool] = []

    def work(pool: WorkerPool) -> None:
        pools.append(pool)
        add_work(5.0)
        if len(pools) == 1:
            raise WorkerLost

    surface, begun = Surface(*icosphere(1)), work_done()
    with_workers(surface, 1, work)
    assert len(pools) == 2 and work_done() - begun == 5.0


@needs_fork
def test_processes_share_the_work_and_end() -> None:
    with ProcessWorkerPool(3) as pool:
        pool.start(Work(pool))
        workers = {process for _, _, process in pool.map("squared", range(8), 1.0)}
        assert len(workers) == 3 and os.getpid() in workers
        pool.start(Work(pool))
        others = {process for _, _, process in pool.map("squared", range(8), 1.0)}
        assert workers & others == {os.getpid()}
    for process in (workers | others) - {os.getpid()}:
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)


@needs_fork
def test_a_killed_worker_is_told() -> None:
    with ProcessWorkerPool(2) as pool:
        pool.start(Work(pool))
        with pytest.raises(WorkerLost, match="fewer jobs"):
            pool.map("die", [0, 1])
        for _ in range(2):  # and again, by those who ask
            with pytest.raises(WorkerLost):
                pool.map("squared", [0, 1], 1.0)
            with pytest.raises(WorkerLost):
                pool.tell("shift", 1)


@pytest.mark.parametrize("losses", [1, ATTEMPTS])
def test_what_lost_a_worker_is_done_again(losses: int) -> None:
    pools: list[WorkerPool] = []

    def work(pool: WorkerPool) -> int:
        pools.append(pool)
        if len(pools) <= losses:
            raise WorkerLost
        return len(pools)

    surface = Surface(*icosphere(1))
    if losses < ATTEMPTS:
        assert with_workers(surface, 2, work) == losses + 1
    else:
        with pytest.raises(WorkerLost):
            with_workers(surface, 2, work)
        assert len(pools) == ATTEMPTS


def test_small_windows_are_not_worth_workers() -> None:
    assert worthwhile_jobs(8, frames=64, triangles=30_000) == 8
    assert worthwhile_jobs(None, frames=64, triangles=30_000) == min(16, available_processors())
    assert worthwhile_jobs(8, frames=8, triangles=30_000) == 2
    assert worthwhile_jobs(8, frames=1, triangles=30_000) == 1
    assert worthwhile_jobs(8, frames=64, triangles=50) == 1


def test_one_job_makes_no_worker() -> None:
    surface = Surface(*icosphere(1))
    assert type(make_worker_pool(surface, 1)) is WorkerPool
    assert type(make_worker_pool(surface, 2)) is (
        ProcessWorkerPool if can_fork() else ThreadWorkerPool
    )
