"""What a repair answers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.diagnosis import Diagnosis, Status, sentence


@dataclass(frozen=True)
class Count:
    """Intersecting triangles, pairs, and the pairs between two bodies among them."""

    triangles: int
    pairs: int
    inter_pairs: int = 0


@dataclass(frozen=True)
class Stage:
    """What one stage achieved.

    crossings and folds left after it; distortion of the pose it leaves (edge log-ratio rms + 2 x
    mean displacement over the diagonal); its iterations or cycles; wall seconds.
    """

    name: str
    crossings: int
    folds: int
    distortion: float
    iterations: int
    seconds: float


@dataclass(frozen=True)
class RepairResult:
    """A repaired pose.

    points: positions (V, 3), same type as the input; vertices that did not have to move are
    bit-identical. diagnosis: what is left, as values. Displacements are relative to the diagonal
    of the input's bounding box.
    """

    points: Any
    before: Count
    after: Count
    iterations: int
    status: Status
    diagnosis: Diagnosis = field(default_factory=Diagnosis)
    displacement_max: float = 0.0
    displacement_mean: float = 0.0
    stages: tuple[Stage, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def message(self) -> str:
        """What is left, and what may be done about it, in words; empty where nothing is."""
        return sentence(self.diagnosis, self.status)


@dataclass
class Solved:
    """What a method hands back: the pose in units of the surface's size, and its stages.

    left: pairs that are still closer than the clearance.
    """

    points: NDArray[np.float64]
    stages: list[Stage] = field(default_factory=list)
    left: int = 0

    @property
    def iterations(self) -> int:
        """Iterations of all stages."""
        return sum(stage.iterations for stage in self.stages)
