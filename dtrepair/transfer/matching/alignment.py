"""How two rests lie to each other: similarity, rotation between axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dtrepair.numerics.geometry import FloatArray, as_points
from dtrepair.transfer.arrays import to_numpy


@dataclass(frozen=True)
class Similarity:
    """x -> scale * rotation @ x + translation; scale is target units per source unit."""

    scale: float
    rotation: FloatArray  # (3, 3)
    translation: FloatArray  # (3,)

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return points (V, 3) moved."""
        return self.scale * points @ self.rotation.T + self.translation

    @property
    def angle(self) -> float:
        """The angle of the rotation in degrees, 0 to 180."""
        return float(np.degrees(np.arccos(np.clip((np.trace(self.rotation) - 1) / 2, -1, 1))))


def similarity(source: ArrayLike, target: ArrayLike) -> Similarity:
    """Return the similarity that takes points (K, 3) to points (K, 3) best (Umeyama 1991).

    Raises ValueError for fewer than three points, and for points on a line.
    """
    before, after = as_points(to_numpy(source)), as_points(to_numpy(target))
    if len(before) != len(after):
        raise ValueError(f"an alignment needs pairs of points, got {len(before)} and {len(after)}")
    if len(before) < 3:
        raise ValueError(f"an alignment needs at least 3 markers, got {len(before)}: add markers")
    centres = before.mean(axis=0), after.mean(axis=0)
    first, second = before - centres[0], after - centres[1]
    for name, points in (("source", first), ("target", second)):
        spread = np.linalg.svd(points, compute_uv=False)
        if not spread[1] > 1e-6 * spread[0]:
            raise ValueError(
                f"the {name} markers lie on a line, which leaves the rotation open: "
                "add markers away from it"
            )
    left, sizes, right = np.linalg.svd(second.T @ first)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = (left * signs) @ right
    scale = float((sizes * signs).sum() / (first**2).sum())
    return Similarity(scale, rotation, centres[1] - scale * rotation @ centres[0])


def rotation_between(source_up: ArrayLike, target_up: ArrayLike) -> FloatArray:
    """Return the smallest rotation (3, 3) that takes one axis to another.

    For stages of another up axis.

    Axes need not have unit length. For opposite axes, half a turn about an axis across them.
    Raises ValueError for an axis of length zero.
    """
    first, second = unit_vector(source_up, "source_up"), unit_vector(target_up, "target_up")
    if first @ second < -1.0 + 1e-12:
        across = np.cross(first, np.eye(3)[np.abs(first).argmin()])
        across /= np.linalg.norm(across)
        return 2.0 * np.outer(across, across) - np.eye(3)
    # Two reflections: first to the middle of both axes, then to the second.
    middle = first + second
    return (
        np.eye(3)
        - np.outer(middle, middle) / (1.0 + first @ second)
        + 2.0 * np.outer(second, first)
    )


def unit_vector(vector: ArrayLike, name: str) -> FloatArray:
    """Return the vector (3,) at length one. Raises ValueError with its `name` for zero."""
    values = np.asarray(to_numpy(vector), dtype=np.float64)
    if values.shape != (3,) or not np.linalg.norm(values) > 0:
        raise ValueError(f"{name} should be a vector (3,) other than zero, got {values}")
    return values / np.linalg.norm(values)


def checked_rotation(rotation: ArrayLike | None) -> FloatArray:
    """Return the rotation (3, 3), orthogonal to float64; None gives the identity.

    Raises ValueError for a matrix that is no rotation.
    """
    if rotation is None:
        return np.eye(3)
    matrix = np.asarray(to_numpy(rotation), dtype=np.float64)
    if matrix.shape != (3, 3):
        raise ValueError(f"rotation should have shape (3, 3), got {matrix.shape}")
    if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-6) or np.linalg.det(matrix) < 0:
        raise ValueError(
            f"rotation should be orthogonal with determinant 1, got {matrix.tolist()}: "
            "take scale and reflection out of it"
        )
    left, _, right = np.linalg.svd(matrix)  # a float32 rotation is not quite orthogonal
    orthogonal: FloatArray = left @ right
    return orthogonal
