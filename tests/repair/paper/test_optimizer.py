"""Optimisers: known answers on constant, noisy and turning gradients."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import pytest
import torch

from dtrepair.repair.options import RepairOptions
from dtrepair.repair.paper.corner_energy import EnergyOptions
from dtrepair.repair.paper.optimizer import (
    Adam,
    GradientDescent,
    Moments,
    MomentumBrake,
    Optimizer,
    OptimizerOptions,
    UniformAdam,
    start,
)


def run(optimizer: Optimizer, gradients: torch.Tensor) -> tuple[list[torch.Tensor], Moments]:
    """Steps for gradients (T, B, V, 3)."""
    moments, steps = start(gradients[0]), []
    for gradient in gradients:
        step, moments = optimizer(moments, gradient)
        steps.append(step)
    return steps, moments


def noisy(count: int, seed: int = 0, mean: float = 1.0, noise: float = 0.1) -> torch.Tensor:
    """Gradients (count, 2, 5, 3) around a mean."""
    generator = torch.Generator().manual_seed(seed)
    shape = (count, 2, 5, 3)
    return mean + noise * torch.randn(shape, generator=generator, dtype=torch.float64)


def test_gradient_descent_is_rate_times_gradient() -> None:
    gradients = noisy(3)
    steps, moments = run(GradientDescent(rate=2.5), gradients)
    for step, gradient in zip(steps, gradients, strict=True):
        assert torch.equal(step, 2.5 * gradient)
    assert moments.step.tolist() == [3, 3]


@pytest.mark.parametrize("optimizer", [MomentumBrake(rate=3.0), UniformAdam(rate=3.0)], ids=str)
def test_constant_gradient_has_no_start_up_bias(optimizer: Optimizer) -> None:
    gradients = torch.ones(30, 1, 4, 3, dtype=torch.float64)
    steps, _ = run(optimizer, gradients)
    # Bias correction: the mean of equal gradients is that gradient, from the first step on. A
    # standard deviation of zero up to rounding may drop the momentum; the gradient is the same.
    for step in steps[:10]:
        assert (step - 3.0).abs().max() < 1e-9


def test_adam_makes_steps_of_one_length_whatever_the_gradients() -> None:
    gradients = torch.ones(12, 1, 2, 3, dtype=torch.float64)
    gradients[:, :, 1] *= 1e-3
    gradients[:, :, :, 2] = 0.0
    steps, moments = run(Adam(rate=0.5), gradients)
    for step in steps:
        assert (step[..., :2] - 0.5).abs().max() < 1e-4
        assert not step[..., 2].any()
    assert moments.step.tolist() == [12]


def test_given_numbers_replace_those_of_the_optimiser() -> None:
    numbers = OptimizerOptions()
    kept = numbers.chosen(RepairOptions(method="paper"), 1.0)
    assert kept == numbers.momentum_brake
    choices = RepairOptions(method="paper", learning_rate=2.0, brake_band=1.5, brake_mask="vertex")
    # A rate that was given is not scaled by what suits an energy.
    expected = MomentumBrake(rate=2.0, band=1.5, mask="vertex")
    assert numbers.chosen(choices, 100.0) == expected
    for name in numbers.by_name:
        chosen = numbers.chosen(RepairOptions(optimizer=name, learning_rate=0.25), 100.0)
        assert chosen == replace(numbers.by_name[name], rate=0.25)


def test_uniform_adam_keeps_the_proportions_and_ignores_the_scale() -> None:
    gradients = noisy(8, mean=0.0)
    steps, _ = run(UniformAdam(rate=0.1), gradients)
    scaled, _ = run(UniformAdam(rate=0.1), 1e3 * gradients)
    assert (steps[-1] - scaled[-1]).abs().max() < 1e-9
    first, _ = run(UniformAdam(rate=0.1), gradients[:1])
    largest = gradients[0].abs().amax(dim=(1, 2), keepdim=True)
    assert (first[0] - 0.1 * gradients[0] / largest).abs().max() < 1e-12


def test_momentum_brake_follows_the_running_mean_before_it_brakes() -> None:
    gradients = noisy(40)
    steps, moments = run(MomentumBrake(rate=1.0, beta1=0.9, warmup=40), gradients)
    weights = 0.9 ** torch.arange(39, -1, -1, dtype=torch.float64)
    expected = (weights[:, None, None, None] * gradients).sum(0) / weights.sum()
    assert (steps[-1] - expected).abs().max() < 1e-12
    assert moments.step.tolist() == [40, 40]


@pytest.mark.parametrize("mask", ["component", "vertex"])
def test_momentum_brake_drops_the_momentum_that_left_the_band(
    mask: Literal["component", "vertex"],
) -> None:
    optimizer = replace(MomentumBrake(rate=1.0), mask=mask)
    gradients = noisy(30, noise=0.01)
    gradients[-1, 0, 2, 1] = -5.0
    _, before = run(optimizer, gradients[:-1])
    _, after = run(optimizer, gradients)
    calm = MomentumBrake(rate=1.0, warmup=40)(before, gradients[-1])[1]
    reset = (after.first - calm.first).abs() > 1e-9
    expected = torch.zeros(2, 5, 3, dtype=torch.bool)
    expected[0, 2, 1] = True
    if mask == "vertex":
        expected[0, 2] = True
    assert torch.equal(reset, expected)
    assert torch.equal(after.first[expected], gradients[-1][expected])


@pytest.mark.parametrize("deviations, dropped", [(2.5, False), (-2.5, False), (3.5, True)])
def test_band_is_three_standard_deviations(deviations: float, dropped: bool) -> None:
    gradients = torch.ones(31, 1, 1, 3, dtype=torch.float64)
    gradients[::2] = 3.0
    optimizer = MomentumBrake(warmup=30)
    _, moments = run(optimizer, gradients)
    # The next update sees these moments with its own bias corrections.
    mean = moments.first / (1 - optimizer.beta1**32)
    deviation = (moments.second / (1 - optimizer.beta2**32) - mean**2).sqrt()
    assert 0.5 < float(deviation.mean()) < 1.5
    following = mean + deviations * deviation
    _, after = optimizer(moments, following)
    assert torch.equal(after.first, following) is dropped


def test_momentum_brake_waits_for_its_warm_up() -> None:
    for count, dropped in ((10, False), (11, True)):
        gradients = noisy(count, noise=0.01)
        gradients[-1] = -5.0
        _, moments = run(MomentumBrake(), gradients)
        assert torch.equal(moments.first, gradients[-1]) is dropped


@pytest.mark.parametrize("optimizer", OptimizerOptions().by_name.values(), ids=str)
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_frames_are_independent_inputs_untouched_and_zero_is_safe(
    optimizer: Optimizer, dtype: torch.dtype
) -> None:
    gradients = noisy(15).to(dtype)
    kept = gradients.clone()
    together, moments = run(optimizer, gradients)
    alone, moments_alone = run(optimizer, gradients[:, 1:])
    assert torch.equal(gradients, kept)
    assert torch.equal(together[-1][1:], alone[-1])
    for part, part_alone in zip(moments.of_frames(torch.tensor([1])), moments_alone, strict=True):
        assert torch.equal(part, part_alone)
    assert together[-1].dtype == dtype
    still, _ = run(optimizer, torch.zeros(12, 1, 4, 3, dtype=dtype))
    assert all(not step.any() for step in still)


@pytest.mark.parametrize("name", OptimizerOptions().by_name)
@pytest.mark.parametrize("energy", EnergyOptions().by_name)
def test_every_optimizer_has_a_rate_for_every_energy(name: str, energy: str) -> None:
    kernel, options = EnergyOptions().by_name[energy], OptimizerOptions()
    optimizer = options.suited(name, kernel.rate_factor)
    assert type(optimizer) is type(options.by_name[name])
    if energy == "signed-tpe" or name == "uniform-adam":
        assert optimizer == options.by_name[name]


def test_numbers_given_as_options_are_those_of_the_optimizer() -> None:
    options = OptimizerOptions(momentum_brake=MomentumBrake(rate=2.0, band=1.5))
    assert options.suited("momentum-brake", 3.0) == MomentumBrake(rate=6.0, band=1.5)
