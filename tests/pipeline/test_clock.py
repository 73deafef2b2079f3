"""The clock of a run: laps, and seconds from elsewhere."""

from __future__ import annotations

import time

import pytest

from dtrepair.pipeline.clock import Clock


def test_laps_skips_and_the_total(monkeypatch: pytest.MonkeyPatch) -> None:
    now = iter((10.0, 12.0, 15.0, 19.0, 24.0))
    monkeypatch.setattr(time, "perf_counter", lambda: next(now))
    watch = Clock()
    watch.lap("read")
    watch.skip()
    watch.add({"solve": 2.5, "read": 0.5})
    watch.lap("write")
    assert watch.seconds == {"read": 2.5, "solve": 2.5, "write": 4.0}
    assert watch.total() == {**watch.seconds, "total": 14.0}
