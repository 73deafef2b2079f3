"""The published loop (Jang et al. 2025, section 5): detect, push apart, diffuse, step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from dtrepair.repair.options import RepairOptions
from dtrepair.repair.paper.corner_energy import Kernel, SignedTangentPoint
from dtrepair.repair.paper.diffusion import Diffuser
from dtrepair.repair.paper.energy import mean_square_strength, pair_energy, shape_term
from dtrepair.repair.paper.optimizer import Moments, MomentumBrake, Optimizer, start

# Intersecting triangles of a frame that was not measured.
NOT_MEASURED = -1


@dataclass(frozen=True, kw_only=True)
class Descent:
    """The published method for one topology; call it with poses.

    Args:
        faces: Triangles (F, 3), int64.
        detect: Poses (B, V, 3) -> intersecting pairs (K, 3): frame, triangle, triangle; sorted.
        diffusion: The diffusion operator of the mesh (or of its bodies).
        laplacian: Applies L to (B, V, 3), for the shape term.
        kernel: The energy.
        optimizer: What makes a step of a diffused gradient.
        iterations: At most this many steps.
        regularization: beta of the shape term, times the mean square (1e6 in the paper).
        direction: Preferred direction (F, 3) of the triangles of a region (section 7.4).
        runaway: A frame that moved this far, in units of its size, has diverged and can be no
            result.
    """

    faces: Tensor
    detect: Callable[[Tensor], Any]
    diffusion: Diffuser
    laplacian: Callable[[Tensor], Tensor]
    kernel: Kernel = field(default_factory=SignedTangentPoint)
    optimizer: Optimizer = field(default_factory=MomentumBrake)
    iterations: int = RepairOptions.iterations
    regularization: float = RepairOptions.regularization
    direction: Tensor | None = None
    runaway: float = 1.0

    def __call__(self, points: Tensor) -> DescentResult:
        """Repair poses (B, V, 3) of unit size; frames are independent of each other.

        Frames that are clean stop, as do frames that diverge: those never count as clean.
        """
        record = _Record(points, len(self.faces))
        target = self.laplacian(points)
        alive = torch.arange(len(points), device=points.device)
        current, moments = points.clone(), start(points)
        for iteration in range(self.iterations + 1):
            sound = _is_sound(current, points[alive], self.runaway)
            if not bool(sound.all()):
                record.diverged[alive[~sound]] = True
                alive, current, moments = alive[sound], current[sound], moments.of_frames(sound)
            pairs = self._pairs(current) if len(alive) else None
            if pairs is None:
                break
            triangles = triangle_counts(pairs, len(alive), len(self.faces))
            record.measure(iteration, alive, current, triangles)
            going = triangles > 0
            if iteration == self.iterations or not bool(going.any()):
                break
            if not bool(going.all()):
                index = torch.cumsum(going, 0) - 1
                pairs = torch.cat([index[pairs[:, :1]], pairs[:, 1:]], dim=1)
                alive, current, moments = alive[going], current[going], moments.of_frames(going)
            current, moments = self.step(current, pairs, target[alive], moments)
        return record.result()

    def step(
        self, points: Tensor, pairs: Tensor, target: Tensor, moments: Moments
    ) -> tuple[Tensor, Moments]:
        """Return points (B, V, 3) and state after a step, from pairs (K, 3) and delta (B, V, 3)."""
        _, gradient = pair_energy(
            points, self.faces, pairs, kernel=self.kernel, direction=self.direction
        )
        step, moments = self.move(points, gradient, target, moments)
        return points - step, moments

    def move(
        self, points: Tensor, gradient: Tensor, target: Tensor, moments: Moments
    ) -> tuple[Tensor, Moments]:
        """Return the step (B, V, 3) to subtract, and the state, from the gradient of the energy."""
        if self.regularization:
            strength = mean_square_strength(self.regularization, points.shape[1])
            _, shape = shape_term(points, target, laplacian=self.laplacian, strength=strength)
            gradient = gradient + shape
        if self.optimizer.moments_between:
            step, moments = self.optimizer(moments, self.diffusion.begin(gradient))
            return self.diffusion.finish(step), moments
        return self.optimizer(moments, self.diffusion(gradient))

    def _pairs(self, points: Tensor) -> Tensor:
        return torch.as_tensor(self.detect(points), device=points.device).long()


@dataclass(frozen=True)
class DescentResult:
    """Outcome of the loop, frame by frame."""

    points: Tensor
    """The iterate with the fewest intersecting triangles (B, V, 3)."""
    triangles: Tensor
    """Its number of intersecting triangles (B,), int64; -1 for an input that is not finite."""
    iterations: Tensor
    """Steps that lead to it (B,), int64; 0: no step was better than the input."""
    diverged: Tensor
    """Whether the frame was stopped because it left its place (B,), bool."""
    history: Tensor
    """Intersecting triangles before each step (iterations + 1, B); -1 where not measured."""


def triangle_counts(pairs: Tensor, frames: int, faces: int) -> Tensor:
    """Return the number of distinct triangles (frames,) in pairs (K, 3), int64."""
    seen = torch.zeros((frames, faces), dtype=torch.bool, device=pairs.device)
    seen[pairs[:, 0], pairs[:, 1]] = True
    seen[pairs[:, 0], pairs[:, 2]] = True
    return seen.sum(dim=1)


def _is_sound(points: Tensor, origin: Tensor, runaway: float) -> Tensor:
    """Return which frames (B,) are finite and near their origin: NaN fails the comparison."""
    return (points - origin).abs().amax(dim=(1, 2)) <= runaway


class _Record:
    """Best iterate and history while the loop runs."""

    def __init__(self, points: Tensor, faces: int) -> None:
        frames = len(points)
        self.points = points.clone()
        self.triangles = torch.full((frames,), faces + 1, device=points.device)
        self.iterations = torch.zeros_like(self.triangles)
        self.diverged = torch.zeros(frames, dtype=torch.bool, device=points.device)
        self.rows: list[Tensor] = []

    def measure(self, iteration: int, frames: Tensor, points: Tensor, triangles: Tensor) -> None:
        """Note the counts (N,) of some frames (N,) and keep those iterates that are better."""
        row = torch.full_like(self.triangles, NOT_MEASURED)
        row[frames] = triangles
        self.rows.append(row)
        better = triangles < self.triangles[frames]
        chosen = frames[better]
        self.points[chosen] = points[better]
        self.triangles[chosen] = triangles[better]
        self.iterations[chosen] = iteration

    def result(self) -> DescentResult:
        """Return the outcome; a frame that was never measured keeps its input."""
        shape = (0, len(self.triangles))
        history = torch.stack(self.rows) if self.rows else self.triangles.new_zeros(shape)
        measured = (history != NOT_MEASURED).any(dim=0)
        triangles = torch.where(measured, self.triangles, NOT_MEASURED)
        return DescentResult(self.points, triangles, self.iterations, self.diverged, history)
