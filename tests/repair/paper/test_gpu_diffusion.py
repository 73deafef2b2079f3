"""Diffusion in blocks: the solves of the factor, with far less than a dense operator holds."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.numerics.operators import cotangent_laplacian, lumped_mass
from dtrepair.repair.paper.diffusion import DenseDiffusion, Diffusion, DiffusionOptions
from dtrepair.repair.paper.gpu_diffusion import BlockDiffusion, BlockOptions, cut
from tests.meshes import Mesh, icosphere, joined, torus

BALL, RING = icosphere(3), torus(40, 20)
PAIR = joined(BALL, RING)


def operator(mesh: Mesh, *, masses: bool = False) -> tuple[Diffusion, NDArray[np.float64]]:
    """The diffusion of a mesh and its points."""
    points, faces = mesh
    mass = lumped_mass(points, faces) if masses else None
    strength = 0.01 if masses else 99.0
    return Diffusion(cotangent_laplacian(points, faces), mass=mass, strength=strength), points


@pytest.mark.parametrize("masses", [False, True], ids=["identity", "mass"])
@pytest.mark.parametrize("mesh", [BALL, RING, PAIR], ids=["ball", "ring", "two parts"])
def test_blocks_solve_as_the_factor_does(mesh: Mesh, masses: bool) -> None:
    diffusion, points = operator(mesh, masses=masses)
    field = torch.from_numpy(np.random.default_rng(0).normal(size=(2, len(points), 3)))
    matrix = sparse.csr_matrix(diffusion.matrix)
    options = BlockOptions(least_part=50, balance=0)
    blocks = BlockDiffusion(matrix, points, mass=diffusion.mass, options=options)
    for name in ("begin", "finish", "__call__"):
        expected = getattr(diffusion, name)(field)
        received = getattr(blocks, name)(field)
        assert (received - expected).abs().max() < 1e-10 * expected.abs().max()
    assert torch.equal(blocks(field), blocks(field))


def test_parts_meet_in_separators_only() -> None:
    diffusion, points = operator(RING)
    matrix = sparse.csr_matrix(diffusion.matrix)
    parts, separators = cut(matrix, points, 50)
    every = np.concatenate([*parts, separators])
    assert np.array_equal(np.sort(every), np.arange(len(points)))
    assert len(parts) >= len(points) / 50 and max(map(len, parts)) <= 50
    for k, part in enumerate(parts):
        others = np.concatenate([p for n, p in enumerate(parts) if n != k])
        assert matrix[part][:, others].nnz == 0
    # Every separator is needed: one beside each cut, not both.
    assert len(separators) < 0.4 * len(points)


def test_a_mesh_of_one_part_has_no_separators() -> None:
    diffusion, points = operator(icosphere(1))
    blocks = BlockDiffusion(sparse.csr_matrix(diffusion.matrix), points)
    field = torch.from_numpy(np.random.default_rng(0).normal(size=(1, len(points), 3)))
    assert (blocks(field) - diffusion(field)).abs().max() < 1e-12


def test_large_meshes_get_blocks_and_small_ones_a_matrix() -> None:
    diffusion, points = operator(BALL)
    assert isinstance(diffusion.on(points, device="cpu"), DenseDiffusion)
    options = DiffusionOptions(dense=100)
    assert isinstance(diffusion.on(points, device="cpu", options=options), BlockDiffusion)


def test_memory_is_far_below_that_of_a_dense_operator() -> None:
    diffusion, points = operator(icosphere(5))
    blocks = BlockDiffusion(sparse.csr_matrix(diffusion.matrix), points)
    # 10,242 vertices: A^-1 alone would hold their square.
    assert blocks.numbers < 0.1 * len(points) ** 2
