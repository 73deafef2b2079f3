"""How two rests lie to each other."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dtrepair.transfer import rotation_between, similarity


def test_a_similarity_is_found_exactly() -> None:
    rng = np.random.default_rng(0)
    source = rng.normal(size=(7, 3))
    turn = Rotation.from_rotvec([0.3, -1.2, 0.7])
    target = 3.7 * turn.apply(source) + (5.0, -2.0, 11.0)
    found = similarity(source, target)
    assert found.scale == pytest.approx(3.7, rel=1e-13)
    np.testing.assert_allclose(found.rotation, turn.as_matrix(), atol=1e-13)
    np.testing.assert_allclose(found(source), target, atol=1e-12)
    assert found.angle == pytest.approx(np.degrees(turn.magnitude()), rel=1e-10)


def test_a_similarity_of_coplanar_points_is_a_rotation_never_a_reflection() -> None:
    source = np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 0], [2, 1, 0]])
    mirrored = source * (-1.0, 1.0, 1.0)
    assert np.linalg.det(similarity(source, mirrored).rotation) == pytest.approx(1.0)


def test_too_few_markers_and_markers_on_a_line_are_refused() -> None:
    points = np.random.default_rng(0).normal(size=(4, 3))
    with pytest.raises(ValueError, match="at least 3 markers, got 2"):
        similarity(points[:2], points[:2])
    line = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="source markers lie on a line"):
        similarity(line, points)
    with pytest.raises(ValueError, match="target markers lie on a line"):
        similarity(points, line)


def test_points_that_are_no_pairs_are_refused() -> None:
    with pytest.raises(ValueError, match="pairs of points, got 4 and 5"):
        similarity(np.eye(4, 3), np.eye(5, 3))
    with pytest.raises(ValueError, match="shape"):
        similarity(np.eye(4), np.eye(4))


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ((0, 0, 1), (0, 1, 0)),
        ((0, 2, 0), (0, 3, 0)),
        ((1, 2, 3), (-3, 1, 0.5)),
        ((0, 0, 1), (0, 0, -2)),
    ],
)
def test_the_rotation_between_two_axes_is_the_smallest(
    first: tuple[float, float, float], second: tuple[float, float, float]
) -> None:
    found = rotation_between(first, second)
    units = [np.array(axis, dtype=float) / np.linalg.norm(axis) for axis in (first, second)]
    np.testing.assert_allclose(found @ units[0], units[1], atol=1e-14)
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(found) == pytest.approx(1.0)
    angle = Rotation.from_matrix(found).magnitude()
    assert angle == pytest.approx(np.arccos(np.clip(units[0] @ units[1], -1, 1)), abs=1e-7)


def test_from_z_up_to_y_up_sideways_stays() -> None:
    expected = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    np.testing.assert_allclose(rotation_between((0, 0, 1), (0, 1, 0)), expected, atol=1e-15)


def test_an_axis_of_no_length_is_refused() -> None:
    with pytest.raises(ValueError, match="target_up should be a vector"):
        rotation_between((0, 0, 1), (0, 0, 0))
