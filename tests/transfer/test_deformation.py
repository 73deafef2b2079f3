"""Deformation transfer: facts that hold for any pair of meshes.

Thresholds are relative to the bounding-box diagonal of the target unless said otherwise.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

from dtrepair.numerics.geometry import diagonal, triangle_areas
from dtrepair.numerics.operators import cotangent_laplacian
from dtrepair.transfer import Transfer, identity_pairs, match_triangles
from dtrepair.transfer.gradients import degenerate_triangles
from dtrepair.transfer.placement import Placement
from dtrepair.transfer.poisson import poisson_system
from tests.meshes import Mesh, icosphere, joined, torus
from tests.transfer_cases import TURN, bent, errors

Shapes = tuple[
    NDArray[np.float64],
    NDArray[np.int32],
    NDArray[np.float64],
    NDArray[np.int32],
    NDArray[np.int64],
]


@pytest.fixture(scope="module")
def ball() -> Mesh:
    points, faces = icosphere(3)
    return points * np.array([1.0, 1.5, 0.8]), faces


@pytest.fixture(scope="module")
def shapes() -> Shapes:
    """Two tori of different proportion, tessellation and correspondence many to many."""
    source, target = torus(24, 12), torus(31, 14, 1.1, 0.35)
    return *source, *target, match_triangles(*source, *target)


@pytest.mark.parametrize("weights", ["area", "cotan", "count", "uniform"])
def test_identity_gives_the_pose_back(ball: Mesh, weights: Any) -> None:
    points, faces = ball
    transfer = Transfer(points, faces, points, faces, identity_pairs(faces), weights=weights)
    assert errors(transfer(bent(points)), bent(points)) < 1e-10


@pytest.mark.parametrize(("weights", "bar"), [("area", 1e-11), ("count", 1e-9)])
def test_rest_gives_rest(shapes: Shapes, weights: Any, bar: float) -> None:
    transfer = Transfer(*shapes, weights=weights)
    assert errors(transfer(shapes[0]), shapes[2]) < bar


def test_rigid_motion_and_scale_of_the_pose_are_those_of_the_result(shapes: Shapes) -> None:
    transfer = Transfer(*shapes)
    plain = transfer(bent(shapes[0]))
    centre = transfer.placement
    moved = transfer(bent(shapes[0]) @ TURN.T + 5.0)
    scaled = transfer(2.5 * bent(shapes[0]))
    assert errors(moved - moved.mean(axis=0), (plain - plain.mean(axis=0)) @ TURN.T) < 1e-10
    assert errors(scaled - scaled.mean(axis=0), 2.5 * (plain - plain.mean(axis=0))) < 1e-10
    step = transfer(bent(shapes[0]) + np.array([1.0, 2.0, 3.0])) - plain
    np.testing.assert_allclose(step, centre.ratio * np.tile([1.0, 2.0, 3.0], (434, 1)), atol=1e-10)


def test_rigid_motion_and_scale_of_the_pose_with_identity(ball: Mesh) -> None:
    points, faces = ball
    transfer = Transfer(points, faces, points, faces, identity_pairs(faces))
    for pose in (points @ TURN.T + 7.0, 2.5 * points - 3.0):
        assert errors(transfer(pose), pose) < 1e-10


def test_both_rests_turned_and_the_source_in_other_units(shapes: Shapes) -> None:
    source, source_faces, target, target_faces, pairs = shapes
    pose = bent(source)
    plain = Transfer(*shapes)(pose)
    turned = Transfer(
        3.7 * source @ TURN.T + 50.0,
        source_faces,
        target @ TURN.T,
        target_faces,
        pairs,
        up=TURN @ (0.0, 1.0, 0.0),
    )(3.7 * pose @ TURN.T + 50.0)
    assert errors(turned, plain @ TURN.T) < 1e-9


def test_a_turned_target_needs_the_rotation(shapes: Shapes) -> None:
    source, source_faces, target, target_faces, pairs = shapes
    pose = bent(source)
    plain = Transfer(*shapes)(pose)
    turned = (source, source_faces, target @ TURN.T, target_faces, pairs)
    up = TURN @ (0.0, 1.0, 0.0)
    assert errors(Transfer(*turned, rotation=TURN, up=up)(pose), plain @ TURN.T) < 1e-10
    assert errors(Transfer(*turned, up=up)(pose), plain @ TURN.T) > 0.1


def test_a_larger_target_gives_a_larger_result(shapes: Shapes) -> None:
    source, source_faces, target, target_faces, pairs = shapes
    plain = Transfer(*shapes)(bent(source))
    large = Transfer(source, source_faces, 7.0 * target, target_faces, pairs)(bent(source))
    assert errors(large, 7.0 * plain) < 1e-9


def test_far_from_the_origin_nothing_is_lost(shapes: Shapes) -> None:
    source, source_faces, target, target_faces, pairs = shapes
    pose, far = bent(source), 1000.0 * diagonal(target)
    plain = Transfer(*shapes)(pose)
    moved = Transfer(source + far, source_faces, target + far, target_faces, pairs)(pose + far)
    assert errors(moved - far, plain) < 1e-9


def renumbered(
    shapes: Shapes, seed: int = 5
) -> tuple[Shapes, NDArray[np.int64], NDArray[np.int64]]:
    """The same meshes with vertices, faces and corners in another order, and the target's map."""
    source, source_faces, target, target_faces, pairs = shapes
    rng = np.random.default_rng(seed)
    parts, orders = [], []
    for points, faces in ((source, source_faces), (target, target_faces)):
        vertex, face = rng.permutation(len(points)), rng.permutation(len(faces))
        place = np.argsort(vertex)  # where each old vertex went
        turned = np.stack(
            [
                np.roll(row, k)
                for row, k in zip(faces[face], rng.integers(3, size=len(faces)), strict=True)
            ]
        )
        parts += [points[vertex], place[turned].astype(np.int32)]
        orders.append((vertex, np.argsort(face)))
    rows = np.stack([orders[0][1][pairs[:, 0]], orders[1][1][pairs[:, 1]]], axis=1)
    return (*parts, rows[rng.permutation(len(rows))]), orders[0][0], orders[1][0]


def test_the_numbering_does_not_matter(shapes: Shapes) -> None:
    other, source_order, target_order = renumbered(shapes)
    pose = bent(shapes[0])
    plain = Transfer(*shapes)(pose)
    assert errors(Transfer(*other)(pose[source_order]), plain[target_order]) < 1e-10


def test_the_numbering_does_not_matter_on_non_manifold_meshes_with_holes_to_fill(
    shapes: Shapes,
) -> None:
    source, source_faces, target, target_faces, pairs = shapes
    fin = target[target_faces[:4, 0]] + np.array([0.0, 0.0, 0.5])
    target = np.concatenate([target, fin])
    fins = [[a, b, len(target) - 4 + k] for k, (a, b) in enumerate(target_faces[:4, :2])]
    target_faces = np.concatenate([target_faces, fins]).astype(np.int32)
    centroids = target[target_faces].mean(axis=1)
    hole = np.flatnonzero(
        (centroids[:, 0] > 0.9) | (np.arange(len(centroids)) >= len(centroids) - 4)
    )
    case = (source, source_faces, target, target_faces, pairs[~np.isin(pairs[:, 1], hole)])
    other, source_order, target_order = renumbered(case)
    pose = bent(source)
    plain = Transfer(*case)(pose)
    assert errors(Transfer(*other)(pose[source_order]), plain[target_order]) < 1e-6


def test_the_anchor_vertex_does_not_matter(shapes: Shapes, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = Transfer(*shapes)(bent(shapes[0]))
    monkeypatch.setattr(Placement, "anchors", lambda self: np.array([311], dtype=np.int32))
    assert errors(Transfer(*shapes)(bent(shapes[0])), plain) < 1e-10


def paper_solution(shapes: Shapes, pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sumner & Popovic 2004, eq. 8, as printed: a fourth vertex for each target triangle."""
    source, source_faces, target, target_faces, pairs = shapes
    count, triangles = len(target), len(target_faces)

    def frames(points: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.float64]:
        first, second = (
            points[faces[:, 1]] - points[faces[:, 0]],
            points[faces[:, 2]] - points[faces[:, 0]],
        )
        normal = np.cross(first, second)
        normal /= np.sqrt(np.linalg.norm(normal, axis=1))[:, None]
        return np.stack([first, second, normal], axis=2)

    wanted = frames(pose, source_faces) @ np.linalg.inv(frames(source, source_faces))
    inverse = np.linalg.inv(frames(target, target_faces))
    rows, columns, values, right = [], [], [], []
    for row, (s, t) in enumerate(pairs):
        corners = [*target_faces[t], count + t]
        weights = np.concatenate([-inverse[t].sum(axis=0)[None], inverse[t]])
        for axis in range(3):
            rows += [3 * row + axis] * 4
            columns += corners
            values += list(weights[:, axis])
            right.append(wanted[s][:, axis])
    system = sparse.csr_matrix((values, (rows, columns)), (3 * len(pairs), count + triangles))
    free = np.arange(1, count + triangles)  # vertex 0 at the origin
    system = system[:, free]
    solution = spsolve((system.T @ system).tocsc(), system.T @ np.array(right))
    return np.concatenate([np.zeros((1, 3)), solution[: count - 1]])


def test_the_reduced_system_is_the_papers(shapes: Shapes) -> None:
    pose = bent(shapes[0])
    found = Transfer(*shapes, weights="count")(pose)
    expected = paper_solution(shapes, pose)
    assert errors(found - found[0], expected) < 1e-10


def test_area_weights_give_the_cotangent_laplacian(shapes: Shapes) -> None:
    target, faces = shapes[2], shapes[3]
    matrix = poisson_system(
        target, faces, degenerate_triangles(target, faces), triangle_areas(target, faces)
    )[1]
    expected = cotangent_laplacian(target, faces)
    assert abs(matrix - expected).max() < 1e-12
    np.testing.assert_array_equal(
        Transfer(*shapes, weights="cotan")(shapes[0]), Transfer(*shapes)(shapes[0])
    )


def test_holes_follow_their_surroundings_not_the_rest(ball: Mesh) -> None:
    points, faces = ball
    pairs = identity_pairs(faces)
    matched = np.abs(points[faces].mean(axis=1)[:, 1]) < 1.0
    transfer = Transfer(points, faces, points, faces, pairs[matched])
    pose = points @ TURN.T
    assert errors(transfer(pose), pose) < 1e-10
    far, far_faces = joined((points, faces), (0.1 * points + 3.0, faces))
    both = Transfer(points, faces, far, far_faces, pairs)
    expected = far @ TURN.T
    assert errors(both(pose) - both(pose)[0], expected - expected[0]) < 1e-10
