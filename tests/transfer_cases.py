"""Helpers of the transfer tests: a smooth deformation and a distance between meshes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dtrepair.numerics.geometry import diagonal

TURN = Rotation.from_rotvec([0.7, -1.1, 0.4]).as_matrix()


def bent(points: NDArray[np.float64], amount: float = 0.8) -> NDArray[np.float64]:
    """A smooth deformation that is no similarity: bending and swelling."""
    angle = amount * (points[:, 0] - points[:, 0].mean())
    wide = 1.0 + 0.3 * np.sin(2.0 * points[:, 1])
    x = points[:, 0] + 0.2 * points[:, 1] ** 2
    y = wide * (np.cos(angle) * points[:, 1] - np.sin(angle) * points[:, 2])
    z = wide * (np.sin(angle) * points[:, 1] + np.cos(angle) * points[:, 2])
    return np.stack([x, y, z], axis=1)


def errors(found: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Largest deviation relative to the diagonal of the expected points."""
    result: float = np.abs(found - expected).max() / diagonal(expected.reshape(-1, 3))
    return result
