"""Steps from gradients: descent, two kinds of Adam, MomentumBrake. Pure: state in, state out.

The gradients are diffused ones (`dtrepair.repair.paper.diffusion`), with a batch axis; frames never
influence each other. The arithmetic has no branch on data, so it can be captured in a CUDA graph.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from dtrepair.repair.options import RepairOptions


class Moments(NamedTuple):
    """State of an optimiser."""

    step: Tensor
    """Number of updates so far (B,)."""
    first: Tensor
    """Running mean of the gradients (B, V, 3)."""
    second: Tensor
    """Running mean of the squared gradients (B, V, 3)."""

    def of_frames(self, frames: Tensor) -> Moments:
        """Return the state of some frames (indices or mask)."""
        return Moments(*(part[frames] for part in self))


class Optimizer(Protocol):
    """Turns a gradient into a step; `moments_between` says which gradient it wants to see."""

    @property
    def moments_between(self) -> bool:
        """True: update between the two diffusion solves; False: after both."""
        ...

    def __call__(self, moments: Moments, gradient: Tensor) -> tuple[Tensor, Moments]:
        """Return the step to subtract (B, V, 3) and the next state."""
        ...


def start(points: Tensor) -> Moments:
    """Return the state before the first update of points (B, V, 3)."""
    step = torch.zeros(points.shape[0], dtype=torch.int64, device=points.device)
    return Moments(step, torch.zeros_like(points), torch.zeros_like(points))


@dataclass(frozen=True, kw_only=True)
class GradientDescent:
    """step = rate x gradient.

    Args:
        rate: The learning rate. The published one, 10, belongs to pairs whose rows were mixed up,
            which weakens the force: with the right pairing it overshoots on deep contacts. 3 to 5
            leaves the fewest triangles on bodies, and knots need a few iterations either way.
        moments_between: See `Optimizer`.
    """

    rate: float = 5.0
    moments_between: bool = False

    def __call__(self, moments: Moments, gradient: Tensor) -> tuple[Tensor, Moments]:
        """Return the step to subtract (B, V, 3) and the next state."""
        return self.rate * gradient, moments._replace(step=moments.step + 1)


@dataclass(frozen=True, kw_only=True)
class UniformAdam:
    """Adam with one scale for all numbers of a frame (Nicolet et al. 2021, section 3.3).

    The step is rate x mean / sqrt(max of the mean squares), before the second diffusion.

    Args:
        rate: A length in units of the size, several times the largest displacement of an iteration.
            At 0.03 most meshes are not done after 60 iterations, at 0.2 deep contacts diverge.
        beta1: Memory of the mean, that of MomentumBrake; 0.9 changes little.
        beta2: Memory of the mean square.
        moments_between: See `Optimizer`.
    """

    rate: float = 0.07
    beta1: float = 0.99
    beta2: float = 0.999
    moments_between: bool = True

    def __call__(self, moments: Moments, gradient: Tensor) -> tuple[Tensor, Moments]:
        """Return the step to subtract (B, V, 3) and the next state."""
        step = moments.step + 1
        first = self.beta1 * moments.first + (1.0 - self.beta1) * gradient
        second = self.beta2 * moments.second + (1.0 - self.beta2) * gradient**2
        largest = (second / _correction(self.beta2, step, gradient)).amax(dim=(1, 2), keepdim=True)
        scale = self.rate / largest.sqrt().clamp_min(torch.finfo(gradient.dtype).tiny ** 0.5)
        return scale * first / _correction(self.beta1, step, gradient), Moments(step, first, second)


@dataclass(frozen=True, kw_only=True)
class Adam:
    """Adam with a scale for each number (Kingma & Ba 2015): what a smooth field is torn by.

    A baseline of the paper (figure 6c): small and large gradients make steps of one length.

    Args:
        rate: A length in units of the size, about the motion of an iteration before diffusion. At
            0.002 knots are not done after 60 iterations, at 0.05 bodies are torn.
        beta1: Memory of the mean, as published for Adam.
        beta2: Memory of the mean square.
        least: Added to the root mean square, as published; no gradient is no step.
        moments_between: See `Optimizer`.
    """

    rate: float = 0.01
    beta1: float = 0.9
    beta2: float = 0.999
    least: float = 1e-8
    moments_between: bool = True

    def __call__(self, moments: Moments, gradient: Tensor) -> tuple[Tensor, Moments]:
        """Return the step to subtract (B, V, 3) and the next state."""
        step = moments.step + 1
        first = self.beta1 * moments.first + (1.0 - self.beta1) * gradient
        second = self.beta2 * moments.second + (1.0 - self.beta2) * gradient**2
        size = (second / _correction(self.beta2, step, gradient)).sqrt() + self.least
        mean = first / _correction(self.beta1, step, gradient)
        return self.rate * mean / size, Moments(step, first, second)


@dataclass(frozen=True, kw_only=True)
class MomentumBrake:
    """Momentum that is dropped where the gradient leaves its own band (Jang et al., Algorithm 1).

    Where the gradient differs from its running mean by more than `band` running standard deviations
    the momentum is replaced by the gradient.

    Args:
        rate: The learning rate, a little below gradient descent's because momentum adds up; the
            published 20 belongs to mixed-up pairs.
        beta1: Memory of the mean.
        beta2: Memory of the mean square.
        band: Half width of the band, standard deviations.
        warmup: Nothing is dropped in so many first updates, whose deviation is not yet known.
        mask: Whether one number ("component", the paper) or any of the three of a vertex
            ("vertex", the authors' code) is what leaves the band; the paper's is a little better.
        moments_between: The moments are those of the gradient after one solve, as in the authors'
            code, so that the second one smooths what the band cuts; after both (False, the paper's
            text) the cuts stay in the surface and more triangles are left.
    """

    rate: float = 3.0
    beta1: float = 0.99
    beta2: float = 0.999
    band: float = 3.0
    warmup: int = 10
    mask: str = "component"
    moments_between: bool = True

    def __call__(self, moments: Moments, gradient: Tensor) -> tuple[Tensor, Moments]:
        """Return the step to subtract (B, V, 3) and the next state."""
        step = moments.step + 1
        correction1 = _correction(self.beta1, step, gradient)
        correction2 = _correction(self.beta2, step, gradient)
        mean = moments.first / correction1
        variance = moments.second / correction2 - mean**2
        kept = (gradient - mean) ** 2 <= self.band**2 * variance
        if self.mask == "vertex":
            kept = kept.all(dim=-1, keepdim=True)
        kept = kept | (step <= self.warmup)[:, None, None]
        keep = self.beta1 * kept.to(gradient.dtype)
        first = torch.lerp(gradient, moments.first, keep.expand_as(gradient))
        second = self.beta2 * moments.second + (1.0 - self.beta2) * gradient**2
        return self.rate * first / correction1, Moments(step, first, second)


def _correction(beta: float, step: Tensor, like: Tensor) -> Tensor:
    """Return 1 - beta^step (B, 1, 1), the bias correction of a running mean that starts at zero."""
    return (1.0 - beta ** step.to(torch.float64)).to(like.dtype)[:, None, None]


@dataclass(frozen=True, kw_only=True)
class OptimizerOptions:
    """The optimisers that can be chosen, with their numbers.

    Args:
        gradient_descent: The plain one, of the paper's comparison.
        uniform_adam: A baseline.
        adam: Another one.
        momentum_brake: The published one.
    """

    gradient_descent: GradientDescent = GradientDescent()
    uniform_adam: UniformAdam = UniformAdam()
    adam: Adam = Adam()
    momentum_brake: MomentumBrake = MomentumBrake()

    @property
    def by_name(self) -> dict[str, GradientDescent | UniformAdam | Adam | MomentumBrake]:
        """The optimisers by the names that a user gives."""
        return {
            "gradient-descent": self.gradient_descent,
            "uniform-adam": self.uniform_adam,
            "adam": self.adam,
            "momentum-brake": self.momentum_brake,
        }

    def suited(
        self, name: str, rate_factor: float
    ) -> GradientDescent | UniformAdam | Adam | MomentumBrake:
        """Return the optimiser of a name at the rate that suits an energy (`Kernel.rate_factor`).

        UniformAdam and Adam take no notice of the size of forces.
        """
        optimizer = self.by_name[name]
        if isinstance(optimizer, GradientDescent | MomentumBrake):
            return replace(optimizer, rate=rate_factor * optimizer.rate)
        return optimizer

    def chosen(self, choices: RepairOptions, rate_factor: float) -> Optimizer:
        """Return the optimiser that a user chose, with the numbers that were given for it."""
        optimizer = self.suited(choices.optimizer, rate_factor)
        rate = choices.learning_rate
        if rate is not None:
            optimizer = replace(optimizer, rate=rate)
        if isinstance(optimizer, MomentumBrake):
            band, mask = choices.brake_band, choices.brake_mask
            optimizer = replace(
                optimizer,
                band=optimizer.band if band is None else band,
                mask=optimizer.mask if mask is None else mask,
            )
        return optimizer
