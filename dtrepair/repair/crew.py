"""Frames side by side on threads: Warp's launches and numpy's loops release the interpreter."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue
from types import TracebackType
from typing import TypeVar

import numpy as np

from dtrepair.repair.surface import Surface

Item = TypeVar("Item")
Answer = TypeVar("Answer")


class Crew:
    """Threads that share one surface: one tree, one set of operators and factors.

    Only the answers that queries remember are each thread's own.
    """

    def __init__(self, surface: Surface, jobs: int | None = None) -> None:
        """Work on `jobs` threads; default: the processors this process may use."""
        self.jobs = jobs or available_processors()
        # Everything lazy that frames need is made now, once, before surfaces are shared.
        surface.diffuse(np.zeros((surface.count, 1)))
        surface.vector_areas(surface.rest)
        self._surfaces: SimpleQueue[Surface] = SimpleQueue()
        self._surfaces.put(surface)
        for _ in range(self.jobs - 1):
            other = copy.copy(surface)
            other.queries = copy.copy(surface.queries)
            self._surfaces.put(other)
        self._pool = ThreadPoolExecutor(self.jobs) if self.jobs > 1 else None

    def map(
        self, function: Callable[[Surface, Item], Answer], items: Iterable[Item]
    ) -> list[Answer]:
        """Answers of function(surface, item) in the order of the items."""

        def call(item: Item) -> Answer:
            surface = self._surfaces.get()
            try:
                return function(surface, item)
            finally:
                self._surfaces.put(surface)

        if self._pool is None:
            return [call(item) for item in items]
        return list(self._pool.map(call, items))

    def __enter__(self) -> Crew:
        """The crew itself; leaving ends its threads."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the threads."""
        self.close()

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()


def available_processors() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
