"""Diffusion: against dense algebra, factor and dense operator the same, several bodies."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.numerics.operators import Factor, cotangent_laplacian, lumped_mass
from dtrepair.repair.paper.diffusion import BodyDiffusion, Diffusion, SparseOperator
from tests.meshes import icosphere, torus

SPHERE = icosphere(2)
LAPLACIAN = cotangent_laplacian(*SPHERE)
MASS = lumped_mass(*SPHERE)


def random_field(count: int, frames: int = 3, seed: int = 0) -> torch.Tensor:
    """Field (B, V, 3)."""
    return torch.from_numpy(np.random.default_rng(seed).normal(size=(frames, count, 3)))


@pytest.mark.parametrize("mass", [None, MASS], ids=["identity", "mass"])
def test_equals_the_dense_formula(mass: NDArray[np.float64] | None) -> None:
    field = random_field(len(MASS))
    weights = np.diag(np.ones(len(MASS)) if mass is None else mass)
    inverse = np.linalg.inv(weights + 10.0 * LAPLACIAN.toarray())
    diffusion = Diffusion(LAPLACIAN, mass=mass, strength=10.0)
    half = torch.from_numpy(inverse) @ field
    assert torch.allclose(diffusion.begin(field), half, rtol=0, atol=1e-10)
    both = torch.from_numpy(inverse @ weights) @ half
    assert torch.allclose(diffusion(field), both, rtol=0, atol=1e-10)
    assert torch.allclose(diffusion.finish(diffusion.begin(field)), both, rtol=0, atol=1e-10)


@pytest.mark.parametrize("mass", [None, MASS], ids=["identity", "mass"])
def test_dense_operator_is_the_same_operator(mass: NDArray[np.float64] | None) -> None:
    field = random_field(len(MASS))
    diffusion = Diffusion(LAPLACIAN, mass=mass)
    dense = diffusion.dense(device="cpu")
    for name in ("begin", "finish", "__call__"):
        expected, received = (getattr(one, name)(field) for one in (diffusion, dense))
        assert (expected - received).abs().max() < 1e-10 * expected.abs().max()


def test_constants_pass_and_the_maximum_falls() -> None:
    diffusion = Diffusion(LAPLACIAN)
    constant = torch.full((1, len(MASS), 3), 2.0, dtype=torch.float64)
    assert torch.allclose(diffusion(constant), constant, rtol=1e-9)
    spike = torch.zeros_like(constant)
    spike[0, 7] = 1.0
    weak, strong = (Diffusion(LAPLACIAN, strength=s)(spike) for s in (1.0, 99.0))
    assert 0 < strong.max() < weak.max() < 1.0


def test_factored_once() -> None:
    before = Factor.count
    diffusion = Diffusion(LAPLACIAN)
    for _ in range(3):
        diffusion(random_field(len(MASS)))
    diffusion.dense(device="cpu")
    assert Factor.count == before + 1


def test_frames_are_solved_in_one_call_of_what_was_given() -> None:
    asked: list[tuple[int, ...]] = []

    class Watched(Factor):
        def solve(self, frames: NDArray[np.floating]) -> NDArray[np.float64]:
            asked.append(frames.shape)
            return super().solve(frames)

    field = random_field(len(MASS))
    for given in (field, field.float()):
        found = Diffusion(LAPLACIAN, factor=Watched)(given)
        alone = torch.cat([Diffusion(LAPLACIAN)(own[None]) for own in given])
        assert torch.equal(found, alone) and found.dtype == given.dtype
    assert asked == 4 * [tuple(field.shape)]


def test_bodies_do_not_mix_and_a_fixed_body_stays() -> None:
    torus_points, torus_faces = torus(12, 6)
    other = cotangent_laplacian(torus_points, torus_faces)
    soft, stiff = Diffusion(LAPLACIAN, strength=9.0), Diffusion(other, strength=999.0)
    first = len(MASS)
    total = first + len(torus_points)
    mobility = torch.ones(total)
    mobility[first:] = 0.0
    field = random_field(total)
    free = BodyDiffusion([(0, first, soft), (first, total, stiff)])
    both = free(field)
    assert torch.equal(both[:, :first], soft(field[:, :first]))
    assert torch.equal(both[:, first:], stiff(field[:, first:]))
    assert torch.equal(free.finish(free.begin(field)), both)
    fixed = BodyDiffusion([(0, first, soft), (first, total, stiff)], mobility=mobility)
    for result in (fixed(field), fixed.finish(fixed.begin(field))):
        assert not result[:, first:].any()
        assert torch.equal(result[:, :first], both[:, :first])


def test_sparse_operator_is_its_matrix() -> None:
    field = random_field(len(MASS))
    operator = SparseOperator(LAPLACIAN)
    expected = torch.from_numpy(LAPLACIAN.toarray()) @ field
    assert torch.allclose(operator(field), expected, rtol=0, atol=1e-12)
    assert operator(field.float()).dtype == torch.float32


def test_bad_input_is_refused() -> None:
    with pytest.raises(ValueError, match="strength should be positive, got 0"):
        Diffusion(LAPLACIAN, strength=0.0)
    with pytest.raises(ValueError, match="positive numbers, got shape"):
        Diffusion(LAPLACIAN, mass=MASS[:-1])
    with pytest.raises(ValueError, match="and minimum 0"):
        Diffusion(LAPLACIAN, mass=MASS * 0.0)
    with pytest.raises(ValueError, match="laplacian should be square"):
        Diffusion(sparse.csr_matrix(LAPLACIAN[:, :-1]))
    diffusion = Diffusion(LAPLACIAN)
    with pytest.raises(ValueError, match="follow each other"):
        BodyDiffusion([(0, 10, diffusion), (11, 20, diffusion)])
