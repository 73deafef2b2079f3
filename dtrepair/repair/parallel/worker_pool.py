"""The frames of a window side by side: in forked processes, or on threads where none can be had."""

from __future__ import annotations

import mmap
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from dtrepair.numerics.work import add_work, counted, work_done
from dtrepair.repair.parallel.process_pool import (
    ATTEMPTS,
    WorkerLost,
    can_fork,
    end,
    fork,
    packed,
    unpacked,
)
from dtrepair.repair.surface.surface import Surface

Item = TypeVar("Item")
Answer = TypeVar("Answer")
# Called here, not in workers, with the share of some work that is done, 0 to 1.
Told = Callable[[float], None]


@dataclass(frozen=True, kw_only=True)
class PoolOptions:
    """When workers are worth their start.

    Args:
        smallest_window: Windows of fewer triangles, of all frames together, are done before
            workers have started.
        frames_a_worker: Workers have at least so many frames: more of them would wait for each
            other, and need memory.
    """

    smallest_window: int = 5000
    frames_a_worker: int = 4


class State(Protocol):
    """What a pool works on: an object whose methods take a surface and an item, often a frame."""

    surface: Surface


class WorkerPool:
    """Calls methods of one object at a time, for many frames; this base does so one by one.

    Arrays of `array` are the same for all workers; all else that a method changes is known to the
    worker that did it, which is always the same one for a frame, and here only by its answers.
    Their work is counted here too, see `numerics.work`: it is the same for any number of workers.
    """

    # Called now and then, here only, with how many frames' worth of work is done.
    progress: Callable[[float], None] | None = None

    def array(self, shape: Sequence[int], kind: DTypeLike = np.float64) -> NDArray[Any]:
        """Return a new array of zeros that all workers share, if it is made before `start`."""
        return np.zeros(shape, dtype=kind)

    def start(self, state: State) -> None:
        """Work on `state` from now on."""
        self.state = state

    def map(
        self, name: str, items: Sequence[Any], *more: Any, told: Told | None = None
    ) -> list[Any]:
        """Return the answers of state.name(surface, item, *more) in the order of the items.

        told: called after each item that is done here; workers are taken to be as far.
        """
        answers = []
        for number, item in enumerate(items, 1):
            answers.append(getattr(self.state, name)(self.state.surface, item, *more))
            if told is not None:
                told(number / len(items))
        return answers

    def tell(self, name: str, *more: Any) -> None:
        """Call state.name(*more) wherever work is done."""
        getattr(self.state, name)(*more)

    def stop(self) -> None:
        """End all workers."""

    def __enter__(self) -> WorkerPool:
        """Return the pool itself; leaving ends its workers."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the workers."""
        self.stop()


class ThreadWorkerPool(WorkerPool):
    """Threads that share one surface."""

    def __init__(self, jobs: int) -> None:
        """Work on `jobs` threads."""
        self.jobs = jobs
        self._pool: ThreadPoolExecutor | None = None

    def start(self, state: State) -> None:
        """Work on `state` from now on."""
        super().start(state)
        self._pool = self._pool or ThreadPoolExecutor(self.jobs)

    def map(
        self, name: str, items: Sequence[Any], *more: Any, told: Told | None = None
    ) -> list[Any]:
        """Return the answers of state.name(surface, item, *more) in the order of the items."""

        def call(item: Any) -> tuple[Any, float]:
            method = getattr(self.state, name)
            return counted(partial(method, self.state.surface, item, *more))

        assert self._pool is not None
        answers = []
        for answer, work in self._pool.map(call, items):
            answers.append(answer)
            add_work(work)
            if told is not None:
                told(len(answers) / len(items))
        return answers

    def stop(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None


class ProcessWorkerPool(WorkerPool):
    """Processes that inherit the object when work on it starts; this one takes its share too.

    Raises WorkerLost where one has ended: what it knew of its frames is lost, and work must start
    over.

    Threads gain little here: sparse solves and small numpy calls keep the interpreter's lock.
    """

    def __init__(self, jobs: int) -> None:
        """Work in `jobs` processes, this one among them."""
        self.jobs = jobs
        self._workers: list[tuple[int, Connection]] = []

    def array(self, shape: Sequence[int], kind: DTypeLike = np.float64) -> NDArray[Any]:
        """Return a new array of zeros in memory that processes forked later share."""
        size = int(np.prod(shape)) * np.dtype(kind).itemsize
        return np.frombuffer(mmap.mmap(-1, max(size, 1)), kind, int(np.prod(shape))).reshape(shape)

    def start(self, state: State) -> None:
        """Fork: what `state` is now is what each worker goes on from."""
        super().start(state)
        self.stop()
        for _ in range(1, self.jobs):
            here, there = Pipe()
            self._workers.append((fork(partial(self._serve, there)), here))
            there.close()

    def map(
        self, name: str, items: Sequence[Any], *more: Any, told: Told | None = None
    ) -> list[Any]:
        """Return the answers of state.name(surface, item, *more) in the order of the items."""
        owners = np.array(
            [(item if isinstance(item, int) else k) % self.jobs for k, item in enumerate(items)],
            dtype=np.int64,
        )
        shares = [np.flatnonzero(owners == worker).tolist() for worker in range(self.jobs)]
        for worker, share in enumerate(shares[1:], 1):
            if len(share):
                self._ask(worker, name, [items[k] for k in share], more)
        answers: list[Any] = [None] * len(items)
        for worker, share in enumerate(shares):
            if not len(share):
                continue
            own = [items[k] for k in share]
            if worker == 0:
                found = super().map(name, own, *more, told=told)
            else:
                found, work = self._answer(worker)
                add_work(work)
            for k, answer in zip(share, found, strict=True):
                answers[k] = answer
        return answers

    def tell(self, name: str, *more: Any) -> None:
        """Call state.name(*more) in every process."""
        for worker in range(1, self.jobs):
            self._ask(worker, name, None, more)
        super().tell(name, *more)
        for worker in range(1, self.jobs):
            self._answer(worker)

    def stop(self) -> None:
        """End the workers."""
        for process, connection in self._workers:
            end(process)
            connection.close()
        self._workers = []

    def _ask(self, worker: int, *call: Any) -> None:
        with suppress(ConnectionError):  # it has ended: no answer will come
            self._workers[worker - 1][1].send(call)

    def _answer(self, worker: int) -> Any:
        try:
            content = self._workers[worker - 1][1].recv_bytes()
        except (EOFError, ConnectionError):
            content = b""
        return unpacked(content)

    def _serve(self, connection: Connection) -> None:
        """In a worker: do what is asked for, until this process is ended."""
        while True:
            call = partial(self._called, *connection.recv())
            connection.send_bytes(packed(partial(counted, call)))

    def _called(self, name: str, items: Sequence[Any] | None, more: tuple[Any, ...]) -> Any:
        return super().tell(name, *more) if items is None else super().map(name, items, *more)


def make_worker_pool(surface: Surface, jobs: int | None = None) -> WorkerPool:
    """Return a pool of `jobs` workers, None for one a processor, for objects of one surface."""
    jobs = jobs or available_processors()
    if jobs == 1:
        return WorkerPool()
    # Everything lazy that frames need is made now, once, before surfaces are shared.
    surface.diffuse(np.zeros((surface.count, 3)), surface.rest)
    surface.vector_areas(surface.rest)
    surface.contacts.pairs(surface.rest)
    surface.contacts.folds(surface.rest)
    surface.contacts.ring_distance(np.array([[0, len(surface.faces) - 1]], dtype=np.int32))
    if not can_fork():
        return ThreadWorkerPool(jobs)
    surface.device.load()
    return ProcessWorkerPool(jobs)


def with_workers(
    surface: Surface, jobs: int | None, work: Callable[[WorkerPool], Answer]
) -> Answer:
    """Return what `work` makes of a pool for so many jobs.

    Where a worker is lost all of it is done again, with fewer of them: memory may have run out.
    Raises WorkerLost where that happens again and again.
    """
    begun = work_done()
    for attempt in range(1, ATTEMPTS + 1):
        try:
            with make_worker_pool(surface, jobs) as pool:
                # What starts workers does not count, nor what was lost with one.
                add_work(begun - work_done())
                return work(pool)
        except WorkerLost:
            if attempt == ATTEMPTS:
                raise
            jobs = max(2, (jobs or available_processors()) // 2)
    raise AssertionError("the last attempt returns or raises")


def worthwhile_jobs(
    jobs: int | None, frames: int, triangles: int, *, options: PoolOptions = PoolOptions()
) -> int:
    """Return how many of `jobs` workers (None: one a processor) a window of frames is worth."""
    if frames * triangles < options.smallest_window:
        return 1
    return max(1, min(jobs or available_processors(), frames // options.frames_a_worker))


def available_processors() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def side_by_side(
    function: Callable[[Item], Answer], items: list[Item], *, jobs: int | None
) -> list[Answer]:
    """Return the answers in order, on threads: detection releases the interpreter."""
    if (jobs := jobs or available_processors()) == 1:
        return [function(item) for item in items]
    with ThreadPoolExecutor(jobs) as pool:
        return list(pool.map(function, items))
