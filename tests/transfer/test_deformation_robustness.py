"""Deformation transfer: precision, repeatability, bad triangles and wrong arguments."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from dtrepair.numerics.operators import Factor
from dtrepair.transfer import Transfer, identity_pairs, match_triangles
from tests.meshes import Mesh, icosphere, torus
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


def test_one_factor_for_any_number_of_poses(shapes: Shapes) -> None:
    before = Factor.count
    transfer = Transfer(*shapes)
    transfer(np.stack([bent(shapes[0], amount) for amount in np.linspace(0, 1, 20)]))
    transfer(shapes[0])
    assert Factor.count - before == 1


def test_a_repeat_is_bitwise_and_batches_do_not_matter(shapes: Shapes) -> None:
    poses = np.stack([bent(shapes[0], amount) for amount in (0.1, 0.5, 0.9)])
    once = Transfer(*shapes)(poses)
    np.testing.assert_array_equal(once, Transfer(*shapes)(poses))
    np.testing.assert_array_equal(once[1], Transfer(*shapes)(poses[1]))


def test_one_or_two_threads_give_the_same_bits() -> None:
    code = (
        "import hashlib, numpy as np\n"
        "from tests.meshes import torus\n"
        "from dtrepair.transfer import Transfer, match_triangles\n"
        "a, b = torus(24, 12), torus(31, 14, 1.1, 0.35)\n"
        "t = Transfer(*a, *b, match_triangles(*a, *b))\n"
        "print(hashlib.sha256(t(a[0] * (1.0, 1.3, 0.7)).tobytes()).hexdigest())\n"
    )
    hashes = set()
    for threads in ("1", "2"):
        environment = {
            **os.environ,
            "OMP_NUM_THREADS": threads,
            "OPENBLAS_NUM_THREADS": threads,
            "PYTHONPATH": str(Path(__file__).parents[2]),
        }
        done = subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        hashes.add(done.stdout)
    assert len(hashes) == 1


def test_float32_and_torch_come_back_as_they_came(shapes: Shapes) -> None:
    transfer = Transfer(*shapes)
    pose = bent(shapes[0])
    exact = transfer(pose)
    single = transfer(pose.astype(np.float32))
    assert single.dtype == np.float32
    assert errors(single, exact) < 2e-6
    rests = [np.asarray(a, dtype=np.float32) if k in (0, 2) else a for k, a in enumerate(shapes)]
    assert errors(Transfer(*rests)(pose), exact) < 2e-6
    tensors = Transfer(*(torch.from_numpy(array) for array in shapes))
    found = tensors(torch.from_numpy(pose[None]).float())
    assert isinstance(found, torch.Tensor) and found.dtype == torch.float32
    assert found.shape == (1, 434, 3)
    np.testing.assert_array_equal(tensors(torch.from_numpy(pose)).numpy(), exact)


def test_inputs_are_not_written_to(shapes: Shapes) -> None:
    kept = [array.copy() for array in shapes]
    pose = bent(shapes[0])
    before = pose.copy()
    Transfer(*shapes)(pose)
    np.testing.assert_array_equal(pose, before)
    for array, copy in zip(shapes, kept, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_zero_area_triangles_change_nothing(ball: Mesh) -> None:
    points, faces = ball
    plain = Transfer(points, faces, points, faces, identity_pairs(faces))(bent(points))
    rng = np.random.default_rng(2)
    edges = faces[rng.integers(len(faces), size=400), :2]
    # Half of them repeat a vertex; half have a vertex of their own in the middle of an edge.
    middles = points[edges[200:]].mean(axis=1)
    more = np.concatenate([points, middles])
    new = [*((a, b, b) for a, b in edges[:200])]
    new += [(a, b, len(points) + k) for k, (a, b) in enumerate(edges[200:])]
    all_faces = np.concatenate([faces, new]).astype(np.int32)
    transfer = Transfer(more, all_faces, more, all_faces, identity_pairs(all_faces))
    pose = np.concatenate([bent(points), bent(points)[edges[200:]].mean(axis=1)])
    found = transfer(pose)
    assert np.isfinite(found).all()
    assert errors(found[: len(points)], plain) < 1e-9
    # The hanging vertices have no equation but the weak edges; they stay near theirs.
    assert errors(found[len(points) :], pose[len(points) :]) < 0.02


@pytest.mark.parametrize("height", [1e-3, 1e-5, 1e-7, 1e-9])
def test_cap_triangles_do_not_disturb_their_neighbours(ball: Mesh, height: float) -> None:
    points, faces = ball
    rng = np.random.default_rng(3)
    capped = rng.choice(len(faces), 200, replace=False)
    a, b, c = (points[faces[capped, k]] for k in range(3))
    # A vertex close to the middle of an edge splits the triangle into a cap and two others.
    tips = 0.5 * (a + b) + height * (c - 0.5 * (a + b))
    more = np.concatenate([points, tips])
    tip = len(points) + np.arange(200)
    kept = np.delete(faces, capped, axis=0)
    corners = faces[capped].T
    parts = [
        np.stack(part, axis=1)
        for part in (
            (corners[0], corners[1], tip),
            (corners[1], corners[2], tip),
            (corners[2], corners[0], tip),
        )
    ]
    all_faces = np.concatenate([kept, *parts]).astype(np.int32)
    transfer = Transfer(more, all_faces, more, all_faces, identity_pairs(all_faces))
    assert errors(transfer(more @ TURN.T), more @ TURN.T) < 1e-6
    pose = np.concatenate([bent(points), np.zeros((200, 3))])
    d, e, f = (pose[faces[capped, k]] for k in range(3))
    pose[tip] = 0.5 * (d + e) + height * (f - 0.5 * (d + e))
    found = transfer(pose)
    assert np.isfinite(found).all()
    assert errors(found, pose) < 1e-6


def test_wrong_arguments_are_refused(shapes: Shapes) -> None:
    source, source_faces, target, target_faces, pairs = shapes
    with pytest.raises(ValueError, match=r"weights should be .* got 'volume'"):
        Transfer(*shapes, weights="volume")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"rotation should have shape \(3, 3\)"):
        Transfer(*shapes, rotation=np.eye(4))
    for wrong in (2.0 * np.eye(3), np.diag([1.0, 1.0, -1.0])):
        with pytest.raises(ValueError, match="orthogonal with determinant 1"):
            Transfer(*shapes, rotation=wrong)
    with pytest.raises(ValueError, match=r"pieces should be 'seated' or 'separate'"):
        Transfer(*shapes, pieces="loose")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"source triangles 0..575, got index 576"):
        Transfer(source, source_faces, target, target_faces, [[576, 0]])
    with pytest.raises(ValueError, match="triangles with an area"):
        Transfer(source, source_faces, 0.0 * target, target_faces, pairs)
    with pytest.raises(ValueError, match="no target triangle has a usable source"):
        Transfer(0.0 * source, source_faces, target, target_faces, pairs)
    transfer = Transfer(*shapes)
    with pytest.raises(ValueError, match=r"288 rows.*got 287"):
        transfer(source[:-1])
    with pytest.raises(ValueError, match="poses should have shape"):
        transfer(source[0])
    with pytest.raises(ValueError, match="finite"):
        transfer(np.where(np.arange(288)[:, None] == 9, np.nan, source))


def test_a_factor_that_failed_is_an_error_not_a_result(
    shapes: Shapes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Factor, "__call__", lambda self, rows: np.full(rows.shape, np.nan))
    with pytest.raises(ValueError, match=r"could not be factorised.*weights='area'"):
        Transfer(*shapes)
