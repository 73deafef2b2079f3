"""Energies: gradients against finite differences, direction of the forces, degenerate triangles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from dtrepair.numerics.operators import cotangent_laplacian
from dtrepair.repair.paper.corner_energy import (
    ConicalField,
    EnergyOptions,
    Kernel,
    Planes,
    PointToPlane,
    SignedTangentPoint,
    UnsignedTangentPoint,
)
from dtrepair.repair.paper.diffusion import SparseOperator
from dtrepair.repair.paper.energy import (
    accumulate,
    mean_square_strength,
    pair_energy,
    shape_term,
    triangle_directions,
    triangle_planes,
)
from tests.meshes import icosphere

KERNEL_CASES = [
    *EnergyOptions().by_name.values(),
    SignedTangentPoint(exponent=3, power=6),
    SignedTangentPoint(exponent=3, power=3),
    UnsignedTangentPoint(exponent=3, power=6),
    ConicalField(height=0.5),
    ConicalField(height=0.02),
]


def crossing(frames: int = 2, seed: int = 0) -> tuple[Tensor, Tensor, Tensor]:
    """Points (B, 12, 3), faces and pairs: a large triangle pierced by three small ones."""
    large = np.array([[0, 0, 0], [1, 0, 0.1], [0, 1, 0]])
    small = np.array([[0.2, 0.2, -0.05], [0.3, 0.2, 0.08], [0.2, 0.3, 0.06]])
    shifts = np.array([[0, 0, 0], [0.2, 0.1, 0.01], [0.15, 0.4, -0.01]])
    parts = [large, *(small + shift for shift in shifts)]
    noise = np.random.default_rng(seed).normal(size=(frames, 12, 3)) * 0.01
    points = torch.from_numpy(np.concatenate(parts)[None] + noise)
    pairs = [(frame, 0, other) for frame in range(frames) for other in (1, 2, 3)]
    return points, torch.arange(12).view(4, 3), torch.tensor(pairs)


def planes_of(points: Tensor, faces: Tensor, pairs: Tensor) -> Planes:
    """The fixed planes in the order of the directed pairs."""
    fixed = faces[torch.cat([pairs[:, 2], pairs[:, 1]])]
    return triangle_planes(points[pairs[:, 0].repeat(2)[:, None], fixed])


def central_differences(
    function: Callable[[Tensor], Tensor], points: Tensor, step: float
) -> Tensor:
    """Gradient of a scalar function of points by central differences."""
    gradient = torch.zeros_like(points)
    for index in np.ndindex(*points.shape):
        for sign in (1, -1):
            moved = points.clone()
            moved[index] += sign * step
            gradient[index] += sign * function(moved) / (2 * step)
    return gradient


@pytest.mark.parametrize("kernel", KERNEL_CASES, ids=str)
def test_gradient_is_the_derivative_with_planes_held(kernel: Kernel) -> None:
    points, faces, pairs = crossing()
    planes = planes_of(points, faces, pairs)
    weights = torch.linspace(0.5, 2.0, len(pairs), dtype=torch.float64)
    options: dict[str, Any] = {"kernel": kernel, "weights": weights, "planes": planes}
    _, gradient = pair_energy(points, faces, pairs, **options)
    numeric = central_differences(
        lambda moved: pair_energy(moved, faces, pairs, **options)[0].sum(), points, 1e-6
    )
    scale = numeric.abs().max()
    assert scale > 1e-4
    # Central differences of step 1e-6 at unit size: rounding 1e-10, truncation far below.
    assert (gradient - numeric).abs().max() < 1e-6 * scale


@pytest.mark.parametrize("kernel", KERNEL_CASES, ids=str)
def test_forces_balance_and_frames_do_not_mix(kernel: Kernel) -> None:
    points, faces, pairs = crossing(frames=3)
    energy, gradient = pair_energy(points, faces, pairs, kernel=kernel)
    assert gradient.sum(dim=1).abs().max() < 1e-12 * max(1.0, float(gradient.abs().max()))
    alone, gradient_alone = pair_energy(points[1:2], faces, pairs[:3], kernel=kernel)
    assert torch.equal(gradient[1], gradient_alone[0])
    assert torch.equal(energy[1], alone[0])


def test_value_of_a_corner_over_a_unit_plane() -> None:
    # One corner at height -h below the centroid of a triangle of area 1/2: s = |d| = h.
    points = torch.tensor([[[0, 0, 0], [1, 0, 0], [0, 1, 0]] + [[1 / 3, 1 / 3, -0.2]] * 3])
    points = points.double()
    faces, pairs = torch.arange(6).view(2, 3), torch.tensor([[0, 0, 1]])
    ratio, _ = pair_energy(points, faces, pairs, kernel=SignedTangentPoint())
    paper, _ = pair_energy(points, faces, pairs, kernel=SignedTangentPoint(exponent=3, power=6))
    square, _ = pair_energy(points, faces, pairs, kernel=PointToPlane())
    # The second triangle has no area: only its three corners against the first one's plane count.
    assert float(ratio) == pytest.approx(3 * 0.5)
    assert float(paper) == pytest.approx(3 * 0.5 * 0.2**-3)
    assert float(square) == pytest.approx(3 * 0.5 * 0.2**2)


@pytest.mark.parametrize("kernel", [SignedTangentPoint(), PointToPlane()], ids=str)
def test_descending_moves_a_buried_corner_out(kernel: Kernel) -> None:
    points, faces, pairs = crossing(frames=1)
    _, gradient = pair_energy(points, faces, pairs, kernel=kernel)
    below = points[0, 3::3, 2] < 0
    assert below.all()
    assert (-gradient[0, 3::3, 2] > 0).all()


def test_only_the_signed_energy_pushes_a_corner_in_front_of_the_plane_outward() -> None:
    # A plane with normal +z; the corner is 0.1 in front of it and 0.2 aside: d = c - v.
    offsets = torch.tensor([[[0.2, 0.0, -0.1]]], dtype=torch.float64)
    planes = Planes(offsets.new_tensor([[0, 0, 1]]), offsets.new_tensor([1.0]), offsets.new_ones(1))
    kernels = (SignedTangentPoint(), PointToPlane(), UnsignedTangentPoint(exponent=1, power=1))
    # Descending moves the corner by +dk/dd.
    signed, behind_only, unsigned = (
        float(kernel(offsets, planes)[1][0, 0, 2]) for kernel in kernels
    )
    assert signed > 0
    assert behind_only == 0
    assert unsigned < 0


@pytest.mark.parametrize("kernel", KERNEL_CASES, ids=str)
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_degenerate_triangles_exert_no_force_and_stay_finite(
    kernel: Kernel, dtype: torch.dtype
) -> None:
    points, faces, pairs = crossing(frames=1)
    points = points.to(dtype)
    points[0, 5] = points[0, 4]  # a segment
    points[0, 6:9] = points[0, 0:3].mean(dim=0)  # a point, at the centroid of the large triangle
    energy, gradient = pair_energy(points, faces, pairs, kernel=kernel)
    assert energy.dtype == gradient.dtype == dtype
    assert torch.isfinite(energy).all() and torch.isfinite(gradient).all()
    flat = triangle_planes(points[0, faces])
    assert flat.areas[1] == 0 and flat.areas[2] == 0 and flat.areas[0] > 0
    # The degenerate triangles' planes do nothing: the large triangle only feels its own plane's
    # reaction, which is the same on its three corners.
    _, only = pair_energy(points, faces, pairs[:1], kernel=kernel)
    assert torch.equal(only[0, 0], only[0, 1]) and torch.equal(only[0, 0], only[0, 2])


def test_direction_replaces_the_other_normal_and_moves_the_region() -> None:
    points, faces, pairs = crossing(frames=1)
    pairs = pairs[:1]
    direction = torch.zeros(4, 3, dtype=torch.float64)
    direction[1] = torch.tensor([-2.0, 0.0, 0.0])
    kernel = SignedTangentPoint()
    _, free = pair_energy(points, faces, pairs, kernel=kernel)
    _, gradient = pair_energy(points, faces, pairs, kernel=kernel, direction=direction)
    moved, unmoved = -gradient[0, 3:6].sum(dim=0), -free[0, 3:6].sum(dim=0)
    assert moved[0] < min(0.0, float(unmoved[0]))
    assert moved[2].abs() < unmoved[2].abs()


def test_two_directed_triangles_each_move_along_their_own_direction() -> None:
    points, faces, pairs = crossing(frames=1)
    pairs = pairs[:1]
    ways = torch.tensor([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]], dtype=torch.float64)
    direction = torch.zeros(4, 3, dtype=torch.float64)
    direction[:2] = 2.0 * ways
    # Power 0: forces have no part along the offset, so what is left is the direction alone.
    kernel = SignedTangentPoint(power=0.0)
    _, gradient = pair_energy(points, faces, pairs, kernel=kernel, direction=direction)
    for triangle in (0, 1):
        moved = -gradient[0, faces[triangle]].sum(dim=0)
        along = moved @ ways[triangle]
        assert along > 0.0
        assert (moved - along * ways[triangle]).norm() < 1e-12 * along


def test_directions_that_cannot_part_two_triangles_change_nothing() -> None:
    points, faces, pairs = crossing(frames=1)
    pairs, kernel = pairs[:1], SignedTangentPoint()
    direction = torch.zeros(4, 3, dtype=torch.float64)
    _, free = pair_energy(points, faces, pairs, kernel=kernel, direction=direction)
    direction[:2] = torch.tensor([[0.0, 1.0, 0.0], [0.0, 3.0, 0.0]])
    _, same = pair_energy(points, faces, pairs, kernel=kernel, direction=direction)
    assert torch.equal(same, free)


def test_triangle_has_a_direction_where_all_its_corners_have_one() -> None:
    direction = torch.tensor([[0, 0, 1], [0, 1, 0], [0, 1, 0], [0, 0, 0]], dtype=torch.float64)
    faces = torch.tensor([[0, 1, 2], [1, 2, 3]])
    assert triangle_directions(direction, faces).tolist() == [[0, 2, 1], [0, 0, 0]]


def test_pair_of_weight_zero_takes_no_part() -> None:
    points, faces, pairs = crossing(frames=1)
    padded = torch.cat([pairs[:1], torch.zeros_like(pairs[:2])])
    weights = torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
    energy, gradient = pair_energy(
        points, faces, padded, kernel=SignedTangentPoint(), weights=weights
    )
    alone, alone_gradient = pair_energy(points, faces, pairs[:1], kernel=SignedTangentPoint())
    assert torch.equal(energy, alone) and torch.equal(gradient, alone_gradient)


def test_no_pairs_give_zero() -> None:
    points, faces, pairs = crossing()
    energy, gradient = pair_energy(points, faces, pairs[:0], kernel=SignedTangentPoint())
    assert not energy.any() and not gradient.any() and gradient.shape == points.shape


@pytest.mark.parametrize("exponent", [0, 2, -1])
def test_even_exponent_is_refused(exponent: int) -> None:
    with pytest.raises(ValueError, match=f"odd and positive, got {exponent}"):
        SignedTangentPoint(exponent=exponent)


def test_accumulate_repeats_to_the_bit_and_adds_all() -> None:
    generator = torch.Generator().manual_seed(1)
    rows = torch.randn(5000, 3, generator=generator)
    index = torch.randint(0, 7, (5000,), generator=generator)
    first = accumulate(rows, index, 8)
    assert torch.equal(first, accumulate(rows, index, 8))
    for target in range(8):
        expected = rows[index == target].double().sum(dim=0)
        assert (first[target].double() - expected).abs().max() < 1e-5


def test_shape_term_gradient_and_rigid_translation() -> None:
    points, faces = icosphere(1)
    laplacian = SparseOperator(cotangent_laplacian(points, faces))
    batch = torch.from_numpy(points)[None].repeat(2, 1, 1)
    target = laplacian(batch)
    moved = batch + torch.from_numpy(np.random.default_rng(0).normal(size=batch.shape)) * 0.1
    strength = mean_square_strength(1e3, len(points))
    value, gradient = shape_term(moved, target, laplacian=laplacian, strength=strength)
    numeric = central_differences(
        lambda at: shape_term(at, target, laplacian=laplacian, strength=strength)[0].sum(),
        moved,
        1e-5,
    )
    assert numeric.abs().max() > 1.0
    assert (gradient - numeric).abs().max() < 1e-7 * numeric.abs().max()
    # Translation leaves differential coordinates alone.
    still, _ = shape_term(batch + 5.0, target, laplacian=laplacian, strength=strength)
    assert still.max() < 1e-20 * value.max()


def test_strength_is_that_of_a_mean_square() -> None:
    assert mean_square_strength(1e6, 1000) * 3000 == pytest.approx(1e6)


@pytest.mark.parametrize("kernel", KERNEL_CASES, ids=str)
def test_each_corner_meets_the_other_triangle_of_its_own_pair(kernel: Kernel) -> None:
    points, faces, pairs = crossing()
    energy, gradient = pair_energy(points, faces, pairs, kernel=kernel)
    expected = torch.zeros_like(energy)
    for frame, *both in pairs.tolist():
        for mine, other in (both, both[::-1]):
            plane = triangle_planes(points[frame, faces[other]][None])
            for corner in faces[mine]:
                offset = points[frame, faces[other]].mean(dim=0) - points[frame, corner]
                value, _ = kernel(offset[None, None], plane)
                expected[frame] += value[0, 0]
    assert (energy - expected).abs().max() < 1e-12 * expected.abs().max()
    alone = [pair_energy(points, faces, pair[None], kernel=kernel)[1] for pair in pairs]
    assert (gradient - sum(alone)).abs().max() < 1e-12 * gradient.abs().max()
