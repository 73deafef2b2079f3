"""Excerpts: whole near a place, fewer triangles elsewhere, and no vertex that was made up."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.display.excerpt import ExcerptOptions, make_excerpt
from dtrepair.numerics.geometry import components, triangle_areas


def plane(count: int, height: float = 0.0) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """A square of count x count cells, side 1."""
    steps = np.linspace(0, 1, count + 1)
    x, y = np.meshgrid(steps, steps, indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.full(x.size, height)], axis=1)
    corner = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    a, b, c, d = corner, corner + count + 1, corner + count + 2, corner + 1
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return points, faces.astype(np.int32)


def test_a_small_mesh_stays_whole() -> None:
    points, faces = plane(4)
    found = make_excerpt(points, faces, np.array([0]))
    assert np.array_equal(found.vertices[found.faces], faces)
    assert np.array_equal(found.triangles, np.arange(len(faces)))


@pytest.mark.parametrize(("triangles", "covered"), [(400, 0.6), (1500, 0.85)])
def test_it_is_whole_near_the_place_and_small_enough(triangles: int, covered: float) -> None:
    points, faces = plane(60)
    place = np.flatnonzero(np.linalg.norm(points[faces].mean(axis=1)[:, :2] - 0.3, axis=1) < 0.03)
    found = make_excerpt(points, faces, place, options=ExcerptOptions(triangles=triangles))
    assert len(found.faces) <= triangles
    kept = found.vertices[found.faces]
    assert np.array_equal(np.unique(found.triangles), found.triangles)
    near = np.isin(found.triangles, place)
    assert near.sum() == len(place)
    assert np.array_equal(kept[near], faces[place])
    # What is thinned out is one piece, and covers the square but for half a cell at its border.
    flat = points[found.vertices]
    assert covered <= triangle_areas(flat, found.faces).sum() <= 1.0 + 1e-9
    assert components(found.faces, len(flat)).max() == 0


def test_sheets_that_lie_close_are_not_glued() -> None:
    low, faces = plane(40)
    high, _ = plane(40, height=1e-4)
    both = np.concatenate([faces, faces + len(low)])
    points = np.concatenate([low, high])
    found = make_excerpt(points, both, np.array([0]), options=ExcerptOptions(triangles=900))
    sheet = found.vertices[found.faces] >= len(low)
    assert np.array_equal(sheet.all(axis=1), sheet.any(axis=1)) and sheet.any()


def test_a_place_larger_than_the_excerpt_is_kept() -> None:
    points, faces = plane(20)
    place = np.arange(len(faces))
    found = make_excerpt(points, faces, place, options=ExcerptOptions(triangles=50))
    assert len(found.faces) == len(faces)
