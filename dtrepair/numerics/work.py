"""How much work a thread has done: counted, not timed, so that results are the same on any machine.

The unit is the detection of one triangle's contacts. Counted are detections, Cholesky factors,
their solves and patches of fills, about half of what repairs do; with the rest a unit takes one and
a half to two and a half microseconds of a processor.
"""

from __future__ import annotations

import threading


class _Counter(threading.local):
    total = 0.0


_COUNTER = _Counter()


def add_work(amount: float) -> None:
    """Count work of this thread, in units of a triangle's detection."""
    _COUNTER.total += amount


def work_done() -> float:
    """Return what this thread has counted so far; only differences mean anything."""
    return _COUNTER.total
