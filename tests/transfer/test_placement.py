"""Where the pieces of the target go: root, ground, riding and separate pieces."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dtrepair.numerics.geometry import diagonal
from dtrepair.transfer import (
    RegistrationOptions,
    Transfer,
    identity_pairs,
    match_triangles,
    register,
    similarity,
)
from tests.meshes import Mesh, icosphere, joined, subdivided, torus
from tests.quadruped import SOURCE, TARGET, Quadruped, markers

Animals = tuple[
    NDArray[np.float64],
    NDArray[np.int32],
    NDArray[np.float64],
    NDArray[np.int32],
    NDArray[np.int64],
]


def correspondence(
    source: NDArray[np.float64],
    source_faces: NDArray[np.int32],
    target: NDArray[np.float64],
    target_faces: NDArray[np.int32],
    rows: NDArray[np.int32],
) -> NDArray[np.int64]:
    """Pairs by registration with few steps: the figures do not need more."""
    registered = register(
        source,
        source_faces,
        target,
        target_faces,
        rows,
        options=RegistrationOptions(closest=(0.0, 10.0, 1000.0)),
    )
    result: NDArray[np.int64] = match_triangles(registered, source_faces, target, target_faces)
    return result


@pytest.fixture(scope="module")
def animals() -> Animals:
    (source, source_faces), (target, target_faces) = SOURCE.mesh(), TARGET.mesh()
    rows = markers(SOURCE, source, TARGET, target)
    pairs = correspondence(source, source_faces, target, target_faces, rows)
    return source, source_faces, target, target_faces, pairs


def test_pieces_that_move_separately_are_met_and_an_unused_vertex_rides_along() -> None:
    points, faces = joined(icosphere(2), torus(), icosphere(1))
    pieces = np.repeat([0, 1, 2], [162, 512, 42])
    points = points + 3.0 * np.eye(3)[pieces]
    points = np.concatenate([points, [[0.1, 0.2, 0.3]]])
    pose = points.copy()
    for piece, vector in enumerate(([0.3, 0.0, 1.0], [0.0, -0.5, 0.2], [1.0, 1.0, 0.0])):
        mine = np.flatnonzero(pieces == piece)
        pose[mine] = Rotation.from_rotvec(vector).apply(points[mine]) + vector
    for mode in ("seated", "separate"):
        transfer = Transfer(points, faces, points, faces, identity_pairs(faces), pieces=mode)
        found = transfer(pose)
        assert np.abs(found - pose)[:-1].max() < 1e-10 * diagonal(points)
        np.testing.assert_allclose(transfer(points)[-1], points[-1], atol=1e-12)
    moved = Transfer(points, faces, points, faces, identity_pairs(faces))(points + 5.0)
    np.testing.assert_allclose(moved[-1], points[-1] + 5.0, atol=1e-12)


def with_eyes(animal: Quadruped, points: NDArray[np.float64], faces: NDArray[np.int32]) -> Mesh:
    """The animal with two small balls that touch its head; their vertices come last."""
    ball = icosphere(2)
    size = 0.12
    head = animal.body + 0.4, animal.leg + 0.55 + animal.neck + 0.2
    eyes = [
        (size * ball[0] + (head[0] + 0.05, head[1], side * 0.12), ball[1]) for side in (-1.0, 1.0)
    ]
    return joined((points, faces), *eyes)


@pytest.mark.parametrize("source_has_eyes", [True, False])
def test_riding_pieces_keep_their_seat(animals: Animals, source_has_eyes: bool) -> None:
    body, body_faces, target, target_faces, _ = animals
    riding, riding_faces = with_eyes(TARGET, target, target_faces)
    source, source_faces = body, body_faces
    if source_has_eyes:
        source, source_faces = with_eyes(SOURCE, body, body_faces)
    rows = markers(SOURCE, body, TARGET, target)
    pairs = correspondence(source, source_faces, riding, riding_faces, rows)
    pose = SOURCE.posed(source, (0.5, -0.5, 0.3, -0.3), -1.3)
    eyes, size = slice(len(target), None), diagonal(riding)
    near = np.linalg.norm(target[:, None] - riding[None, eyes].mean(axis=1), axis=2).min(axis=1)
    head = np.flatnonzero(near < 0.25)
    errors, bodies = {}, {}
    for mode in ("seated", "separate"):
        found = Transfer(source, source_faces, riding, riding_faces, pairs, pieces=mode)(pose)
        carried = similarity(riding[head], found[head])(riding[eyes].mean(axis=0)[None])
        errors[mode] = np.linalg.norm(found[eyes].mean(axis=0) - carried[0]) / size
        bodies[mode] = found[: len(target)]
    assert errors["seated"] < 0.005
    np.testing.assert_array_equal(bodies["seated"], bodies["separate"])
    if source_has_eyes:
        assert errors["separate"] > 0.05


def test_the_root_does_not_depend_on_the_tessellation() -> None:
    points, faces = torus(24, 12)
    upright = points[:, [0, 2, 1]] * (1.0, 1.0, -1.0)
    # The half with x > 0 gets four times as many triangles (split apart, so vertices repeat).
    right = upright[faces].mean(axis=1)[:, 0] > 0
    fine = subdivided(upright, faces[right])
    mixed, mixed_faces = joined((upright, faces[~right]), fine)
    owners = np.concatenate([np.flatnonzero(~right), np.tile(np.flatnonzero(right), 4)])
    pairs = np.stack([owners, np.arange(len(mixed_faces))], axis=1)
    pose = upright * (1.0, 2.0, 1.0) + (0.5, 3.0, 0.0)
    transfer = Transfer(upright, faces, mixed, mixed_faces, pairs, pieces="separate")
    expected = mixed * (1.0, 2.0, 1.0) + (0.5, 3.0, 0.0)
    used = np.unique(mixed_faces)
    assert np.abs(transfer(pose) - expected)[used].max() < 1e-10 * diagonal(mixed)


def test_the_translation_is_scaled_by_the_heights_over_the_ground(animals: Animals) -> None:
    source, source_faces, target, target_faces, pairs = animals
    transfer = Transfer(source, source_faces, target, target_faces, pairs)
    assert 1.2 < transfer.placement.ratio < 1.4
    step = np.array([2.0, 0.5, -1.0])
    found = transfer(source + step)
    np.testing.assert_allclose(found, target + transfer.placement.ratio * step, atol=1e-10)
    given = Transfer(source, source_faces, target, target_faces, pairs, scale=2.0)
    np.testing.assert_allclose(given(source + step), target + 2.0 * step, atol=1e-10)


def test_meshes_that_lie_flat_use_the_ratio_of_their_sizes() -> None:
    points, faces = icosphere(1)
    flat = points * (1.0, 0.0, 1.0)
    transfer = Transfer(flat, faces, 3.0 * flat, faces, identity_pairs(faces))
    assert transfer.placement.ratio == pytest.approx(3.0, rel=1e-12)


def test_feet_stay_on_the_ground_in_a_walk(animals: Animals) -> None:
    source, source_faces, target, target_faces, pairs = animals
    poses = SOURCE.walk(source, 12)
    height, ground = np.ptp(target[:, 1]), target[:, 1].min()
    found = Transfer(source, source_faces, target, target_faces, pairs)(poses)
    error = np.abs(found[:, :, 1].min(axis=1) - ground) / height
    assert error.max() < 0.01
    snapped = Transfer(source, source_faces, target, target_faces, pairs, snap=True)(poses)
    np.testing.assert_allclose(snapped[:, :, 1].min(axis=1), ground, atol=1e-12)
    assert np.abs(snapped - found).max() < 0.01 * height
    lifted = Transfer(source, source_faces, target, target_faces, pairs, snap=True)
    jump = lifted(poses[:1] + np.array([0.0, 0.4, 0.0]))[0, :, 1].min()
    assert jump == pytest.approx(ground + 0.4 * lifted.placement.ratio, abs=1e-12)


def test_the_ground_lies_across_the_given_up_axis(animals: Animals) -> None:
    source, source_faces, target, target_faces, pairs = animals
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # y up to z up
    plain = Transfer(source, source_faces, target, target_faces, pairs, snap=True)
    turned = Transfer(
        source,
        source_faces,
        target @ turn.T,
        target_faces,
        pairs,
        rotation=turn,
        up=(0.0, 0.0, 2.0),
        snap=True,
    )
    assert turned.placement.ratio == pytest.approx(plain.placement.ratio, rel=1e-12)
    pose = SOURCE.walk(source, 3)[1]
    np.testing.assert_allclose(turned(pose), plain(pose) @ turn.T, atol=1e-10)
    with pytest.raises(ValueError, match="up should be a vector"):
        Transfer(source, source_faces, target, target_faces, pairs, up=(0.0, 0.0, 0.0))
