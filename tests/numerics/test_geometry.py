"""Areas, normals, edges, adjacency, components and weld maps against values known by hand."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from dtrepair.numerics import geometry
from tests import meshes

RIGHT_TRIANGLE = (np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0.0]]), np.array([[0, 1, 2]]))
EMPTY = (np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32))


def test_as_mesh_converts_and_keeps_values() -> None:
    points, faces = geometry.as_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    assert points.dtype == np.float64 and faces.dtype == np.int32
    assert points[1].tolist() == [1, 0, 0] and faces.tolist() == [[0, 1, 2]]


def test_as_mesh_accepts_a_mesh_without_faces() -> None:
    points, faces = geometry.as_mesh(np.zeros((0, 3)), np.zeros((0, 3)))
    assert points.shape == (0, 3) and faces.shape == (0, 3) and faces.dtype == np.int32


@pytest.mark.parametrize(
    ("points", "faces", "message"),
    [
        (np.zeros((3, 2)), [[0, 1, 2]], r"points should have shape \(V, 3\), got \(3, 2\)"),
        (np.zeros(9), [[0, 1, 2]], r"points should have shape \(V, 3\), got \(9,\)"),
        (np.zeros((4, 3)), [[0, 1, 2, 3]], r"faces should have shape \(F, 3\), got \(1, 4\)"),
        ([[0, 0, 0]], [], r"shape \(F, 3\), got \(0,\): np.zeros\(\(0, 3\), int\) is none"),
        (np.zeros((3, 3)), [[0, 1, 9]], "index 9"),
        (np.zeros((3, 3)), [[0, 1, -1]], "index -1"),
        (np.zeros((3, 3)), [[0.0, 1.0, 2.0]], "faces should be integers, got float64"),
        ([[0, 0, 0], [np.nan, 0, 0], [0, 1, 0]], [[0, 1, 2]], "finite.*at vertex 1"),
        ([[0, 0, 0], [1, 0, 0], [0, np.inf, 0]], [[0, 1, 2]], "finite.*at vertex 2"),
    ],
)
def test_as_mesh_names_what_is_wrong(points: ArrayLike, faces: ArrayLike, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        geometry.as_mesh(points, faces)


def test_as_points_checks_the_count() -> None:
    with pytest.raises(ValueError, match="5 rows as the rest mesh has, got 3"):
        geometry.as_points(np.zeros((3, 3)), 5)


def test_right_triangle_has_half_base_times_height() -> None:
    points, faces = RIGHT_TRIANGLE
    assert geometry.triangle_areas(points, faces).tolist() == [3.0]
    assert geometry.triangle_normals(points, faces).tolist() == [[0, 0, 1]]
    assert geometry.vector_areas(points, faces).tolist() == [[0, 0, 3]]
    assert geometry.vertex_areas(points, faces).tolist() == [1, 1, 1]


def test_zero_area_has_zero_normal() -> None:
    points = np.array([[0, 0, 0], [1, 1, 1], [2, 2, 2.0]])
    assert geometry.triangle_normals(points, np.array([[0, 1, 2]])).tolist() == [[0, 0, 0]]


def test_closed_surface_has_no_net_area_and_outward_normals() -> None:
    points, faces = meshes.icosphere(2)
    assert np.allclose(geometry.vector_areas(points, faces).sum(axis=0), 0, atol=1e-12)
    centroids = points[faces].mean(axis=1)
    outward = np.einsum("ij,ij->i", geometry.triangle_normals(points, faces), centroids)
    assert (outward > 0.9).all()


def test_area_of_the_sphere_converges_quadratically() -> None:
    errors = [
        4 * np.pi - geometry.triangle_areas(*meshes.icosphere(level)).sum() for level in (1, 2, 3)
    ]
    # Halving the edges quarters the error of an inscribed surface.
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.03)


def test_edges_of_two_triangles() -> None:
    faces = np.array([[2, 1, 0], [1, 2, 3]], dtype=np.int32)
    edges = geometry.unique_edges(faces)
    assert edges.tolist() == [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]]
    assert edges.dtype == np.int32


def test_edges_leave_repeated_vertices_out() -> None:
    assert geometry.unique_edges(np.array([[0, 0, 1]], dtype=np.int32)).tolist() == [[0, 1]]
    assert geometry.unique_edges(EMPTY[1]).shape == (0, 2)


@pytest.mark.parametrize(
    ("mesh", "characteristic"), [(meshes.icosphere(1), 2), (meshes.torus(), 0), (meshes.tube(), 0)]
)
def test_euler_characteristic(mesh: meshes.Mesh, characteristic: int) -> None:
    points, faces = mesh
    assert len(points) - len(geometry.unique_edges(faces)) + len(faces) == characteristic


def test_adjacency_holds_each_edge_twice_sorted() -> None:
    faces = np.array([[2, 1, 0], [1, 2, 3]], dtype=np.int32)
    starts, neighbours = geometry.adjacency(faces, 5)
    rows = [neighbours[a:b].tolist() for a, b in pairwise(starts)]
    assert rows == [[1, 2], [0, 2, 3], [0, 1, 3], [1, 2], []]
    assert starts.dtype == np.int32 and neighbours.dtype == np.int32


def test_components_of_two_spheres_and_a_lone_vertex() -> None:
    points, faces = meshes.joined(meshes.icosphere(0), meshes.icosphere(1))
    labels = geometry.components(faces, len(points) + 1)
    assert len(set(labels)) == 3
    assert len(set(labels[:12])) == 1 and len(set(labels[12:-1])) == 1
    assert labels.dtype == np.int32


def test_weld_map_takes_the_smallest_index() -> None:
    points = np.array([[1, 0, 0], [0, 0, 0], [1, 0, 0], [-0.0, 0, -0.0], [1, 1e-12, 0]])
    assert geometry.weld_map(points).tolist() == [0, 1, 0, 1, 4]


def test_meshes_in_a_row_weld_each_by_itself() -> None:
    generator = np.random.default_rng(5)
    meshes = [generator.integers(0, 2, (n, 3)).astype(float) for n in (9, 0, 1, 30)]
    starts = np.cumsum([0, 9, 0, 1])
    expected = [geometry.weld_map(own) + start for own, start in zip(meshes, starts, strict=True)]
    assert geometry.weld_maps(meshes).tolist() == np.concatenate(expected).tolist()


@pytest.mark.parametrize("repeat", [0, 1])
def test_positions_are_sorted_only_where_any_may_be_one(
    repeat: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = np.stack(np.meshgrid(*[np.arange(20.0)] * 3), axis=-1).reshape(-1, 3)
    points = np.concatenate([grid, grid[:repeat]])
    sort = np.lexsort
    sorts: list[int] = []

    def counted(keys: Any) -> Any:
        sorts.append(len(keys))
        return sort(keys)

    monkeypatch.setattr(np, "lexsort", counted)
    weld = geometry.weld_maps([points, grid])
    assert len(sorts) == repeat
    assert (weld != np.arange(len(weld))).sum() == repeat


def test_weld_map_compares_float32_positions() -> None:
    # A float64 step below half a float32 ulp of 1 rounds away; a float32 ulp does not.
    points = np.array([[1, 0, 0], [1 + 1e-9, 0, 0], [1 + 2.0**-23, 0, 0]])
    assert geometry.weld_map(points).tolist() == [0, 0, 2]


def test_weld_map_of_random_repeats_agrees_with_a_dictionary() -> None:
    points = np.random.default_rng(0).integers(-3, 4, (500, 3)).astype(float)
    first: dict[tuple[float, ...], int] = {}
    expected = [first.setdefault(tuple(row), index) for index, row in enumerate(points.tolist())]
    assert geometry.weld_map(points).tolist() == expected
    assert geometry.weld_map(EMPTY[0]).shape == (0,)


def test_extent_and_diagonal() -> None:
    points = np.array([[0, 0, 0], [3, 4, 12.0]])
    assert geometry.extent(points) == 12
    assert geometry.diagonal(points) == 13
    assert geometry.extent(EMPTY[0]) == 0 and geometry.diagonal(EMPTY[0]) == 0


def test_functions_take_a_mesh_without_faces() -> None:
    points, faces = EMPTY
    assert geometry.triangle_areas(points, faces).shape == (0,)
    assert geometry.vertex_areas(points, faces).shape == (0,)
    starts, neighbours = geometry.adjacency(faces, 0)
    assert starts.tolist() == [0] and neighbours.shape == (0,)
    assert geometry.components(faces, 2).tolist() == [0, 1]


def test_shared_edges_join_all_triangles_around_an_edge() -> None:
    fan = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [5, 6, 7]], dtype=np.int32)
    found = {tuple(sorted(pair)) for pair in geometry.shared_edges(fan).tolist()}
    assert found == {(0, 1), (0, 2), (1, 2)}
    assert len(geometry.shared_edges(fan[3:])) == 0
    closed = meshes.icosphere(1)[1]
    assert len(geometry.shared_edges(closed)) == 3 * len(closed) // 2


@pytest.mark.parametrize("known", [0, 1, 40, 400])
def test_keys_are_among_known_ones_as_numpy_says(known: int) -> None:
    random = np.random.default_rng(known)
    keys = random.integers(-50, 50, 200) << 40
    some = random.integers(-50, 50, known) << 40
    assert geometry.among(keys, some).tolist() == np.isin(keys, some).tolist()
    assert geometry.among(keys[:0], some).shape == (0,)
