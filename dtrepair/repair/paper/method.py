"""The published method alone (Jang et al. 2025), for poses of a `Surface`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.device import DeviceQueue, out_of_memory
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.metrics import distortion
from dtrepair.numerics.operators import cotangent_laplacian
from dtrepair.numerics.threads import one_thread
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.paper.corner_energy import EnergyOptions
from dtrepair.repair.paper.descent import Descent, DescentResult
from dtrepair.repair.paper.diffusion import (
    BodyDiffusion,
    Diffusion,
    DiffusionOptions,
    SparseOperator,
)
from dtrepair.repair.paper.energy import triangle_directions
from dtrepair.repair.paper.gpu_descent import DeviceDescent, GpuOptions, too_large
from dtrepair.repair.paper.gpu_operators import RowOperator
from dtrepair.repair.paper.optimizer import OptimizerOptions
from dtrepair.repair.result import Solved, Stage
from dtrepair.repair.surface.surface import Surface


@dataclass(frozen=True, kw_only=True)
class PaperOptions:
    """Every number of the published method that is no choice of the user.

    Args:
        energies: Exponents and reaches of the energies.
        optimizers: Learning rates, memories and the band of the brake.
        runaway: A frame that moved this far, in units of its size, has diverged.
        diffusion: How the diffusion is kept on a device.
        gpu: How the loop runs on a device.
    """

    energies: EnergyOptions = field(default_factory=EnergyOptions)
    optimizers: OptimizerOptions = field(default_factory=OptimizerOptions)
    runaway: float = Descent.runaway
    diffusion: DiffusionOptions = field(default_factory=DiffusionOptions)
    gpu: GpuOptions = field(default_factory=GpuOptions)


class PaperMethod:
    """One diffusion factor per body, one loop; built once per surface.

    With a queue whole iterations run on its device, for many poses at a time. The CPU could do so
    too, but its sparse factor is faster than products of dense matrices.
    """

    def __init__(
        self,
        surface: Surface,
        choices: RepairOptions,
        *,
        queue: DeviceQueue | None = None,
        options: PaperOptions = PaperOptions(),
    ) -> None:
        """Factor the diffusion of each body of `surface`; work in `queue`, or on the CPU.

        With the Laplacian of the input there is a factor for each pose instead.
        """
        self.surface, self.choices = surface, choices
        self._queue, self._options = queue, options
        self.descent: Callable[[torch.Tensor], DescentResult] | None = None
        if choices.laplacian == "rest":
            self.descent = self._descent(surface.rest)

    def _descent(self, shape: FloatArray) -> Callable[[torch.Tensor], DescentResult]:
        """Return the loop with the Laplacian of a pose (V, 3)."""
        surface, choices, options = self.surface, self.choices, self._options
        kernel = options.energies.chosen(choices)
        laplacian = cotangent_laplacian(shape, surface.faces)
        faces = torch.from_numpy(surface.faces.astype(np.int64))
        direction = None
        if surface.direction is not None:
            direction = triangle_directions(torch.from_numpy(surface.direction), faces)
        mobility = torch.from_numpy(surface.mobility)
        bodies = _bodies(surface, laplacian)
        descent = Descent(
            faces=faces,
            detect=self._detect,
            diffusion=BodyDiffusion(bodies, mobility=mobility),
            laplacian=SparseOperator(laplacian),
            kernel=kernel,
            optimizer=options.optimizers.chosen(choices, kernel.rate_factor),
            direction=direction,
            iterations=choices.iterations,
            regularization=choices.regularization,
            runaway=options.runaway,
        )
        if self._queue is None:
            return descent
        return _on_device(descent, bodies, laplacian, surface, self._queue, options)

    def __call__(self, original: FloatArray) -> Solved:
        """Repair a pose (V, 3) in units of the surface's size."""
        return self.batch([original])[0]

    @one_thread()  # again: PyTorch was not loaded before
    def batch(self, originals: Sequence[FloatArray]) -> list[Solved]:
        """Repair poses (V, 3) in units of the surface's size."""
        if self.descent is None and len(originals) > 1:
            return [solved for original in originals for solved in self.batch([original])]
        start = time.perf_counter()
        descent = self.descent or self._descent(originals[0])
        result = descent(torch.from_numpy(np.stack(originals)))
        seconds = (time.perf_counter() - start) / len(originals)
        left = self._left(descent, result)
        results = []
        for index, original in enumerate(originals):
            points = result.points[index].numpy()
            value = distortion(original, points, self.surface.edges)
            count = int(result.iterations[index])
            stage = Stage("descent", int(left[index]), 0, value, count, seconds)
            results.append(Solved(points, [stage]))
        return results

    def _left(
        self, descent: Callable[[torch.Tensor], DescentResult], result: DescentResult
    ) -> NDArray[np.int64]:
        """Return how many pairs each pose has; none that the loop found clean is looked at again.

        They are counted where the loop ran.
        """
        surface, left = self.surface, np.zeros(len(result.points), dtype=np.int64)
        if len(dirty := np.flatnonzero(result.triangles.numpy() != 0)):
            detector = descent.detector if isinstance(descent, DeviceDescent) else surface.detector
            found = detector(surface.written(result.points.numpy()[dirty]))
            found = found[surface.contacts.counts(found)]
            left[dirty] = np.bincount(found[:, 0], minlength=len(dirty))
        return left

    def _detect(self, points: torch.Tensor) -> IntArray:
        return self.surface.contacts.batch_pairs(points.numpy())


def _on_device(
    descent: Descent,
    bodies: Sequence[tuple[int, int, Diffusion]],
    laplacian: sparse.csr_matrix,
    surface: Surface,
    queue: DeviceQueue,
    options: PaperOptions,
) -> DeviceDescent:
    """Return the loop of a surface on a device, with operators that are made for it."""
    device = queue.device
    detector = Detector(surface.written(surface.rest), surface.faces, device=device)
    try:
        there = [
            (
                first,
                stop,
                diffusion.on(surface.rest[first:stop], device=device, options=options.diffusion),
            )
            for first, stop, diffusion in bodies
        ]
    except RuntimeError as error:
        if out_of_memory(error):
            raise too_large("the diffusion operator", detector) from error
        raise
    mobility = torch.from_numpy(surface.mobility).to(device)
    return DeviceDescent(
        replace(
            descent,
            faces=descent.faces.to(device),
            diffusion=BodyDiffusion(there, mobility=mobility),
            laplacian=RowOperator(laplacian, queue),
            direction=None if descent.direction is None else descent.direction.to(device),
        ),
        detector,
        queue,
        size=surface.size,
        options=options.gpu,
        counted=surface.contacts.counted_pairs,
    )


def _bodies(surface: Surface, laplacian: sparse.csr_matrix) -> list[tuple[int, int, Diffusion]]:
    """Return the first vertex, end and diffusion of each body."""
    found = []
    for body in surface.bodies:
        own = slice(body.start, body.stop)
        diffusion = Diffusion(laplacian[own, own], strength=body.diffusion, factor=surface.factor)
        found.append((body.start, body.stop, diffusion))
    return found
