"""Forces and sparse rows as launches: the values of their PyTorch and scipy counterparts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from dtrepair.device import DeviceQueue
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.operators import cotangent_laplacian
from dtrepair.repair.paper.corner_energy import Kernel
from dtrepair.repair.paper.descent import Descent
from dtrepair.repair.paper.diffusion import Diffusion, SparseOperator
from dtrepair.repair.paper.energy import pair_energy
from dtrepair.repair.paper.gpu_detection import FixedDetection
from dtrepair.repair.paper.gpu_operators import Forces, RowOperator
from tests.meshes import bent_tube, icosphere, overlapping_spheres
from tests.repair.paper.test_energy import KERNEL_CASES

QUEUE = DeviceQueue("cpu")
POINTS, FACES = overlapping_spheres()
LAPLACIAN = cotangent_laplacian(POINTS, FACES)


def setup(
    kernel: Kernel, **options: Any
) -> tuple[Descent, FixedDetection, torch.Tensor, torch.Tensor]:
    """A descent, the detection of two poses, the poses and their pairs."""
    poses = np.stack([POINTS, POINTS * 1.01])
    detector = Detector(POINTS, FACES)
    descent = Descent(
        faces=torch.from_numpy(FACES.astype(np.int64)),
        detect=detector,
        diffusion=Diffusion(LAPLACIAN),  # not used here
        laplacian=SparseOperator(LAPLACIAN),
        kernel=kernel,
        **options,
    )
    detection = FixedDetection(detector, 2, QUEUE)
    detection.points.copy_(torch.from_numpy(poses))
    detection.run()
    pairs = detection.pairs[: int(detection.count)].long()
    return descent, detection, torch.from_numpy(poses), pairs


@pytest.mark.parametrize("directed", [0, 1, 2], ids=["free", "directed", "both directed"])
@pytest.mark.parametrize("kernel", KERNEL_CASES, ids=str)
def test_gradient_is_that_of_pair_energy(kernel: Kernel, directed: int) -> None:
    descent, detection, points, pairs = setup(kernel)
    if directed:
        direction = torch.zeros(len(FACES), 3, dtype=torch.float64)
        direction[: len(FACES) // 2] = torch.tensor([0.2, 0.5, 1.0])
        if directed == 2:
            direction[len(FACES) // 2 :] = torch.tensor([-1.0, 0.5, 0.2])
        descent = replace(descent, direction=direction)
    _, expected = pair_energy(
        points, descent.faces, pairs, kernel=kernel, direction=descent.direction
    )
    everyone = torch.ones(2, dtype=torch.bool)
    forces = Forces(descent)
    received = forces(points, detection, everyone)
    assert expected.abs().max() > 1e-6
    # A sum of some fifty forces, each rounded to 2^-41; powers differ in the last digits.
    assert (received - expected).abs().max() < 1e-10 + 1e-12 * expected.abs().max()
    half = forces(points, detection, torch.tensor([False, True]))
    assert not half[0].any() and torch.equal(half[1], received[1])


def test_forces_do_not_depend_on_the_order_of_the_pairs() -> None:
    descent, detection, points, pairs = setup(KERNEL_CASES[0])
    everyone = torch.ones(2, dtype=torch.bool)
    forces = Forces(descent)
    expected = forces(points, detection, everyone)
    order = torch.from_numpy(np.random.default_rng(0).permutation(len(pairs)))
    detection.pairs[: len(pairs)] = pairs[order].int()
    assert torch.equal(forces(points, detection, everyone), expected)


def test_a_large_force_is_cut_and_a_triangle_without_area_is_harmless() -> None:
    points, faces = bent_tube(6.4, around=8, along=24, radius=0.08)
    points[faces[5]] = points[faces[5, 0]]
    detector = Detector(points, faces)
    descent = Descent(
        faces=torch.from_numpy(faces.astype(np.int64)),
        detect=detector,
        diffusion=Diffusion(LAPLACIAN),
        laplacian=SparseOperator(LAPLACIAN),
    )
    detection = FixedDetection(detector, 1, QUEUE)
    detection.pairs[:2] = torch.tensor([[0, 5, 60], [0, 5, 61]], dtype=torch.int32)
    detection.count.fill_(2)
    poses = torch.from_numpy(points)[None]
    forces = Forces(descent)
    assert forces(poses, detection, torch.ones(1, dtype=torch.bool)).isfinite().all()
    huge = forces(poses * 1e12, detection, torch.ones(1, dtype=torch.bool))
    assert huge.isfinite().all() and huge.abs().max() <= 16 * 2.0**18


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_rows_are_multiplied_in_double(dtype: torch.dtype) -> None:
    field = torch.from_numpy(np.random.default_rng(1).normal(size=(3, len(POINTS), 3)))
    received = RowOperator(LAPLACIAN, QUEUE)(field.to(dtype))
    expected = torch.from_numpy(LAPLACIAN.toarray()) @ field.to(dtype).double()
    assert received.dtype == dtype
    assert (received - expected).abs().max() < (1e-12 if dtype == torch.float64 else 1e-6) * 10
    small = cotangent_laplacian(*icosphere(0))
    assert RowOperator(small, QUEUE)(torch.ones(1, 12, 3)).abs().max() < 1e-6
