"""A mouth that closes too far comes apart at its lips, and is not drawn out between them."""

from __future__ import annotations

import numpy as np

from dtrepair import Repairer
from dtrepair.numerics.geometry import FloatArray, lengths
from tests.meshes import Mesh, icosphere


def head() -> Mesh:
    """A ball with a mouth."""
    points, faces = icosphere(5)
    across = np.hypot(points[:, 0] / 0.5, points[:, 1] / 0.14)
    depth = 0.55 * np.exp(-(across**4)) * (points[:, 2] > 0.0)
    return points * (1.0 - depth)[:, None], faces


def with_jaw(points: FloatArray, angle: float) -> FloatArray:
    """The lower half of the face turned upwards about the ears."""
    x, y, z = points.T
    share = np.clip((0.02 - y) / 0.04, 0.0, 1.0) * np.clip((z + 0.2) / 0.5, 0.0, 1.0)
    turn = angle * share * np.clip((y + 1.2) / 0.8, 0.0, 1.0)
    up, forwards = y * np.cos(turn) + z * np.sin(turn), z * np.cos(turn) - y * np.sin(turn)
    return np.stack([x, up, forwards], axis=1)


def test_a_mouth_that_closes_too_far_is_not_turned_inside_out() -> None:
    points, faces = head()
    pose = with_jaw(points, 0.3)
    found = Repairer(points, faces)(pose)
    assert found.status == "clean" and found.before.pairs > 900
    assert lengths(found.points - pose).max() < 0.2
