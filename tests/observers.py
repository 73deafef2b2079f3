"""Observers for tests: one that writes down what it hears, one that ends a run."""

from __future__ import annotations

from dtrepair.pipeline.observer import Observer, Remark


class Recorder(Observer):
    """Keeps all that it hears; ends the run when asked for the time number `end_at`."""

    def __init__(self, end_at: int | None = None) -> None:
        self.end_at = end_at
        self.asked = 0
        self.phases: list[tuple[str, int]] = []
        self.steps: list[float] = []
        self.ends = 0
        self.warnings: list[str] = []
        self.remarks: list[Remark] = []

    def start(self, phase: str, total: int) -> None:
        self.phases.append((phase, total))

    def advance(self, done: float) -> None:
        self.steps.append(done)

    def end(self) -> None:
        self.ends += 1

    def warning(self, text: str) -> None:
        self.warnings.append(text)

    def remark(self, remark: Remark) -> None:
        self.remarks.append(remark)

    def cancelled(self) -> bool:
        self.asked += 1
        return self.end_at is not None and self.asked >= self.end_at
