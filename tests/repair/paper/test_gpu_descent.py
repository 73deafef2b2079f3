"""The loop on a device, run on the CPU: the results of `Descent`, in batches, whatever the room."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from dtrepair.device import DeviceQueue
from dtrepair.intersect.detector import Detector
from dtrepair.repair.paper.corner_energy import EnergyOptions, Kernel
from dtrepair.repair.paper.descent import Descent, DescentResult
from dtrepair.repair.paper.diffusion import Diffusion, SparseOperator
from dtrepair.repair.paper.gpu_descent import DeviceDescent, GpuOptions
from dtrepair.repair.paper.gpu_detection import FixedDetection
from dtrepair.repair.paper.gpu_operators import RowOperator
from dtrepair.repair.paper.optimizer import (
    Adam,
    GradientDescent,
    Optimizer,
    OptimizerOptions,
    UniformAdam,
)
from tests.meshes import bent_tube
from tests.repair.paper.test_descent import crossing_tube, make, unit

TUBE = crossing_tube()
STRAIGHT = unit(bent_tube(3.0, around=16, along=60, radius=0.08))[0]
GENTLE = GradientDescent(rate=2.0)
STEPS = GpuOptions.steps


def both(
    *, batch: int = GpuOptions.batch, capacity: tuple[int, int] | None = None, **options: Any
) -> tuple[Descent, DeviceDescent]:
    """The loop of the CPU, with the pairs that a device finds, and that of a device."""
    descent, _ = make(TUBE, **options)
    detector = Detector(*TUBE)
    on_cpu = replace(descent, detect=lambda points: detector(points))
    queue = DeviceQueue("cpu")
    assert isinstance(descent.diffusion, Diffusion)
    assert isinstance(descent.laplacian, SparseOperator)
    there = replace(
        descent,
        diffusion=descent.diffusion.on(TUBE[0], device="cpu"),
        laplacian=RowOperator(descent.laplacian.matrix, queue),
    )
    on_device = DeviceDescent(
        there, detector, queue, capacity=capacity, options=GpuOptions(batch=batch)
    )
    return on_cpu, on_device


def poses(*scales: float) -> torch.Tensor:
    """The crossing tube in several sizes (B, V, 3)."""
    return torch.from_numpy(np.stack([TUBE[0] * scale for scale in scales]))


def assert_equal(one: DescentResult, other: DescentResult, *, within: float = 0.0) -> None:
    """To the bit, or for products of matrices of another width within their rounding."""
    for name in ("triangles", "iterations", "diverged", "history"):
        assert torch.equal(getattr(one, name), getattr(other, name)), name
    assert (one.points - other.points).abs().max() <= within


STEADY = [o for o in OptimizerOptions().by_name.values() if not isinstance(o, Adam)]


@pytest.mark.parametrize("optimizer", STEADY, ids=str)
def test_results_are_those_of_the_loop_on_the_cpu(optimizer: Optimizer) -> None:
    on_cpu, on_device = both(optimizer=optimizer)
    expected, received = on_cpu(poses(1.0, 0.97)), on_device(poses(1.0, 0.97))
    assert expected.triangles[0] < expected.history[0, 0] and expected.iterations[0] > 0
    assert_equal(received, expected, within=1e-8)
    assert_equal(on_device(poses(1.0, 0.97)), received)


def test_adam_makes_the_same_first_steps() -> None:
    # It scales every number for itself: what rounding leaves of a zero grows to a whole step, so
    # that two ways of summing agree for some steps only.
    on_cpu, on_device = both(optimizer=Adam(), iterations=3)
    expected, received = on_cpu(poses(1.0)), on_device(poses(1.0))
    assert torch.equal(received.history, expected.history)
    assert (received.points - expected.points).abs().max() < 1e-6
    assert (received.points - poses(1.0)).abs().max() > 1e-3


@pytest.mark.parametrize("kernel", EnergyOptions().by_name.values(), ids=str)
def test_every_energy_has_its_loop(kernel: Kernel) -> None:
    on_cpu, on_device = both(kernel=kernel, optimizer=UniformAdam(), iterations=6)
    expected, received = on_cpu(poses(1.0)), on_device(poses(1.0))
    assert torch.equal(received.history, expected.history)
    assert (received.points - expected.points).abs().max() < 1e-8


def test_batches_equal_single_frames_and_clean_ones_keep_every_bit() -> None:
    given = torch.cat([poses(1.0, 0.9), torch.from_numpy(STRAIGHT / 3.0)[None], poses(0.95)])
    kept = given.clone()
    _, on_device = both(iterations=14, batch=3)
    together = on_device(given)
    assert torch.equal(given, kept) and len(together.points) == 4
    assert torch.equal(together.points[2], given[2])
    assert (together.history[1:, 2] == -1).all() and together.history[0, 2] == 0
    _, again = both(iterations=14)
    for index in range(4):
        single = again(given[index : index + 1])
        assert torch.equal(single.history[:, 0], together.history[: len(single.history), index])
        assert (single.points[0] - together.points[index]).abs().max() < 1e-5
    assert torch.equal(on_device(given).points, together.points)


def test_results_do_not_depend_on_the_batches_before() -> None:
    _, on_device = both(iterations=5)
    expected = on_device(poses(1.0, 0.97))
    on_device(poses(1.0, 0.97, 0.95))
    assert_equal(on_device(poses(1.0, 0.97)), expected)


@pytest.mark.parametrize("iterations", [0, 1, STEPS - 1, STEPS, STEPS + 1])
def test_a_replay_does_not_go_beyond_the_last_iteration(iterations: int) -> None:
    on_cpu, on_device = both(optimizer=GradientDescent(rate=0.1), iterations=iterations)
    expected, received = on_cpu(poses(1.0)), on_device(poses(1.0))
    assert torch.equal(received.history, expected.history)
    assert len(received.history) == iterations + 1


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_frame_that_is_not_finite_never_counts_as_clean(bad: float) -> None:
    _, on_device = both(iterations=5)
    broken = poses(1.0)
    broken[0, 3, 1] = bad
    result = on_device(torch.cat([broken, poses(1.0)]))
    assert result.diverged.tolist() == [True, False] and result.triangles[0] == -1
    assert (result.points[1] - on_device(poses(1.0)).points[0]).abs().max() < 1e-8


def test_frames_that_diverge_keep_their_best() -> None:
    on_cpu, on_device = both(optimizer=GradientDescent(rate=1e4))
    expected, received = on_cpu(poses(1.0)), on_device(poses(1.0))
    assert received.diverged.tolist() == expected.diverged.tolist() == [True]
    assert (received.points - poses(1.0)).abs().max() < 1.0


class NoHost(TorchDispatchMode):
    """Refuses what has to wait for a value: a number asked for, a size that depends on one."""

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        name = func.overloadpacket.__name__
        # A number among the tensors of `torch.where` is one on the host: it has to be copied.
        refused = ("_local_scalar_dense", "nonzero", "masked_select", "unique", "scalar_tensor")
        assert name not in refused, name
        return func(*args, **(kwargs or {}))


@pytest.mark.parametrize("kernel", EnergyOptions().by_name.values(), ids=str)
@pytest.mark.parametrize("optimizer", OptimizerOptions().by_name.values(), ids=str)
def test_an_iteration_asks_the_host_for_nothing(
    monkeypatch: pytest.MonkeyPatch, optimizer: Optimizer, kernel: Kernel
) -> None:
    _, on_device = both(optimizer=optimizer, kernel=kernel, iterations=2)
    on_device(poses(1.0))
    assert on_device._loop is not None
    for name in ("tolist", "numpy", "cpu"):
        monkeypatch.setattr(torch.Tensor, name, None)
    with NoHost():
        on_device._loop.iterate()
    with NoHost(), pytest.raises(AssertionError, match="_local_scalar_dense"):
        bool(on_device._loop.alive.any())
    with pytest.raises(TypeError, match="NoneType"):  # by `tolist`
        on_device._loop.advance()


@pytest.mark.parametrize("capacity", [(8, 4096), (4096, 8)], ids=["candidates", "pairs"])
def test_an_overflow_is_retried_larger_with_the_same_result(capacity: tuple[int, int]) -> None:
    _, roomy = both(iterations=12)
    _, tight = both(iterations=12, capacity=capacity)
    assert_equal(tight(poses(1.0, 0.9)), roomy(poses(1.0, 0.9)))
    assert tight.capacity is not None and min(tight.capacity) > 8


@pytest.mark.parametrize(
    "error",
    [
        torch.OutOfMemoryError("not that many"),
        RuntimeError("Failed to allocate 4000 bytes on device 'cuda:0'"),
        RuntimeError("CUDA error: CUBLAS_STATUS_ALLOC_FAILED when calling `cublasCreate(handle)`"),
    ],
    ids=["torch", "warp", "cublas"],
)
def test_a_batch_that_does_not_fit_is_halved(
    monkeypatch: pytest.MonkeyPatch, error: RuntimeError
) -> None:
    _, on_device = both(iterations=8)
    expected = on_device(poses(1.0, 0.9, 0.95, 0.97, 0.93))
    made, largest = [], 2
    original = FixedDetection.__init__

    def limited(
        self: FixedDetection, detector: Detector, frames: int, *args: Any, **options: Any
    ) -> None:
        made.append(frames)
        if frames > largest:
            raise error
        original(self, detector, frames, *args, **options)

    monkeypatch.setattr(FixedDetection, "__init__", limited)
    _, on_device = both(iterations=8)
    assert_equal(on_device(poses(1.0, 0.9, 0.95, 0.97, 0.93)), expected, within=1e-12)
    assert made == [5, 2, 1] and on_device.batch == 2
    largest = 0
    _, on_device = both(iterations=8)
    with pytest.raises(MemoryError, match=r"a single pose of 1920 triangles .* use device 'cpu'"):
        on_device(poses(1.0, 0.9))


def test_no_poses_are_no_work() -> None:
    _, on_device = both()
    result = on_device(poses(1.0)[:0])
    assert len(result.points) == 0 and result.history.shape[1] == 0


def test_other_errors_are_not_taken_for_lack_of_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(self: FixedDetection) -> None:
        raise RuntimeError("illegal address")

    _, on_device = both()
    monkeypatch.setattr(FixedDetection, "run", broken)
    with pytest.raises(RuntimeError, match="illegal address"):
        on_device(poses(1.0, 0.9))
