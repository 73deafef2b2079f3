"""The seconds of the parts of a run."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping


class Clock:
    """Runs from when it is made; `seconds` of each part that was named so far."""

    def __init__(self) -> None:
        """Start."""
        self.seconds: dict[str, float] = {}
        self._start = self._last = clock.perf_counter()

    def lap(self, name: str) -> None:
        """Give the time since the last lap to a part."""
        now = clock.perf_counter()
        self.add({name: now - self._last})
        self._last = now

    def skip(self) -> None:
        """Give the time since the last lap to no part: it was measured otherwise."""
        self._last = clock.perf_counter()

    def add(self, seconds: Mapping[str, float]) -> None:
        """Add seconds that were measured elsewhere."""
        for name, value in seconds.items():
            self.seconds[name] = self.seconds.get(name, 0.0) + value

    def total(self) -> dict[str, float]:
        """Return the seconds of all parts, and of the whole as `total`."""
        return {**self.seconds, "total": clock.perf_counter() - self._start}
