"""Pinned vertices on the factor of the free transfer."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

from dtrepair.numerics.geometry import diagonal
from dtrepair.numerics.operators import Factor, cotangent_laplacian
from dtrepair.transfer import (
    Pins,
    RegistrationOptions,
    Transfer,
    identity_pairs,
    match_triangles,
    register,
)
from tests.meshes import icosphere, joined
from tests.quadruped import SOURCE, TARGET, markers

Animals = tuple[Transfer, NDArray[np.float64]]


@pytest.fixture(scope="module")
def animals() -> Animals:
    (source, source_faces), (target, target_faces) = SOURCE.mesh(), TARGET.mesh()
    rows = markers(SOURCE, source, TARGET, target)
    registered = register(
        source,
        source_faces,
        target,
        target_faces,
        rows,
        options=RegistrationOptions(closest=(0.0, 10.0, 1000.0)),
    )
    pairs = match_triangles(registered, source_faces, target, target_faces)
    transfer = Transfer(source, source_faces, target, target_faces, pairs)
    return transfer, SOURCE.walk(source, 4)


def test_pins_at_their_own_places_change_nothing(animals: Animals) -> None:
    transfer, poses = animals
    vertices = np.arange(0, len(transfer.target), 113)
    free = transfer(poses)
    held = Pins(transfer, vertices)(poses, free[:, vertices])
    assert np.abs(held - free).max() < 1e-10 * diagonal(transfer.target)


def test_the_schur_complement_equals_a_new_factorisation(animals: Animals) -> None:
    transfer, poses = animals
    vertices = np.array([7, 300, 1200, 2500, 4000, int(transfer.placement.anchors()[0])])
    rng = np.random.default_rng(1)
    free = transfer(poses[0])
    places = free[vertices] + 0.1 * rng.normal(size=(len(vertices), 3))
    held = Pins(transfer, vertices)(poses[0], places)
    # The normal equations of the free solution give its right-hand side: b = K x.
    matrix = cotangent_laplacian(transfer.target, transfer.target_faces).tocsr()
    others = np.setdiff1d(np.arange(len(free)), vertices)
    right = (matrix @ free)[others] - matrix[others][:, vertices] @ places
    expected = free.copy()
    expected[vertices] = places
    expected[others] = spsolve(sparse.csc_matrix(matrix[others][:, others]), right)
    assert np.abs(held - expected).max() < 1e-10 * diagonal(free)
    np.testing.assert_array_equal(held[vertices], places)
    assert np.abs(held - free).max() > 0.01 * diagonal(free)


def test_contacts_may_change_from_frame_to_frame_without_a_factorisation(animals: Animals) -> None:
    transfer, poses = animals
    vertices = np.array([10, 500, 3000])
    free = transfer(poses)
    places = free[:, vertices] + 0.05
    places[1, 0] = np.nan
    places[2] = np.nan
    before = Factor.count
    held = Pins(transfer, vertices)(poses, places)
    assert Factor.count == before
    fewer = Pins(transfer, vertices[1:])(poses[1], places[1, 1:])
    assert np.abs(held[1] - fewer).max() < 1e-10 * diagonal(transfer.target)
    np.testing.assert_array_equal(held[2], free[2])
    np.testing.assert_array_equal(held[0, vertices], places[0])


def test_only_the_pieces_with_pins_are_held() -> None:
    body, other = icosphere(2), icosphere(1)
    points, faces = joined(body, (0.3 * other[0] + (0.0, 2.0, 0.0), other[1]))
    transfer = Transfer(points, faces, points, faces, identity_pairs(faces), pieces="separate")
    pose = points + np.array([1.0, 0.0, 0.0])
    held = Pins(transfer, np.array([5]))(pose, points[[5]])
    assert np.abs(held[:162] - points[:162]).max() < 1e-12
    assert np.abs(held[162:] - pose[162:]).max() < 1e-12


def test_torch_comes_back_as_torch(animals: Animals) -> None:
    transfer, poses = animals
    places = torch.from_numpy(transfer(poses)[:, [3, 4]])
    held = Pins(transfer, torch.tensor([3, 4]))(torch.from_numpy(poses).float(), places)
    assert isinstance(held, torch.Tensor) and held.dtype == torch.float32


def test_wrong_pins_are_refused(animals: Animals) -> None:
    transfer, poses = animals
    count = len(transfer.target)
    with pytest.raises(ValueError, match=f"0..{count - 1}, got {count}"):
        Pins(transfer, np.array([0, count]))
    with pytest.raises(ValueError, match="twice"):
        Pins(transfer, np.array([4, 4]))
    with pytest.raises(ValueError, match="integers"):
        Pins(transfer, np.array([0.5]))
    pins = Pins(transfer, np.array([4, 5]))
    with pytest.raises(ValueError, match=r"shape \(4, 2, 3\), got \(4, 3, 3\)"):
        pins(poses, np.zeros((4, 3, 3)))
    with pytest.raises(ValueError, match="NaN for a pin that is free"):
        pins(poses, np.full((4, 2, 3), np.inf))
