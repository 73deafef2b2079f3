"""Registration of one rest onto another by markers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from dtrepair.numerics.closest_point import closest_on_triangles
from dtrepair.numerics.geometry import FloatArray, IntArray, diagonal
from dtrepair.numerics.operators import Factor
from dtrepair.transfer import RegistrationOptions, register
from tests.meshes import Mesh, icosphere, joined
from tests.quadruped import SOURCE, TARGET, markers

Animals = tuple[Mesh, Mesh, NDArray[np.int32]]

SIX = np.array([[0, 0], [20, 20], [45, 45], [70, 70], [100, 100], [130, 130]])


@pytest.fixture(scope="module")
def animals() -> Animals:
    source, target = SOURCE.mesh(), TARGET.mesh()
    return source, target, markers(SOURCE, source[0], TARGET, target[0])


def distances_to_surface(
    queries: NDArray[np.float64], points: NDArray[np.float64], faces: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Distance of each query to the surface, relative to its diagonal."""
    near = cKDTree(points[faces].mean(axis=1)).query(queries, 12)[1]
    found = [closest_on_triangles(queries, points[faces[column]]) for column in near.T]
    result: NDArray[np.float64] = np.linalg.norm(np.array(found) - queries, axis=2).min(
        axis=0
    ) / diagonal(points)
    return result


def test_a_moved_scaled_and_turned_copy_is_met_exactly() -> None:
    points, faces = icosphere(2)
    points = points * (1.0, 1.4, 0.8)
    target = 3.7 * Rotation.from_rotvec([0.4, 2.0, -0.6]).apply(points) + (40.0, -7.0, 3.0)
    found = register(points, faces, target, faces, SIX)
    assert np.abs(found - target).max() < 1e-9 * diagonal(target)


def test_an_animal_lands_on_another_with_its_markers_exact(animals: Animals) -> None:
    source, target, rows = animals
    found = register(*source, *target, rows)
    size = diagonal(target[0])
    assert np.abs(found[rows[:, 0]] - target[0][rows[:, 1]]).max() < 1e-12 * size
    distances = distances_to_surface(found, *target)
    assert np.median(distances) < 5e-4
    assert np.percentile(distances, 99) < 5e-3


def test_the_result_does_not_depend_on_units_and_places(animals: Animals) -> None:
    source, target, rows = animals
    options = RegistrationOptions(closest=(0.0, 10.0))
    plain = register(*source, *target, rows, options=options)
    turn = Rotation.from_rotvec([1.0, 0.3, 0.2])
    moved = register(
        0.01 * turn.apply(source[0]) + 5.0,
        source[1],
        100.0 * target[0],
        target[1],
        rows,
        options=options,
    )
    assert np.abs(moved / 100.0 - plain).max() < 1e-8 * diagonal(target[0])


def test_more_closest_points_bring_the_surfaces_together(animals: Animals) -> None:
    source, target, rows = animals
    smooth = register(*source, *target, rows, options=RegistrationOptions(closest=(0.0,)))
    full = register(*source, *target, rows)
    far, near = (distances_to_surface(points, *target).mean() for points in (smooth, full))
    assert near < 0.25 * far


def test_one_factor_for_each_closest_weight() -> None:
    points, faces = icosphere(2)
    before = Factor.count
    options = RegistrationOptions(closest=(0.0, 1.0, 5.0))
    register(points, faces, 2.0 * points, faces, SIX, options=options)
    assert Factor.count - before == 3


def test_pieces_without_markers_unused_vertices_and_slivers_come_along() -> None:
    body, piece = icosphere(2), icosphere(1)
    points, faces = joined(body, (0.2 * piece[0] + (0.0, 0.0, 1.4), piece[1]))
    middle = 0.5 * (points[faces[0, 0]] + points[faces[0, 1]])
    points = np.concatenate([points, middle[None], [[0.0, 0.0, -1.5]]])
    sliver = [[faces[0, 0], faces[0, 1], len(points) - 2]]
    faces = np.concatenate([faces, sliver]).astype(np.int32)
    target = 2.0 * points + 1.0
    found = register(points, faces, target, faces, SIX)
    assert np.abs(found - target).max() < 1e-8 * diagonal(target)


def test_a_vertex_of_slivers_alone_follows_its_neighbours() -> None:
    points, faces = icosphere(2)
    first, second = points[faces[0, 0]], points[faces[0, 1]]
    source = np.concatenate([points, [0.8 * first + 0.2 * second]])
    sliver = [[faces[0, 0], faces[0, 1], len(points)]]
    turn = Rotation.from_rotvec([0.5, -0.2, 1.1])
    target = turn.apply(points * (1.0, 2.0, 0.7))
    found = register(source, np.concatenate([faces, sliver]), target, faces, SIX)
    wanted = 0.8 * found[faces[0, 0]] + 0.2 * found[faces[0, 1]]
    edge = np.linalg.norm(found[faces[0, 0]] - found[faces[0, 1]])
    assert np.linalg.norm(found[-1] - wanted) < 1e-3 * edge


def test_slivers_of_the_target_attract_nothing() -> None:
    points, faces = icosphere(2)
    target, all_faces = sliver_fan(2.0 * points, faces)
    found = register(points, faces, target, all_faces, SIX)
    np.testing.assert_array_equal(found, register(points, faces, target, faces, SIX))
    flat = np.zeros((3, 3), dtype=np.int64) + faces[0, 0]
    with pytest.raises(ValueError, match="triangles with an area"):
        register(points, faces, target, flat, SIX)


def sliver_fan(points: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """The mesh with a sliver of a vertex of its own on the first edge of each triangle."""
    middles = 0.5 * (points[faces[:, 0]] + points[faces[:, 1]])
    new = np.arange(len(faces)) + len(points)
    slivers = np.column_stack([faces[:, :2], new])
    return np.concatenate([points, middles]), np.concatenate([faces, slivers]).astype(np.int32)


def test_torch_and_float32_come_back_as_they_came() -> None:
    points, faces = icosphere(2)
    single = register(points.astype(np.float32), faces, 2.0 * points, faces, SIX)
    assert single.dtype == np.float32
    source, target = torch.from_numpy(points), torch.from_numpy(2.0 * points)
    triangles = torch.from_numpy(faces)
    found = register(source, triangles, target, triangles, torch.from_numpy(SIX))
    assert isinstance(found, torch.Tensor)
    np.testing.assert_allclose(found.numpy(), 2.0 * points, atol=1e-8)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"markers": SIX[:2]}, "at least 3 markers, got 2"),
        ({"markers": SIX[[0, 1, 2, 1]]}, "one marker"),
        ({"markers": SIX + 100}, "source vertices 0..161"),
        ({"source": np.full((162, 3), np.nan)}, "finite"),
    ],
)
def test_wrong_arguments_are_refused(change: dict[str, Any], message: str) -> None:
    points, faces = icosphere(2)
    arguments = {
        "source": points,
        "source_faces": faces,
        "target": points,
        "target_faces": faces,
        "markers": SIX,
    }
    with pytest.raises(ValueError, match=message):
        register(**{**arguments, **change})


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"closest": ()}, "closest should be weights"),
        ({"closest": (1.0, -2.0)}, "closest should be weights"),
        ({"neighbors": 0}, "neighbors should be at least 1"),
    ],
)
def test_wrong_weights_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RegistrationOptions(**wrong)
