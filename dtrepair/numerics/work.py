"""How much work a thread has done: counted, not timed, so that results are the same on any machine.

The unit is one detection of a whole mesh, which most stages spend about half of their time on.
"""

from __future__ import annotations

import threading


class _Counter(threading.local):
    total = 0.0


_COUNTER = _Counter()


def add_work(amount: float) -> None:
    """Count work of this thread, in detections of a whole mesh."""
    _COUNTER.total += amount


def work_done() -> float:
    """Return what this thread has counted so far; only differences mean anything."""
    return _COUNTER.total
