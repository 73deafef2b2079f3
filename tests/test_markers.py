"""Marker pairs and the similarity they define."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dtrepair.transfer.markers import checked_markers, similarity


def test_a_similarity_is_found_exactly():
    rng = np.random.default_rng(0)
    source = rng.normal(size=(7, 3))
    turn = Rotation.from_rotvec([0.3, -1.2, 0.7])
    target = 3.7 * turn.apply(source) + (5.0, -2.0, 11.0)
    found = similarity(source, target)
    assert found.scale == pytest.approx(3.7, rel=1e-13)
    np.testing.assert_allclose(found.rotation, turn.as_matrix(), atol=1e-13)
    np.testing.assert_allclose(found(source), target, atol=1e-12)
    assert found.angle == pytest.approx(np.degrees(turn.magnitude()), rel=1e-10)


def test_a_similarity_of_coplanar_points_is_a_rotation_never_a_reflection():
    source = np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 0], [2, 1, 0]])
    mirrored = source * (-1.0, 1.0, 1.0)
    assert np.linalg.det(similarity(source, mirrored).rotation) == pytest.approx(1.0)


def test_too_few_markers_and_markers_on_a_line_are_refused():
    points = np.random.default_rng(0).normal(size=(4, 3))
    with pytest.raises(ValueError, match="at least 3 markers, got 2"):
        similarity(points[:2], points[:2])
    line = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="source markers lie on a line"):
        similarity(line, points)
    with pytest.raises(ValueError, match="target markers lie on a line"):
        similarity(points, line)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([[0, 0, 0]], r"shape \(K, 2\)"),
        ([[0.5, 1.0]], "integers"),
        ([[0, 1], [9, 2]], "source vertices 0..8, got index 9 in marker 1"),
        ([[0, 1], [1, -4]], "target vertices 0..9, got index -4 in marker 1"),
        ([[4, 1], [3, 2], [4, 3]], "source vertex should have one marker.*vertex 4 .* 0 and 2"),
        ([[1, 7], [2, 7], [3, 1]], "target vertex should have one marker.*vertex 7 .* 0 and 1"),
    ],
)
def test_wrong_markers_are_refused(rows, message):
    with pytest.raises(ValueError, match=message):
        checked_markers(np.array(rows), 9, 10)
