"""The masks of excluded pairs against comparing every pair of triangles."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.intersect.tree import Neighbors, build_tree, leaf_neighbors
from tests import meshes


def in_leaf_order(
    points: NDArray[np.float64], faces: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    tree = build_tree(points[faces].mean(axis=1))
    return faces[tree.order], tree.leaf_start


def excluded_pairs(neighbors: Neighbors, leaf_start: NDArray[np.int32]) -> set[tuple[int, int]]:
    """All pairs i < j in leaf order whose bit is set."""
    pairs = set()
    for leaf in range(len(leaf_start) - 1):
        for entry in range(neighbors.start[leaf], neighbors.start[leaf + 1]):
            other = neighbors.leaf[entry]
            for bit in range(64):
                if int(neighbors.excluded[entry]) >> bit & 1:
                    i, j = leaf_start[leaf] + bit // 8, leaf_start[other] + bit % 8
                    if i < min(j, leaf_start[leaf + 1]) and j < leaf_start[other + 1]:
                        pairs.add((int(i), int(j)))
    return pairs


def sharing_pairs(faces: NDArray[np.int32]) -> set[tuple[int, int]]:
    shared = (faces[:, None, :, None] == faces[None, :, None, :]).any(axis=(2, 3))
    return {(int(i), int(j)) for i, j in np.argwhere(np.triu(shared, 1))}


@pytest.mark.parametrize(
    "mesh",
    [meshes.icosphere(2), meshes.torus(14, 9), meshes.crossing_tubes(8, 9), meshes.grid(1, 1)],
)
def test_excluded_pairs_are_those_that_share_a_vertex(mesh: meshes.Mesh) -> None:
    faces, leaf_start = in_leaf_order(*mesh)
    assert excluded_pairs(leaf_neighbors(faces, leaf_start), leaf_start) == sharing_pairs(faces)


def test_rows_ascend_from_the_leaf_itself_and_meet_each_pair_once() -> None:
    faces, leaf_start = in_leaf_order(*meshes.torus(14, 9))
    neighbors = leaf_neighbors(faces, leaf_start)
    for leaf in range(len(leaf_start) - 1):
        row = neighbors.leaf[neighbors.start[leaf] : neighbors.start[leaf + 1]]
        assert row[0] == leaf and (np.diff(row) > 0).all()
        own = int(neighbors.excluded[neighbors.start[leaf]])
        assert all(own >> 8 * i + j & 1 for i in range(8) for j in range(i + 1))


def test_a_vertex_of_very_many_triangles_stays_cheap() -> None:
    count = 8 * 16 * 32
    angles = 2 * np.pi * np.arange(count) / count
    points = np.vstack([[0, 0, 1], np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)])
    rim = np.arange(count)
    fan = np.stack([np.zeros(count, int), 1 + rim, 1 + (rim + 1) % count], axis=1).astype(np.int32)
    faces, leaf_start = in_leaf_order(points, fan)
    neighbors = leaf_neighbors(faces, leaf_start)
    leaves = len(leaf_start) - 1
    assert leaves < len(neighbors.leaf) <= leaves * (32 + 2)
