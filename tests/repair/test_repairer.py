"""Repairer: types, bits kept, counts, pins, units, and what it must never call clean."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

import dtrepair
import dtrepair.intersect.detector
from dtrepair import Repairer, RepairOptions, RepairResult, Status, find_intersections, repair_mesh
from dtrepair.intersect.tree import build_tree
from dtrepair.numerics.geometry import FloatArray, diagonal, weld_map
from dtrepair.numerics.operators import Factor
from tests.exact_reference import check_counts
from tests.meshes import (
    Mesh,
    armed_body,
    crossing_tubes,
    elbow,
    icosphere,
    joined,
    klein_bottle,
    knot,
    overlapping_spheres,
    torus,
    with_seam,
)

POSES: dict[str, tuple[Mesh, Mesh]] = {
    "tubes": (crossing_tubes(8, 20), crossing_tubes(8, 20)),
    "spheres": (overlapping_spheres(), overlapping_spheres()),
    "knot": (knot(), knot(tube_radius=0.3)),
    "arm": (armed_body(4.2), armed_body(0.0)),
    "crease": (elbow(2.0), elbow(0.0)),
}
ARM, REST = armed_body(4.2)[0], armed_body(0.0)[0]
FACES = armed_body(0.0)[1]


@pytest.fixture(scope="module")
def plain() -> RepairResult:
    return Repairer(REST, FACES)(ARM)


@pytest.mark.parametrize("kind", POSES)
def test_poses_come_out_clean_by_an_independent_count(kind: str) -> None:
    (points, faces), (rest, _) = POSES[kind]
    result = Repairer(rest, faces)(points)
    check_counts(result, points, faces)
    assert result.before.pairs > 20 and result.after.pairs == 0
    assert result.status is Status.CLEAN and result.message == ""
    moved = np.linalg.norm(result.points - points, axis=1) / diagonal(points)
    assert result.displacement_max == pytest.approx(moved.max(), rel=1e-9)
    assert result.displacement_mean == pytest.approx(moved.mean(), rel=1e-9)
    assert 0 < result.displacement_max < 0.2
    assert result.iterations == sum(stage.iterations for stage in result.stages)
    assert set(result.seconds) == {"detect", "solve"}


@pytest.mark.parametrize("method", ["full", "paper"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64, torch.float32, torch.float64, int])
def test_clean_poses_come_back_bit_identical(method: str, dtype: Any) -> None:
    points, faces = torus()
    pose = (
        torch.from_numpy(points).to(dtype)
        if isinstance(dtype, torch.dtype)
        else (1000 * points if dtype is int else points).astype(dtype)
    )
    result = Repairer(points, faces, options=RepairOptions(method=method))(pose)
    assert result.status is Status.CLEAN and result.iterations == 0
    assert result.displacement_max == 0.0 and result.before.pairs == 0
    if isinstance(dtype, torch.dtype):
        assert isinstance(pose, torch.Tensor)
        assert result.points.dtype == dtype and torch.equal(result.points, pose)
        assert result.points is not pose
    else:
        assert result.points.dtype == (np.float64 if dtype is int else dtype)
        assert np.array_equal(result.points, pose) and not np.shares_memory(result.points, pose)


def test_results_have_the_type_of_their_input() -> None:
    repairer = Repairer(REST, FACES)
    single = ARM.astype(np.float32)
    kept = single.copy()
    result = repairer(single)
    assert result.points.dtype == np.float32 and np.array_equal(single, kept)
    tensor = repairer(torch.from_numpy(single))
    assert tensor.points.dtype == torch.float32
    assert np.array_equal(tensor.points.numpy(), result.points)
    check_counts(result, single, FACES)
    # Float64 results hold float32 coordinates: those that are counted are those that are written.
    double = repairer(ARM)
    moved = (double.points != ARM).any(axis=1)
    assert np.array_equal(double.points[moved], double.points[moved].astype(np.float32))
    check_counts(double, ARM, FACES)


def test_vertices_that_stay_keep_every_bit() -> None:
    # A crease in the middle of a long tube; its ends have odd float64 coordinates.
    (points, faces), (rest, _) = elbow(1.6, along=80), elbow(0.0, along=80)
    result = Repairer(rest, faces)(points)
    assert result.status is Status.CLEAN
    ends = np.r_[0 : 12 * 8, 12 * 73 : len(points)]
    assert np.array_equal(result.points[ends], points[ends])
    assert not np.array_equal(points[ends], points[ends].astype(np.float32))


def test_two_calls_are_bit_identical(plain: RepairResult) -> None:
    repairer = Repairer(REST, FACES)
    repairer(armed_body(5.0)[0])
    assert np.array_equal(repairer(ARM).points, plain.points)


@pytest.mark.parametrize("method", ["full", "paper"])
def test_factors_and_trees_are_built_once(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    trees: list[int] = []

    def counting(centroids: FloatArray) -> object:
        trees.append(len(centroids))
        return build_tree(centroids)

    monkeypatch.setattr(dtrepair.intersect.detector, "build_tree", counting)
    options = RepairOptions(method=method, iterations=3)
    repairer = Repairer(REST, FACES, options=options)
    repairer(ARM)
    factors, built = Factor.count, len(trees)
    assert built <= 2
    for curl in (4.0, 5.0):
        assert repairer(armed_body(curl)[0]).before.pairs > 0
    assert Factor.count == factors and len(trees) == built


@pytest.mark.parametrize("amount", [1.0, 0.999])
def test_pinned_vertices_stay_exactly(amount: float, plain: RepairResult) -> None:
    pin = np.zeros(len(ARM))
    pin[: 12 * 12] = amount
    pinned = Repairer(REST, FACES, pin=pin)(ARM)
    moved = np.linalg.norm(pinned.points - ARM, axis=1)[: 12 * 12].max()
    assert np.linalg.norm(plain.points - ARM, axis=1)[: 12 * 12].max() > 0.01
    if amount == 1.0:
        assert np.array_equal(pinned.points[: 12 * 12], ARM[: 12 * 12])
    else:
        assert moved < 0.6 * np.linalg.norm(pinned.points - ARM, axis=1).max()
    assert pinned.after.pairs < pinned.before.pairs
    check_counts(pinned, ARM, FACES)


@pytest.mark.parametrize("method", ["full", "paper"])
def test_a_wholly_pinned_mesh_is_unchanged(method: str) -> None:
    options = RepairOptions(method=method, iterations=3)
    result = Repairer(REST, FACES, options=options, pin=np.ones(len(REST)))(ARM)
    assert np.array_equal(result.points, ARM)
    assert result.status is Status.UNCHANGED
    assert "where nothing may move" in result.message
    assert Status.UNCHANGED.meaning in result.message
    assert result.message.endswith("where nothing may move, nothing can be resolved")
    assert result.before == result.after


def test_a_limit_on_the_displacement_holds(plain: RepairResult) -> None:
    limit = 0.3 * plain.displacement_max * diagonal(ARM)
    result = Repairer(REST, FACES, options=RepairOptions(maximum_displacement=limit))(ARM)
    assert 0 < np.linalg.norm(result.points - ARM, axis=1).max() <= limit
    # With so little room the arm is pressed flat, beyond what a limb may lose.
    assert result.status in (Status.CLEAN, Status.IMPROVED, Status.STRAINED)
    check_counts(result, ARM, FACES)


@pytest.mark.parametrize("seed", range(4))
def test_vertices_that_coincide_by_chance_hide_nothing(seed: int) -> None:
    # One vertex of either sphere at the same place in the pose, not in the rest.
    ball, faces = icosphere(2)
    rest, triangles = joined((ball, faces), (ball + np.array([3.0, 0, 0]), faces))
    a, b = np.random.default_rng(seed).integers(0, len(ball), 2)
    pose, _ = joined((ball, faces), (ball + ball[a] - ball[b], faces))
    options = RepairOptions(maximum_displacement=0.05)
    result = Repairer(rest, triangles, options=options)(pose)
    check_counts(result, pose, triangles)


def cut_in_two(mesh: Mesh) -> Mesh:
    """The mesh with a seam along which every vertex is doubled, as between two UV islands."""
    points, faces = mesh
    return with_seam(points, faces, len(faces) // 3)


@pytest.mark.parametrize("kind", ["spheres", "knot", "arm"])
def test_seams_stay_together(kind: str) -> None:
    posed, rested = (cut_in_two(mesh) for mesh in POSES[kind])
    (points, faces), (rest, _) = posed, rested
    twins = weld_map(points)
    doubled = twins != np.arange(len(points))
    # Vertices that no triangle uses are left over by the cut; twins are those in use.
    used = np.isin(np.arange(len(points)), faces)
    assert (doubled & used & used[twins]).sum() > 5
    result = Repairer(rest, faces)(points)
    check_counts(result, points, faces)
    assert result.before.pairs > 0 and result.after.pairs == 0
    assert np.array_equal(result.points[doubled], result.points[twins[doubled]])


@pytest.mark.parametrize("method", ["full", "paper"])
def test_a_surface_that_must_cross_itself_is_never_called_clean(method: str) -> None:
    # No Klein bottle fits into space without crossing itself.
    points, faces = klein_bottle()
    options = RepairOptions(method=method, iterations=20)
    repairer = Repairer(points, faces, options=options)
    result = repairer(points)
    assert result.status in (Status.IMPROVED, Status.UNCHANGED)
    assert result.status.meaning in result.message
    assert "the mesh still intersects itself (" in result.message
    assert result.after.pairs > 0
    assert repairer.rest_intersections == result.before.triangles
    check_counts(result, points, faces)


def test_intersections_of_the_rest_are_told_and_repaired_or_left() -> None:
    points, faces = elbow(2.0)
    expected = len(np.unique(find_intersections(points, faces)))
    assert Repairer(points, faces).rest_intersections == expected > 0
    assert Repairer(REST, FACES).rest_intersections == 0
    assert Repairer(points, faces)(points).status is Status.CLEAN
    options = RepairOptions(rest_contacts="leave")
    left = Repairer(points, faces, options=options)(points)
    assert np.array_equal(left.points, points)
    assert "rest pose" in left.message and str(left.after.pairs) in left.message


def test_a_mesh_takes_the_pose_for_its_own_rest() -> None:
    points, faces = POSES["tubes"][0]
    result = repair_mesh(points, faces)
    assert result.status is Status.CLEAN
    assert np.array_equal(result.points, Repairer(points, faces)(points).points)
    tensor = repair_mesh(torch.from_numpy(points), faces)
    assert np.array_equal(tensor.points.numpy(), result.points)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_preferred_direction_steers_the_repair(sign: float, plain: RepairResult) -> None:
    direction = np.zeros_like(ARM)
    arm = np.arange(len(ARM)) > 12 * 30
    direction[arm, 1] = sign
    result = Repairer(REST, FACES, direction=direction)(ARM)
    assert result.status is Status.CLEAN
    check_counts(result, ARM, FACES)
    along = sign * (result.points - ARM)[arm, 1].mean()
    assert along > 0.02 * diagonal(ARM)
    assert along > abs((plain.points - ARM)[arm, 1].mean())
    none = Repairer(REST, FACES, direction=np.zeros_like(ARM))(ARM)
    assert np.array_equal(none.points, plain.points)


def test_clearance_opens_contacts(plain: RepairResult) -> None:
    def closest(points: FloatArray) -> float:
        # From the arm's far end to the body, far apart along the surface.
        arm, body = points[12 * 45 :], points[: 12 * 18]
        return float(np.linalg.norm(arm[:, None] - body[None], axis=2).min())

    clearance = 0.05
    result = Repairer(REST, FACES, options=RepairOptions(clearance=clearance))(ARM)
    assert result.status is Status.CLEAN and result.message == ""
    check_counts(result, ARM, FACES)
    assert closest(result.points) >= clearance * (1 - 1e-4)
    clean = Repairer(REST, FACES, options=RepairOptions(clearance=clearance))(REST)
    assert np.array_equal(clean.points, REST)


def test_the_package_repairs_like_the_function_it_is_named_after() -> None:
    points, faces = crossing_tubes()
    called = dtrepair.repair(points, faces)
    assert called.status is Status.CLEAN
    assert np.array_equal(called.points, repair_mesh(points, faces).points)
