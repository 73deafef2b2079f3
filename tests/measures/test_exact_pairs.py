"""The counts of the measures are those of CGAL asked about every pair."""

from __future__ import annotations

import numpy as np
import pytest

from tests.cgal_reference import cgal_pairs
from tests.measures.exact_pairs import intersecting_pairs
from tests.meshes import crossing_tubes, overlapping_spheres

pytest.importorskip("CGAL.CGAL_Kernel")


def of(points: np.ndarray, faces: np.ndarray) -> list[list[int]]:
    own = np.arange(len(points))
    found: list[list[int]] = intersecting_pairs(points, faces.astype(np.int64), own).tolist()
    return found


@pytest.mark.parametrize("mesh", [crossing_tubes(8, 8), overlapping_spheres(1)])
def test_pairs_are_those_of_every_pair_tried(mesh: tuple[np.ndarray, np.ndarray]) -> None:
    found = of(*mesh)
    assert found and found == cgal_pairs(*mesh).tolist()


def test_a_common_point_counts_and_a_common_vertex_does_not() -> None:
    points = np.array(
        [[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [0.5, 0.5, 0], [1, 1, 2], [0, 1, 2], [0, 0, 0]]
    )
    touching = np.array([[0, 1, 2], [3, 4, 5]])
    assert of(points, touching) == [[0, 1]]
    lifted = points + np.array([[0.0, 0, 0]] * 3 + [[0, 0, 1e-6]] * 4)
    assert of(lifted, touching) == []
    # Vertex 6 is at the place of vertex 0: one vertex, unless they belong to different objects.
    beside = np.array([[0, 1, 2], [6, 4, 5]])
    assert of(points, beside) == []
    owner = np.array([0, 0, 0, 1, 1, 1, 1])
    assert len(intersecting_pairs(points, beside, np.arange(7), owner)) == 1


def test_vertices_that_are_one_in_the_rest_are_one_in_every_pose() -> None:
    points = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [0.5, 0.5, -1], [0.5, 0.5, 1], [3, 3, 1]])
    faces = np.array([[0, 1, 2], [3, 4, 5]])
    assert len(intersecting_pairs(points, faces, np.arange(6))) == 1
    assert len(intersecting_pairs(points, faces, np.array([0, 1, 2, 0, 4, 5]))) == 0


def test_a_triangle_of_no_area_is_a_segment() -> None:
    points = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [0.5, 0.5, -1], [0.5, 0.5, 1]])
    points = np.concatenate([points, [[0.5, 0.5, 0.0]]])
    assert of(points, np.array([[0, 1, 2], [3, 4, 5]])) == [[0, 1]]
    points[3:, 2] += 1.5
    assert of(points, np.array([[0, 1, 2], [3, 4, 5]])) == []
