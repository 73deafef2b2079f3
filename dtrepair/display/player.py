"""Which frame of a clip is shown: chosen, played, or the next of the worst."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cached_property


class Player:
    """The frame that is shown.

    Args:
        count: Number of frames.
        severity: Index of a frame -> how bad it is, 0 where nothing is wrong.
        first: Index of the frame that is shown first.
        rate: Frames per second when it plays.
        now: A clock, seconds.
    """

    def __init__(
        self,
        count: int,
        severity: Callable[[int], int],
        *,
        first: int = 0,
        rate: float = 24.0,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self.count, self.index, self.playing = count, first, False
        self._severity, self._rate, self._now = severity, rate, now
        self._shown = now()

    def play(self, playing: bool) -> None:
        """Play from the frame that is shown, or stop there."""
        self.playing, self._shown = playing, self._now()

    def tick(self) -> bool:
        """Go on by a frame where it plays and it is time; return whether that changed the frame.

        Frames that take long to show are not skipped: each of them is seen.
        """
        if not self.playing or self._now() - self._shown < 1.0 / self._rate:
            return False
        self._shown = self._now()
        return self.go((self.index + 1) % self.count)

    def go(self, index: int) -> bool:
        """Show a frame; return whether it is another one."""
        changed, self.index = index != self.index, index
        return changed

    def next_worst(self) -> bool:
        """Show the worst frame, or after that the next in badness; return whether that changed.

        Looks at all frames the first time.
        """
        if not self.worst:
            return False
        place = self.worst.index(self.index) + 1 if self.index in self.worst else 0
        return self.go(self.worst[place % len(self.worst)])

    @cached_property
    def worst(self) -> list[int]:
        """The frames in which something is wrong, the worst first."""
        found = [(self._severity(index), index) for index in range(self.count)]
        return [index for bad, index in sorted(found, key=lambda own: -own[0]) if bad]
