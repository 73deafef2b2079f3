"""The push: its gradients, what it separates, and that nothing makes it leave the numbers."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.full.directions import tangent_point_gradient
from dtrepair.repair.full.push import PushOptions, push
from dtrepair.repair.paper.corner_energy import SignedTangentPoint
from dtrepair.repair.paper.energy import pair_energy
from dtrepair.repair.surface.defects import near_contacts
from dtrepair.repair.surface.surface import BodyRange, Surface
from tests.meshes import (
    Mesh,
    armed_body,
    crossing_tubes,
    elbow,
    icosphere,
    joined,
    knot,
    overlapping_spheres,
)


def detached_energy(
    points: FloatArray, reference: FloatArray, faces: IntArray, pairs: IntArray, weights: FloatArray
) -> float:
    """Sum of w A <n, c - v> / |c - v| with normals n and areas A of the reference."""
    total = 0.0
    for weight, (one, other) in zip(weights, pairs.tolist(), strict=True):
        for plane, moving in ((one, other), (other, one)):
            a, b, c = reference[faces[plane]]
            vector = np.cross(b - a, c - a)
            area = 0.5 * np.linalg.norm(vector)
            normal = vector / np.linalg.norm(vector)
            for v in faces[moving]:
                offset = points[faces[plane]].mean(axis=0) - points[v]
                total += weight * area * (normal @ offset) / np.linalg.norm(offset)
    return total


def crossing_pairs() -> tuple[Surface, IntArray, FloatArray]:
    surface = Surface(*overlapping_spheres(1, 1.4))
    pairs = surface.contacts.pairs(surface.rest)
    return surface, pairs, np.random.default_rng(0).random(len(pairs)) + 0.5


def test_tangent_point_gradient_agrees_with_finite_differences() -> None:
    surface, pairs, weights = crossing_pairs()
    points, faces = surface.rest, surface.faces
    gradient = tangent_point_gradient(points, faces, pairs, weights)
    assert np.abs(gradient).max() > 1e-4
    random = np.random.default_rng(1)
    for _ in range(5):
        way = random.normal(size=points.shape)
        step = 1e-6
        high, low = (
            detached_energy(points + sign * step * way, points, faces, pairs, weights)
            for sign in (1, -1)
        )
        slope = (high - low) / (2 * step)
        assert (gradient * way).sum() == pytest.approx(slope, rel=1e-6, abs=1e-9)


def test_tangent_point_gradient_is_that_of_the_batched_energy() -> None:
    surface, pairs, weights = crossing_pairs()
    gradient = tangent_point_gradient(surface.rest, surface.faces, pairs, weights)
    frames = np.concatenate([np.zeros((len(pairs), 1), np.int64), pairs], axis=1)
    batched = pair_energy(
        torch.from_numpy(surface.rest[None]),
        torch.from_numpy(surface.faces.astype(np.int64)),
        torch.from_numpy(frames),
        kernel=SignedTangentPoint(),
        weights=torch.from_numpy(weights),
    )[1][0].numpy()
    assert np.allclose(gradient, batched, rtol=0, atol=1e-9 * np.abs(batched).max())


def test_tangent_point_gradient_pushes_nothing_as_a_whole() -> None:
    surface, pairs, weights = crossing_pairs()
    gradient = tangent_point_gradient(surface.rest, surface.faces, pairs, weights)
    assert np.abs(gradient.sum(axis=0)).max() < 1e-12


def test_tangent_point_gradient_of_degenerate_triangles_is_finite() -> None:
    # A needle, a point, and a triangle whose corner is the other's centroid.
    points = np.array(
        [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [3, 1, 0], [0, 4, 0], [1, 2, 0], [1, 2, 5]],
        dtype=np.float64,
    )
    faces = np.array([[0, 1, 2], [3, 3, 3], [3, 4, 5], [6, 7, 0]], dtype=np.int32)
    pairs = np.array([[0, 2], [1, 2], [2, 3], [0, 1]], dtype=np.int32)
    assert np.isfinite(tangent_point_gradient(points, faces, pairs, np.ones(4))).all()
    nothing = tangent_point_gradient(points, faces, pairs[:0], np.zeros(0))
    assert (nothing == 0).all()


POSES: dict[str, tuple[Mesh, Mesh]] = {
    "tubes": (crossing_tubes(8, 20), crossing_tubes(8, 20)),
    "spheres": (overlapping_spheres(), overlapping_spheres()),
    "knot": (knot(), knot(tube_radius=0.3)),
    "arm": (armed_body(4.2), armed_body(0.0)),
    "elbow": (elbow(2.4), elbow(0.0)),
}


def surface_and_pose(kind: str) -> tuple[Surface, FloatArray]:
    (points, faces), (rest, _) = POSES[kind]
    surface = Surface(rest, faces)
    return surface, points / surface.size


@pytest.mark.parametrize("kind", ["tubes", "spheres", "knot", "arm"])
def test_push_separates_parts(kind: str) -> None:
    surface, pose = surface_and_pose(kind)
    kept = pose.copy()
    before = surface.contacts.pairs(pose)
    pushed = push(surface, pose, near=6, step=0.01, options=PushOptions(iterations=40))
    assert np.isfinite(pushed.points).all()
    assert np.array_equal(pose, kept)
    assert np.array_equal(pushed.pairs, surface.contacts.pairs(pushed.points))
    far = [int((~near_contacts(surface, pairs, 6)).sum()) for pairs in (before, pushed.pairs)]
    assert far[0] > 20 and far[1] <= 0.1 * far[0]
    assert 0 < pushed.iterations <= 40


@pytest.mark.parametrize("kind", POSES)
@pytest.mark.parametrize("step", [0.01, 0.3])
def test_no_vertex_moves_farther_than_the_steps_allow(kind: str, step: float) -> None:
    surface, pose = surface_and_pose(kind)
    pushed = push(surface, pose, near=0, step=step, options=PushOptions(iterations=8))
    moved = np.linalg.norm(pushed.points - pose, axis=1).max()
    assert np.isfinite(pushed.points).all()
    assert moved <= step * pushed.iterations * (1 + 1e-9)


@pytest.mark.parametrize("tilt", [0.0, 1e-7, 1e-3])
def test_a_symmetric_pose_stays_finite(tilt: float) -> None:
    # Two spheres at one place cancel every direction; a flat knot is coplanar with itself.
    ball, faces = icosphere(2)
    points, triangles = joined((ball, faces), (ball * (1 + tilt) + tilt, faces))
    surface = Surface(points, triangles)
    pushed = push(surface, surface.rest, near=6, step=0.01, options=PushOptions(iterations=5))
    assert np.isfinite(pushed.points).all()
    points, triangles = knot(60, 8)
    surface = Surface(points, triangles)
    flat = surface.rest * np.array([1.0, 1.0, tilt])
    assert np.isfinite(
        push(surface, flat, near=6, step=0.01, options=PushOptions(iterations=5)).points
    ).all()


def test_creases_are_left_alone() -> None:
    surface, pose = surface_and_pose("elbow")
    assert len(surface.contacts.pairs(pose)) > 20
    pushed = push(surface, pose, near=20, step=0.01)
    assert pushed.iterations == 0
    assert np.array_equal(pushed.points, pose)
    assert len(pushed.pairs) == len(surface.contacts.pairs(pose))


def test_a_clean_pose_is_left_alone() -> None:
    points, faces = elbow(0.0)
    surface = Surface(points, faces)
    pushed = push(surface, surface.rest, near=0, step=0.01)
    assert pushed.iterations == 0 and len(pushed.pairs) == 0
    assert np.array_equal(pushed.points, surface.rest)


def test_known_pairs_save_a_detection_and_change_nothing() -> None:
    surface, pose = surface_and_pose("arm")
    one = push(surface, pose, near=6, step=0.01)
    other = push(surface, pose, near=6, step=0.01, known_pairs=surface.contacts.pairs(pose))
    assert np.array_equal(one.points, other.points)
    assert one.iterations == other.iterations


def test_no_iterations_return_the_pose() -> None:
    surface, pose = surface_and_pose("arm")
    pushed = push(surface, pose, near=6, step=0.01, options=PushOptions(iterations=0))
    assert pushed.iterations == 0 and np.array_equal(pushed.points, pose)


def test_fixed_vertices_stay() -> None:
    points, faces = overlapping_spheres()
    half = len(points) // 2
    mobility = np.repeat([0.0, 1.0], half)
    bodies = [BodyRange(0, half, 99.0), BodyRange(half, 2 * half, 99.0)]
    surface = Surface(points, faces, bodies=bodies, mobility=mobility)
    pushed = push(surface, surface.rest, near=6, step=0.01, options=PushOptions(iterations=60))
    assert np.array_equal(pushed.points[:half], surface.rest[:half])
    assert len(pushed.pairs) == 0


def test_nothing_can_move_an_all_fixed_surface() -> None:
    points, faces = overlapping_spheres()
    surface = Surface(points, faces, mobility=np.zeros(len(points)))
    pushed = push(surface, surface.rest, near=6, step=0.01)
    assert np.array_equal(pushed.points, surface.rest)


def test_a_part_wholly_inside_another_keeps_its_size() -> None:
    # A ball inside the first of two spheres that meet elsewhere: buried, and no way out.
    ball, ball_faces = icosphere(2, radius=0.2)
    points, faces = overlapping_spheres()
    mesh = joined((points, faces), (ball - np.array([0.5, 0.0, 0.0]), ball_faces))
    surface = Surface(*mesh)
    alone = Surface(points, faces)
    inner = slice(len(points), None)
    pushed = push(surface, surface.rest, near=6, step=0.01, options=PushOptions(iterations=40))
    assert len(pushed.pairs) == 0
    assert np.array_equal(pushed.points[inner], surface.rest[inner])
    # Nor does it keep the others from coming apart, or change how.
    without = push(alone, alone.rest, near=6, step=0.01, options=PushOptions(iterations=40))
    assert pushed.iterations == without.iterations


def test_a_small_part_goes_no_farther_than_its_size_allows() -> None:
    ball, faces = icosphere(2)
    surface = Surface(*joined((ball, faces), (0.1 * ball + np.array([1.05, 0.0, 0.0]), faces)))
    own = slice(len(ball), None)
    assert surface.part_sizes.tolist() == pytest.approx([2.0 / 2.15, 0.2 / 2.15], rel=0.02)
    moved = {}
    for part in (0.05, np.inf):
        options = PushOptions(iterations=1, part=part)
        pushed = push(surface, surface.rest, near=0, step=0.2, options=options)
        moved[part] = float(np.linalg.norm((pushed.points - surface.rest)[own], axis=1).max())
    assert moved[np.inf] > 0.1
    assert moved[0.05] == pytest.approx(0.05 * surface.part_sizes[1])
