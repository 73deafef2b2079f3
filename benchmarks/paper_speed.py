"""Time of an iteration of the published loop, beside one of the structure of the authors' code."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from scipy import sparse

from benchmarks.detection import Faces, Points, measure
from dtrepair.files.mesh_files import read_mesh
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.geometry import as_mesh, extent
from dtrepair.numerics.operators import cotangent_laplacian, lumped_mass
from dtrepair.repair.paper.descent import Descent
from dtrepair.repair.paper.diffusion import Diffusion, SparseOperator
from dtrepair.repair.paper.energy import mean_square_strength
from dtrepair.repair.paper.optimizer import Moments, Optimizer, OptimizerOptions, start


def make_descent(
    points: Points,
    faces: Faces,
    shape: Points,
    optimizer: Optimizer,
    *,
    iterations: int,
    masses: bool,
) -> tuple[Descent, torch.Tensor]:
    """The loop itself with either diffusion, and the points (1, V, 3) in units of their size."""
    points, faces = as_mesh(points, faces)
    size, unit = extent(points), shape / extent(shape)
    laplacian = cotangent_laplacian(unit, faces)
    detector = Detector(shape, faces)
    descent = Descent(
        faces=torch.from_numpy(faces.astype(np.int64)),
        detect=lambda at: detector(at.numpy() * size),
        diffusion=Diffusion(laplacian, mass=lumped_mass(unit, faces) if masses else None),
        laplacian=SparseOperator(laplacian),
        optimizer=optimizer,
        iterations=iterations,
    )
    return descent, torch.from_numpy(points / size)[None]


def reference_iteration(
    descent: Descent, laplacian: torch.Tensor, points: torch.Tensor, moments: Moments
) -> None:
    """The authors' structure: detect, autograd of both terms, two solves, step, detect again."""
    pairs = torch.as_tensor(descent.detect(points)).long()
    moving = points[0].clone().requires_grad_()
    corners = moving[descent.faces]
    normals = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * normals.norm(dim=1)
    planes = (normals / (2.0 * areas[:, None])).detach()
    target = laplacian @ points[0]
    energy = mean_square_strength(1e6, len(moving)) * (laplacian @ moving - target).square().sum()
    for one, other in ((1, 2), (2, 1)):
        at = pairs[:, other]
        offsets = corners[at].mean(dim=1, keepdim=True) - corners[pairs[:, one]]
        heights = (offsets * planes[at, None]).sum(dim=-1)
        energy = energy + (areas.detach()[at, None] * heights / offsets.norm(dim=-1)).sum()
    energy.backward()
    assert moving.grad is not None
    step, _ = descent.optimizer(moments, descent.diffusion.begin(moving.grad[None]))
    descent.detect(points - descent.diffusion.finish(step))


def as_torch(matrix: sparse.csr_matrix) -> torch.Tensor:
    """A sparse matrix as PyTorch has it."""
    entries = matrix.tocoo()
    index = torch.from_numpy(np.stack([entries.row, entries.col]))
    with torch.sparse.check_sparse_tensor_invariants(False):
        return torch.sparse_coo_tensor(
            index, torch.from_numpy(entries.data), entries.shape
        ).coalesce()


def iteration_runs(points: Points, faces: Faces, shape: Points) -> dict[str, Callable[[], object]]:
    """Detection, an iteration, and one of the reference structure with the same detector.

    All of the same pose with the same pairs; nothing moves.
    """
    optimizer = OptimizerOptions().momentum_brake
    descent, pose = make_descent(points, faces, shape, optimizer, iterations=60, masses=False)
    assert isinstance(descent.laplacian, SparseOperator)
    target, moments = descent.laplacian(pose), start(pose)
    laplacian = as_torch(descent.laplacian.matrix)

    def iteration() -> object:
        pairs = torch.as_tensor(descent.detect(pose)).long()
        return descent.step(pose, pairs, target, moments)

    return {
        "detection": lambda: descent.detect(pose),
        "iteration": iteration,
        "reference iteration": lambda: reference_iteration(descent, laplacian, pose, moments),
    }


def print_speed(data: Path) -> None:
    """Table of the processor time of an iteration, best of 20, on a mesh of about 14k triangles."""
    path = data / "animals" / "horse_head_through_chest.obj"
    mesh = read_mesh(path)
    best = measure(iteration_runs(mesh.points, mesh.faces(), mesh.points), 20)
    _, ours, reference = best.values()
    print(f"\n| {path.stem}, {len(mesh.points)} vertices, {len(mesh.faces())} triangles | cpu ms |")
    print("|---|---|")
    for name, milliseconds in best.items():
        print(f"| {name} | {milliseconds:.1f} |")
    print(f"| ratio (bar 0.5) | {ours / reference:.2f} |\n| 60 iterations | {60 * ours:.0f} |")
