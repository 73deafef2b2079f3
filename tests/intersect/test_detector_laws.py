"""Laws of detection: what the numbering, the place and the side of a mesh may not change."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from dtrepair.intersect.detector import find_intersections
from dtrepair.numerics.geometry import FloatArray, IntArray
from tests.meshes import Mesh, crossing_tubes

Pairs = set[tuple[int, int]]

# Largest move, in units of the quarters below: with it the sums still fit the 24 bits of float32.
FAR = 2**20


def soup(seed: int, vertices: int, triangles: int) -> Mesh:
    """Random triangles on few points of a coarse grid: touching, coplanar, flat and doubled ones.

    Coordinates are quarters, exact in float32 also after moves by whole numbers up to `FAR`.
    """
    random = np.random.default_rng(seed)
    points = random.integers(-6, 7, (vertices, 3)) / 4.0
    faces = np.array([random.choice(vertices, 3, replace=False) for _ in range(triangles)])
    return points, faces.astype(np.int32)


def tubes(seed: int) -> Mesh:
    """Two crossing tubes of float32 coordinates in general position."""
    points, faces = crossing_tubes(8, 10, offset=0.01 * (seed % 20))
    noise = np.random.default_rng(seed).normal(size=points.shape)
    return (points + 0.01 * noise).astype(np.float32).astype(np.float64), faces


SOUPS = st.builds(soup, st.integers(0, 2**32 - 1), st.integers(6, 24), st.integers(2, 40))
TUBES = st.builds(tubes, st.integers(0, 2**32 - 1))


def found(points: FloatArray, faces: IntArray) -> Pairs:
    return {(int(first), int(second)) for first, second in find_intersections(points, faces)}


def renamed(pairs: Pairs, place: NDArray[np.int64]) -> Pairs:
    """The pairs after triangle t has become triangle place[t]."""
    ends = ((int(place[first]), int(place[second])) for first, second in pairs)
    return {(min(pair), max(pair)) for pair in ends}


@given(SOUPS | TUBES, st.integers(0, 2**32 - 1))
def test_the_order_of_triangles_and_of_their_corners_does_not_matter(mesh: Mesh, seed: int) -> None:
    points, faces = mesh
    random = np.random.default_rng(seed)
    order = random.permutation(len(faces))
    corners = np.array([random.permutation(3) for _ in faces])
    shuffled = np.take_along_axis(faces[order], corners, axis=1)
    assert found(points, shuffled) == renamed(found(points, faces), np.argsort(order))


@given(SOUPS | TUBES, st.integers(0, 2**32 - 1))
def test_the_numbers_of_vertices_do_not_matter(mesh: Mesh, seed: int) -> None:
    points, faces = mesh
    order = np.random.default_rng(seed).permutation(len(points))
    renumbered = np.argsort(order)[faces].astype(np.int32)
    assert found(points[order], renumbered) == found(points, faces)


@given(SOUPS, st.tuples(*[st.integers(-FAR, FAR)] * 3))
def test_a_move_that_rounds_nothing_changes_nothing(mesh: Mesh, move: tuple[int, int, int]) -> None:
    points, faces = mesh
    moved = points + np.array(move, dtype=np.float64)
    assert np.array_equal(moved.astype(np.float32), moved), "the move should be exact"
    assert found(moved, faces) == found(points, faces)


@given(
    SOUPS | TUBES,
    st.permutations([0, 1, 2]),
    st.tuples(*[st.sampled_from([-1.0, 1.0])] * 3),
    st.integers(-40, 40),
)
def test_axes_may_be_mirrored_swapped_and_scaled_by_powers_of_two(
    mesh: Mesh, axes: list[int], signs: tuple[float, float, float], power: int
) -> None:
    points, faces = mesh
    changed = 2.0**power * points[:, axes] * signs
    assert found(changed, faces) == found(points, faces)


@given(SOUPS | TUBES, st.data())
def test_more_triangles_keep_the_pairs_that_there_are(mesh: Mesh, data: st.DataObject) -> None:
    points, faces = mesh
    count = data.draw(st.integers(1, len(faces)))
    pairs = found(points, faces)
    kept = {(first, second) for first, second in pairs if second < count}
    assert found(points, faces[:count]) == kept


def test_the_laws_are_tried_where_there_is_something_to_find() -> None:
    counts = [len(found(*mesh)) for seed in range(20) for mesh in (soup(seed, 12, 20), tubes(seed))]
    assert np.count_nonzero(counts) > 30
