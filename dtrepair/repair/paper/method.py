"""The published method alone (Jang et al. 2025), for poses of a `Surface`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch
from scipy import sparse

from dtrepair.device import DeviceQueue, out_of_memory
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.operators import cotangent_laplacian
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.paper.descent import Descent, DescentResult
from dtrepair.repair.paper.diffusion import BodyDiffusion, Diffusion, SparseOperator
from dtrepair.repair.paper.energy import KERNELS, triangle_directions
from dtrepair.repair.paper.gpu_descent import DeviceDescent, too_large
from dtrepair.repair.paper.gpu_operators import RowOperator
from dtrepair.repair.paper.optimizer import make_optimizer
from dtrepair.repair.result import Solved, Stage
from dtrepair.repair.surface.distortion import distortion
from dtrepair.repair.surface.surface import Surface

# Kinds of devices that run whole iterations (see `DeviceDescent`). The CPU could, but its sparse
# factor is faster there than products of dense matrices.
DEVICE_LOOP = ("cuda",)


class PaperMethod:
    """One diffusion factor per body, one loop; built once per surface.

    On a CUDA device the loop runs there, for many poses at a time.
    """

    def __init__(
        self, surface: Surface, options: RepairOptions, *, queue: DeviceQueue | None = None
    ) -> None:
        """Factor the diffusion of each body of `surface`; work in `queue`, or on the CPU."""
        self.surface = surface
        laplacian = cotangent_laplacian(surface.rest, surface.faces)
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
            kernel=KERNELS[options.energy],
            optimizer=make_optimizer(options.optimizer, energy=options.energy),
            direction=direction,
            iterations=options.iterations,
            regularization=options.regularization,
        )
        self.descent: Callable[[torch.Tensor], DescentResult] = descent
        if queue is not None and queue.device.partition(":")[0] in DEVICE_LOOP:
            self.descent = _on_device(descent, bodies, laplacian, surface, queue)

    def __call__(self, original: FloatArray) -> Solved:
        """Repair a pose (V, 3) in units of the surface's size."""
        return self.batch([original])[0]

    def batch(self, originals: Sequence[FloatArray]) -> list[Solved]:
        """Repair poses (V, 3) in units of the surface's size."""
        start = time.perf_counter()
        result = self.descent(torch.from_numpy(np.stack(originals)))
        seconds = (time.perf_counter() - start) / len(originals)
        found = []
        for index, original in enumerate(originals):
            points = result.points[index].numpy()
            left = len(self.surface.contacts.pairs(points))
            value = distortion(self.surface, original, points)
            count = int(result.iterations[index])
            found.append(Solved(points, [Stage("descent", left, 0, value, count, seconds)]))
        return found

    def _detect(self, points: torch.Tensor) -> IntArray:
        return self.surface.contacts.batch_pairs(points.numpy())


def _on_device(
    descent: Descent,
    bodies: Sequence[tuple[int, int, Diffusion]],
    laplacian: sparse.csr_matrix,
    surface: Surface,
    queue: DeviceQueue,
) -> DeviceDescent:
    """The loop of a surface on a device, with operators that are made for it."""
    device = queue.device
    detector = Detector(surface.written(surface.rest), surface.faces, device=device)
    try:
        there = [
            (first, stop, diffusion.on(surface.rest[first:stop], device=device))
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
        counted=surface.contacts.counted_pairs,
    )


def _bodies(surface: Surface, laplacian: sparse.csr_matrix) -> list[tuple[int, int, Diffusion]]:
    """First vertex, end and diffusion of each body."""
    found = []
    for body in surface.bodies:
        own = slice(body.start, body.stop)
        diffusion = Diffusion(laplacian[own, own], strength=body.diffusion)
        found.append((body.start, body.stop, diffusion))
    return found
