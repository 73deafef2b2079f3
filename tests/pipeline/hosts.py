"""Hosts of a pipeline that remember what they heard, and may cancel."""

from __future__ import annotations

from dtrepair.pipeline import FrameDone, Observer
from dtrepair.pipeline.observer import Remark


class Listener(Observer):
    """Remembers all that it hears; cancels as soon as `frames` frames are finished.

    within: cancel as soon as more than this part of the frames is done, with those in work.
    """

    def __init__(self, frames: float = float("inf"), within: float = float("inf")) -> None:
        self.phases: list[tuple[str, int]] = []
        self.done: list[float] = []
        self.ended = 0
        self.warnings: list[str] = []
        self.remarks: list[Remark] = []
        self._frames, self._within = frames, within

    @property
    def times(self) -> list[float | None]:
        """Of the frames that were finished."""
        return [remark.record.time for remark in self.remarks if isinstance(remark, FrameDone)]

    def start(self, phase: str, total: int) -> None:
        self.phases.append((phase, total))

    def advance(self, done: float) -> None:
        self.done.append(done)

    def end(self) -> None:
        self.ended += 1

    def warning(self, text: str) -> None:
        self.warnings.append(text)

    def remark(self, remark: Remark) -> None:
        self.remarks.append(remark)

    def cancelled(self) -> bool:
        return len(self.times) >= self._frames or self.done[-1:] > [self._within]
