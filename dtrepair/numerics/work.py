"""How much work was done: counted, not timed, so that results are the same on any machine.

The unit is the detection of one triangle's contacts. Counted are detections, Cholesky factors,
their solves and patches of fills, about half of what repairs do; with the rest a unit takes one and
a half to two and a half microseconds of a processor.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

T = TypeVar("T")


# Sums and differences of whole 64ths are exact, so they do not depend on their order.
_PARTS = 64


class _Counter(threading.local):
    total = 0


_COUNTER = _Counter()


def add_work(amount: float) -> None:
    """Count work of this thread, in units of a triangle's detection, to a 64th of it."""
    _COUNTER.total += round(_PARTS * amount)


def work_done() -> float:
    """Return what this thread has counted so far; only differences mean anything."""
    return _COUNTER.total / _PARTS


def counted(call: Callable[[], T]) -> tuple[T, float]:
    """Return what a call returns, and its work, which those can count who wait for its thread."""
    begun = _COUNTER.total
    found = call()
    return found, (_COUNTER.total - begun) / _PARTS


def uncounted(call: Callable[[], T]) -> T:
    """Return what a call returns; its work does not count.

    Of what is made once and kept: however many workers there are, each of them makes it.
    """
    begun = _COUNTER.total
    try:
        return call()
    finally:
        _COUNTER.total = begun


class Repeats(Generic[T]):
    """What functions found of the same poses before: the work is counted again, but not done.

    So those that stop after so much work stop where they would have stopped. Poses are known as
    objects, not by their values, and must not be changed.
    """

    def __init__(self) -> None:
        self._known: dict[tuple[Hashable, ...], tuple[object, T, float]] = {}

    def __call__(self, find: Callable[[], T], pose: object, *choices: Hashable) -> T:
        """Return what is found of a pose with some choices, for the first time or again."""
        key = (id(pose), *choices)
        if key in self._known:
            _, found, work = self._known[key]
            add_work(work)
            return found
        begun = work_done()
        found = find()
        # The pose is kept, so that no other object gets its number.
        self._known[key] = pose, found, work_done() - begun
        return found
