"""Steps from gradients: gradient descent, UniformAdam, MomentumBrake. Pure: state in, state out.

The gradients are diffused ones (`dtrepair.repair.paper.diffusion`), with a batch axis; frames never
influence each other. The arithmetic has no branch on data, so it can be captured in a CUDA graph.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

import torch
from torch import Tensor


class Moments(NamedTuple):
    """State of an optimiser."""

    step: Tensor
    """Number of updates so far (B,)."""
    first: Tensor
    """Running mean of the gradients (B, V, 3)."""
    second: Tensor
    """Running mean of the squared gradients (B, V, 3)."""

    def of_frames(self, frames: Tensor) -> Moments:
        """The state of some frames (indices or mask)."""
        return Moments(*(part[frames] for part in self))


class Optimizer(Protocol):
    """Turns a gradient into a step; `moments_between` says which gradient it wants to see."""

    @property
    def moments_between(self) -> bool:
        """True: update between the two diffusion solves; False: after both."""
        ...

    def __call__(self, moments: Moments, gradient: Tensor) -> tuple[Tensor, Moments]:
        """The step to subtract (B, V, 3) and the next state."""
        ...


def start(points: Tensor) -> Moments:
    """State before the first update of points (B, V, 3)."""
    step = torch.zeros(points.shape[0], dtype=torch.int64, device=points.device)
    return Moments(step, torch.zeros_like(points), torch.zeros_like(points))


@dataclass(frozen=True, kw_only=True)
class GradientDescent:
    """step = rate x gradient.

    The published rate, 10, belongs to pairs whose rows were mixed up, which weakens the force: with
    the right pairing it overshoots on deep contacts. 3 to 5 leaves the fewest triangles on bodies,
    and knots need a few iterations either way.
    """

    rate: float = 5.0
    moments_between: bool = False

    def __call__(self, moments: Moments, gradient: Tensor) -> tuple[Tensor, Moments]:
        """The step to subtract (B, V, 3) and the next state."""
        return self.rate * gradient, moments._replace(step=moments.step + 1)


@dataclass(frozen=True, kw_only=True)
class UniformAdam:
    """Adam with one scale for all numbers of a frame (Nicolet et al. 2021, section 3.3).

    The step is rate x mean / sqrt(max of the mean squares), before the second diffusion: `rate` is
    a length, several times the largest displacement of an iteration. At 0.03 most meshes are not
    done after 60 iterations, at 0.2 deep contacts diverge. beta1 is that of MomentumBrake; 0.9
    changes little.
    """

    rate: float = 0.07
    beta1: float = 0.99
    beta2: float = 0.999
    moments_between: bool = True

    def __call__(self, moments: Moments, gradient: Tensor) -> tuple[Tensor, Moments]:
        """The step to subtract (B, V, 3) and the next state."""
        step = moments.step + 1
        first = self.beta1 * moments.first + (1.0 - self.beta1) * gradient
        second = self.beta2 * moments.second + (1.0 - self.beta2) * gradient**2
        largest = (second / _correction(self.beta2, step, gradient)).amax(dim=(1, 2), keepdim=True)
        scale = self.rate / largest.sqrt().clamp_min(torch.finfo(gradient.dtype).tiny ** 0.5)
        return scale * first / _correction(self.beta1, step, gradient), Moments(step, first, second)


@dataclass(frozen=True, kw_only=True)
class MomentumBrake:
    """Momentum that is dropped where the gradient leaves its own band (Jang et al., Algorithm 1).

    Where the gradient differs from its running mean by more than `band` running standard deviations
    the momentum is replaced by the gradient, from update `warmup` + 1 on.

    `mask` says whether one number ("component", the paper) or any of the three of a vertex
    ("vertex", the authors' code) is what leaves the band; the paper's is a little better. The
    moments are those of the gradient after one solve, as in the authors' code, so that the second
    one smooths what the band cuts; after both (`moments_between=False`, the paper's text) the cuts
    stay in the surface and more triangles are left. The rate is a little below gradient descent's
    because momentum adds up; the published 20 belongs to mixed-up pairs.
    """

    rate: float = 3.0
    beta1: float = 0.99
    beta2: float = 0.999
    band: float = 3.0
    warmup: int = 10
    mask: Literal["component", "vertex"] = "component"
    moments_between: bool = True

    def __call__(self, moments: Moments, gradient: Tensor) -> tuple[Tensor, Moments]:
        """The step to subtract (B, V, 3) and the next state."""
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
    """1 - beta^step (B, 1, 1), the bias correction of a running mean that starts at zero."""
    return (1.0 - beta ** step.to(torch.float64)).to(like.dtype)[:, None, None]


OPTIMIZERS: dict[str, type[Optimizer]] = {
    "gradient-descent": GradientDescent,
    "uniform-adam": UniformAdam,
    "momentum-brake": MomentumBrake,
}

# Forces of the other energies have other units and sizes; UniformAdam takes no notice of them.
_RATE_FACTORS = {"signed-tpe": 1.0, "tpe": 1.0, "point-to-plane": 100.0, "conical": 2.0}


def make_optimizer(name: str, *, energy: str = "signed-tpe") -> Optimizer:
    """The optimiser of this name with the rate that suits the energy (`energy.KERNELS`)."""
    factor = _RATE_FACTORS[energy]
    if name == "gradient-descent":
        return GradientDescent(rate=factor * GradientDescent.rate)
    if name == "momentum-brake":
        return MomentumBrake(rate=factor * MomentumBrake.rate)
    return OPTIMIZERS[name]()
