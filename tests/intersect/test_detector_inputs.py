"""What the detector takes, and what it refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from dtrepair.intersect.detector import Detector, find_intersections
from tests.crossing_meshes import MESHES, TWO_FACES


@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
def test_torch_and_numpy_agree(kind: torch.dtype) -> None:
    points, faces = MESHES["random soup"]
    tensor = torch.tensor(points, dtype=kind, requires_grad=True)
    detector = Detector(points, faces)
    assert np.array_equal(detector(tensor), detector(points))
    assert detector(tensor[None]).shape[1] == 3


def test_views_and_float32_and_lists_are_taken() -> None:
    points, faces = MESHES["random soup"]
    detector = Detector(points, faces)
    expected = detector(points)
    assert np.array_equal(detector(points.astype(np.float32)), expected)
    assert np.array_equal(detector(np.asfortranarray(points)), expected)
    assert np.array_equal(detector(points.tolist()), expected)
    assert np.array_equal(detector(np.repeat(points, 2, axis=0)[::2]), expected)


def test_a_mesh_without_faces_or_with_one_has_no_pairs() -> None:
    for faces in (np.zeros((0, 3), dtype=np.int32), TWO_FACES[:1]):
        detector = Detector(np.zeros((6, 3)), faces)
        assert detector(np.zeros((6, 3))).shape == (0, 2)
        assert detector(np.zeros((2, 6, 3))).shape == (0, 3)
    assert find_intersections(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0, 2)


def test_of_tensors_the_pairs_are_a_tensor() -> None:
    points, faces = MESHES["random soup"]
    pairs = find_intersections(points, faces)
    given = torch.tensor(points, requires_grad=True), torch.tensor(faces)
    found = find_intersections(*given)
    assert isinstance(found, torch.Tensor) and found.dtype == torch.int32
    assert len(pairs) > 0 and np.array_equal(found.numpy(), pairs)


@pytest.mark.parametrize("shape", [(5, 3), (6, 2), (6,), (2, 5, 3), (1, 2, 6, 3)])
def test_wrong_shapes_are_named(shape: tuple[int, ...]) -> None:
    detector = Detector(np.eye(6, 3), TWO_FACES)
    with pytest.raises(ValueError, match=r"should have shape \(6, 3\) or \(B, 6, 3\), got"):
        detector(np.zeros(shape))


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e39, -1e300])
def test_numbers_beyond_float32_are_named(value: float) -> None:
    points = np.eye(6, 3)
    detector = Detector(points, TWO_FACES)
    points[4, 1] = value
    with pytest.raises(ValueError, match="finite in float32"):
        detector(points)
    with pytest.raises(ValueError, match="finite"):
        find_intersections(points, TWO_FACES)


def test_wrong_rests_and_faces_are_named() -> None:
    with pytest.raises(ValueError, match="index 9"):
        Detector(np.eye(6, 3), [[0, 1, 9]])
    with pytest.raises(ValueError, match="finite"):
        Detector(np.full((6, 3), np.nan), TWO_FACES)


@pytest.mark.parametrize("weld", [np.arange(5), np.arange(6.0), np.zeros((6, 1), dtype=int)])
def test_wrong_weld_maps_are_named(weld: NDArray[Any]) -> None:
    with pytest.raises(ValueError, match=r"weld should be integers of shape \(6,\)"):
        Detector(np.eye(6, 3), TWO_FACES, weld=weld)
    with pytest.raises(ValueError, match=r"weld should be integers of shape \(6,\)"):
        Detector(np.eye(6, 3), TWO_FACES)(np.eye(6, 3), weld=weld)


def test_wrong_masks_are_named() -> None:
    with pytest.raises(ValueError, match=r"active should be booleans of shape \(2,\)"):
        Detector(np.eye(6, 3), TWO_FACES)(np.eye(6, 3), active=np.ones(3, dtype=bool))
