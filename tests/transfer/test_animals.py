"""The transfer's bars on animals: made in code, and the real ones where they are at hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.numerics.geometry import diagonal
from dtrepair.numerics.operators import Factor
from dtrepair.transfer import (
    Transfer,
    check_markers,
    examine,
    match_triangles,
    read_markers,
    register,
    transfer_blend_shapes,
)
from dtrepair.transfer.report import flipped_parts
from tests.meshes import Mesh
from tests.quadruped import SOURCE, TARGET, markers
from tests.transfer_cases import errors

Animals = tuple[
    NDArray[np.float64],
    NDArray[np.int32],
    NDArray[np.float64],
    NDArray[np.int32],
    NDArray[np.int64],
]


@pytest.fixture(scope="module")
def animals() -> Animals:
    (source, source_faces), (target, target_faces) = SOURCE.mesh(), TARGET.mesh()
    rows = markers(SOURCE, source, TARGET, target)
    registered = register(source, source_faces, target, target_faces, rows)
    pairs = match_triangles(registered, source_faces, target, target_faces)
    return source, source_faces, target, target_faces, pairs


def test_a_round_trip_comes_back(animals: Animals) -> None:
    source, source_faces, target, target_faces, pairs = animals
    poses = SOURCE.walk(source, 6)
    there = Transfer(*animals)(poses)
    back = Transfer(target, target_faces, source, source_faces, pairs[:, ::-1])(there)
    off = np.linalg.norm(back - poses, axis=2) / diagonal(source)
    assert np.sqrt((off**2).mean(axis=1)).max() < 0.016
    assert off.max() < 0.06


def test_a_frame_costs_one_back_substitution(
    animals: Animals, monkeypatch: pytest.MonkeyPatch
) -> None:
    transfer, poses = Transfer(*animals), SOURCE.walk(animals[0], 20)
    solves, factors, solve = [], Factor.count, Factor.__call__

    def counted(factor: Factor, right: NDArray[np.float64]) -> NDArray[np.float64]:
        solves.append(factor)
        return solve(factor, right)

    monkeypatch.setattr(Factor, "__call__", counted)
    transfer(poses)
    assert solves == [transfer.factor] * len(poses)
    assert Factor.count == factors


def volume(points: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    corners = points[..., faces, :]
    volumes: NDArray[np.float64] = np.linalg.det(corners).sum(axis=-1) / 6.0
    return volumes


def test_volumes_triangles_and_motion_are_kept(animals: Animals) -> None:
    source, source_faces, target, target_faces, _ = animals
    poses = SOURCE.walk(source, 24)
    transfer = Transfer(*animals)
    found = transfer(poses)
    ratio = volume(found, target_faces) / volume(target, target_faces)
    ratio /= volume(poses, source_faces) / volume(source, source_faces)
    assert 0.88 < ratio.min() and ratio.max() < 1.05
    assert flipped_parts(transfer, poses, found).max() < 0.01
    speeds = [
        np.sqrt((np.diff(animation, n=order, axis=0) ** 2).sum(axis=2).mean()) / diagonal(rest)
        for order in (1, 2)
        for animation, rest in ((found, target), (poses, source))
    ]
    assert speeds[0] / speeds[1] < 1.4
    assert speeds[2] / speeds[3] < 1.5


def test_noise_is_not_amplified(animals: Animals) -> None:
    source, _, target, _, _ = animals
    transfer = Transfer(*animals)
    noise = 1e-3 * np.random.default_rng(0).normal(size=source.shape)
    change = transfer(SOURCE.walk(source, 3)[1] + noise) - transfer(SOURCE.walk(source, 3)[1])
    gain = np.sqrt((change**2).sum(axis=1).mean()) / np.sqrt((noise**2).sum(axis=1).mean())
    assert gain * diagonal(source) / diagonal(target) < 1.1


def test_blend_shapes_may_be_transferred_one_by_one(animals: Animals) -> None:
    source = animals[0]
    transfer = Transfer(*animals)
    shapes = np.stack(
        [SOURCE.posed(source, (0.3, 0.0, 0.0, 0.0), 0.0), SOURCE.posed(source, (0,) * 4, 0.3)]
    )
    offsets = transfer_blend_shapes(transfer, shapes - source)
    assert offsets.shape == (2, len(animals[2]), 3)
    weights = np.array([0.7, 0.5])
    blended = transfer(source + np.tensordot(weights, shapes - source, 1))
    assert errors(animals[2] + np.tensordot(weights, offsets, 1), blended) < 0.005
    assert np.abs(offsets).max() > 0.05
    with pytest.raises(ValueError, match="offsets should have shape"):
        transfer_blend_shapes(transfer, shapes[0])


def test_the_real_animals_meet_their_bars(shared_data: Path) -> None:
    folder = shared_data / "transfer"

    def obj(path: Path) -> Mesh:
        lines = path.read_text().splitlines()
        points = [line.split()[1:4] for line in lines if line.startswith("v ")]
        corners = [line.split()[1:4] for line in lines if line.startswith("f ")]
        faces = [[int(corner.split("/")[0]) - 1 for corner in row] for row in corners]
        return np.array(points, dtype=float), np.array(faces, dtype=np.int32)

    source, target = obj(folder / "horse/horse_ref.obj"), obj(folder / "camel/camel_ref.obj")
    rows = read_markers(
        folder / "horse_camel.cons", source_count=len(source[0]), target_count=len(target[0])
    )
    assert check_markers(*source, *target, rows).suspects == ()
    pairs = match_triangles(register(*source, *target, rows), source[1], *target)
    poses = np.stack([obj(folder / f"horse/horse-{k:02d}.obj")[0] for k in (1, 4, 7)])
    transfer = Transfer(*source, *target, pairs)
    found = transfer(poses)
    report = examine(transfer, poses, found)
    assert report.coverage.unmatched_part < 0.005
    assert report.flipped < 0.01
    assert report.residual_median < 0.08 and report.residual_p95 < 0.45
    assert report.warnings == ()
    back = Transfer(*target, *source, pairs[:, ::-1])(found)
    off = np.linalg.norm(back - poses, axis=2) / diagonal(source[0])
    assert np.sqrt((off**2).mean(axis=1)).max() < 0.016
    assert off.max() < 0.06
    ratio = volume(found, target[1]) / volume(target[0], target[1])
    ratio /= volume(poses, source[1]) / volume(source[0], source[1])
    assert 0.88 < ratio.min() and ratio.max() < 1.05
