"""What the stages of a repair of one pose achieved, in order."""

from __future__ import annotations

import time

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import distortion
from dtrepair.repair.result import Stage
from dtrepair.repair.surface.surface import Surface


class StageLog:
    """The stages of one pose (V, 3) so far, each with the distortion of the pose it left."""

    def __init__(self, surface: Surface, original: FloatArray) -> None:
        self.surface, self.original = surface, original
        self.stages: list[Stage] = []

    def add(
        self,
        name: str,
        points: FloatArray,
        start: float,
        *,
        crossings: int = 0,
        folds: int = 0,
        iterations: int = 0,
    ) -> float:
        """Note a stage that began at `start` (`perf_counter`); return the distortion it leaves."""
        value = distortion(self.original, points, self.surface.edges)
        seconds = time.perf_counter() - start
        self.stages.append(Stage(name, crossings, folds, value, iterations, seconds))
        return value
