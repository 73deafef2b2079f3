"""As-rigid-as-possible steps: rigid motions, the energy they lower."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import edge_log_ratio
from dtrepair.numerics.operators import Factor
from dtrepair.repair.elastic.arap import ArapOptions, ArapSystem
from dtrepair.repair.surface.surface import Surface, SurfaceOptions
from tests.meshes import Mesh, elbow, grid, icosphere, torus

ANCHOR = SurfaceOptions().anchor


def rotation(seed: int) -> FloatArray:
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def best_rotations(surface: Surface, original: FloatArray, points: FloatArray) -> FloatArray:
    """Rotation (V, 3, 3) of each vertex by NumPy's SVD (Sorkine & Alexa 2007, eq. 5 and 6)."""
    weights = -surface.laplacian
    result = np.zeros((surface.count, 3, 3))
    for i in range(surface.count):
        row = weights[i].tocoo()
        others = row.col[row.col != i]
        w = row.data[row.col != i]
        covariance = ((points[i] - points[others]) * w[:, None]).T @ (
            original[i] - original[others]
        )
        u, _, vt = np.linalg.svd(covariance)
        flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
        result[i] = u @ flip @ vt
    return result


def energy(
    surface: Surface, original: FloatArray, points: FloatArray, rotations: FloatArray
) -> float:
    """The quadratic a step minimises for given rotations: edges plus the anchor."""
    weights = (-surface.laplacian).tocoo()
    off = weights.row != weights.col
    i, j, w = weights.row[off], weights.col[off], weights.data[off]
    before = np.einsum("ijk,ik->ij", 0.5 * (rotations[i] + rotations[j]), original[i] - original[j])
    # Every edge appears twice, and the system is the gradient over two.
    edges = 0.5 * (w[:, None] * (points[i] - points[j] - before) ** 2).sum()
    return float(edges + ANCHOR * (surface.mass[:, None] * (points - original) ** 2).sum())


@pytest.mark.parametrize("mesh", [icosphere(2), torus(), grid(8, 8), elbow(1.0)])
def test_the_original_stays(mesh: Mesh) -> None:
    surface = Surface(*mesh)
    system = ArapSystem(surface, surface.rest)
    step = system.solve(system.target(surface.rest))
    assert np.abs(step - surface.rest).max() < 1e-9


@pytest.mark.parametrize("mesh", [icosphere(2), torus(), elbow(1.0)])
def test_a_rigid_motion_turns_every_edge_and_only_the_anchor_pulls(mesh: Mesh) -> None:
    surface = Surface(*mesh)
    system = ArapSystem(surface, surface.rest)
    turn = rotation(3)
    pose = surface.rest @ turn.T + (0.3, -0.2, 0.1)
    # Without the anchor the target is L times the pose: the step would stay there.
    target = system.target(pose) - ANCHOR * surface.mass[:, None] * surface.rest
    assert np.abs(target - surface.laplacian @ pose).max() < 1e-9
    # Anchored at the pose instead of the original it does stay.
    step = system.solve(target + ANCHOR * surface.mass[:, None] * pose)
    assert np.abs(step - pose).max() < 1e-8


def test_the_target_is_that_of_numpys_rotations() -> None:
    surface = Surface(*torus(16, 8))
    random = np.random.default_rng(0)
    pose = surface.rest + 0.02 * random.normal(size=surface.rest.shape)
    rotations = best_rotations(surface, surface.rest, pose)
    expected = ANCHOR * surface.mass[:, None] * surface.rest
    weights = (-surface.laplacian).tocoo()
    for i, j, w in zip(weights.row, weights.col, weights.data, strict=True):
        if i != j:
            mean = 0.5 * (rotations[i] + rotations[j])
            expected[i] += w * mean @ (surface.rest[i] - surface.rest[j])
    found = ArapSystem(surface, surface.rest).target(pose)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max() + 1e-12


def test_mirrored_surroundings_are_not_mirrored_back() -> None:
    # A reflection is no rotation: turned, the edges keep their handedness.
    surface = Surface(*icosphere(2))
    pose = surface.rest * np.array([1.0, 1.0, -1.0])
    system = ArapSystem(surface, surface.rest)
    target = system.target(pose) - ANCHOR * surface.mass[:, None] * surface.rest
    assert np.isfinite(target).all()
    assert np.abs(target - surface.laplacian @ pose).max() > 1e-3


def test_a_step_minimises_its_quadratic_and_lowers_the_edge_change() -> None:
    surface = Surface(*elbow(1.0))
    random = np.random.default_rng(0)
    pose = surface.rest + 0.005 * random.normal(size=surface.rest.shape)
    system = ArapSystem(surface, surface.rest)
    step = system.solve(system.target(pose))
    rotations = best_rotations(surface, surface.rest, pose)
    least = energy(surface, surface.rest, step, rotations)
    assert least < energy(surface, surface.rest, pose, rotations)
    for _ in range(5):
        other = step + 1e-3 * random.normal(size=step.shape)
        assert energy(surface, surface.rest, other, rotations) > least
    changes = [edge_log_ratio(surface.rest, points, surface.edges) for points in (pose, step)]
    assert changes[1] < 0.5 * changes[0]


def test_the_image_of_a_pose_is_its_right_hand_side() -> None:
    surface = Surface(*torus())
    pose = surface.rest + 0.01 * np.random.default_rng(0).normal(size=surface.rest.shape)
    system = ArapSystem(surface, surface.rest)
    assert np.abs(system.solve(system.image(pose)) - pose).max() < 1e-10


def test_one_factor_serves_every_pose() -> None:
    surface = Surface(*torus(16, 8))
    before = Factor.count
    for seed in range(3):
        original = surface.rest @ rotation(seed).T
        system = ArapSystem(surface, original)
        system.solve(system.target(original))
    assert Factor.count == before + 1


def test_collapsed_surroundings_stay_finite() -> None:
    surface = Surface(*torus(16, 8))
    pose = surface.rest.copy()
    pose[:40] = pose[0]
    system = ArapSystem(surface, surface.rest)
    assert np.isfinite(system.solve(system.target(pose))).all()


def test_a_small_region_has_its_own_system_within_surroundings_that_stay() -> None:
    surface = Surface(*torus(40, 16))
    region = surface.dilate(np.arange(surface.count) == 100, 4)
    assert region.mean() < ArapOptions.small_region
    random = np.random.default_rng(0)
    pose = surface.rest + 0.01 * region[:, None] * random.normal(size=surface.rest.shape)
    before = Factor.count
    whole, own = ArapSystem(surface, surface.rest), ArapSystem(surface, surface.rest, region=region)
    right = own.target(pose)
    assert np.abs(right - whole.target(pose))[region].max() < 1e-15
    motion = own.solve(right - own.image(pose))
    assert motion.any() and not motion[~region].any() and not right[~region].any()
    # At the end of the step the equations hold in the region.
    residual = whole.target(pose) - whole.image(pose + motion)
    assert np.abs(residual[region]).max() < 1e-12 < np.abs(residual).max()
    assert Factor.count == before + 1
