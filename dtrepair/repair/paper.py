"""The published method alone (Jang et al. 2025), for poses of a `Surface`."""

from __future__ import annotations

import time

import numpy as np
import torch

from dtrepair.geometry import FloatArray, IntArray
from dtrepair.operators import cotangent_laplacian
from dtrepair.repair.descent import Descent
from dtrepair.repair.diffusion import BodyDiffusion, Diffusion, SparseOperator
from dtrepair.repair.energy import KERNELS, triangle_directions
from dtrepair.repair.optimizer import make_optimizer
from dtrepair.repair.options import RepairOptions, Solved, Stage
from dtrepair.repair.surface import Surface
from dtrepair.repair.tighten import distortion


class PaperMethod:
    """One diffusion factor per body, one loop; built once per surface."""

    def __init__(self, surface: Surface, options: RepairOptions) -> None:
        """Factor the diffusion of each body of `surface`."""
        self.surface = surface
        laplacian = cotangent_laplacian(surface.rest, surface.faces)
        bodies = [
            (
                body.start,
                body.stop,
                Diffusion(
                    laplacian[body.start : body.stop, body.start : body.stop],
                    strength=body.diffusion,
                ),
            )
            for body in surface.bodies
        ]
        faces = torch.from_numpy(surface.faces.astype(np.int64))
        direction = None
        if surface.direction is not None:
            direction = triangle_directions(torch.from_numpy(surface.direction), faces)
        self.descent = Descent(
            faces=faces,
            detect=self._detect,
            diffusion=BodyDiffusion(bodies, mobility=torch.from_numpy(surface.mobility)),
            laplacian=SparseOperator(laplacian),
            kernel=KERNELS[options.energy],
            optimizer=make_optimizer(options.optimizer, energy=options.energy),
            direction=direction,
            iterations=options.iterations,
            regularization=options.regularization,
        )

    def __call__(self, original: FloatArray) -> Solved:
        """Repair a pose (V, 3) in units of the surface's size."""
        start = time.perf_counter()
        result = self.descent(torch.from_numpy(original[None]))
        points = result.points[0].numpy()
        left = len(self.surface.pairs(points))
        value = distortion(self.surface, original, points)
        seconds = time.perf_counter() - start
        stage = Stage("descent", left, 0, value, int(result.iterations[0]), seconds)
        return Solved(points, [stage])

    def _detect(self, points: torch.Tensor) -> IntArray:
        return self.surface.batch_pairs(points.numpy())
