"""How the rests of two meshes compare before a transfer: axes, winding, size."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dtrepair.numerics.geometry import FloatArray, as_mesh, extent
from dtrepair.transfer.arrays import Array, to_numpy
from dtrepair.transfer.matching.alignment import Similarity, rotation_between, similarity


def rotation_of(matrix: ArrayLike) -> FloatArray:
    """Return the rotation (3, 3), for column vectors, closest to a linear map of row vectors.

    Scale, shear and reflection are taken out (orthogonal Procrustes).
    """
    left, _, right = np.linalg.svd(np.asarray(matrix, dtype=np.float64).T)
    flip = np.sign(np.linalg.det(left @ right))
    return np.asarray((left * (1.0, 1.0, flip)) @ right)


def local_rotation(
    source_up: ArrayLike, target_up: ArrayLike, source_matrix: ArrayLike, target_matrix: ArrayLike
) -> FloatArray:
    """Return the rotation (3, 3) from the source's local axes to the target's local axes.

    Up axes (3,) in the world of each; matrices (4, 4) from local space to that world, row vectors.
    """
    first = rotation_of(np.asarray(source_matrix)[:3, :3])
    second = rotation_of(np.asarray(target_matrix)[:3, :3])
    return np.asarray(second.T @ rotation_between(source_up, target_up) @ first)


def rotation_between_rests(
    source: tuple[Array, Array], target: tuple[Array, Array], pairs: Array
) -> FloatArray:
    """Return the rotation (3, 3) that best turns the source's rest onto the target's, by pairs.

    Each mesh is points (V, 3) and faces (F, 3). Raises ValueError where the centroids of the
    paired triangles lie on a line.
    """
    return _similarity(source, target, pairs).rotation


def laid_over(source: tuple[Array, Array], target: tuple[Array, Array], pairs: Array) -> FloatArray:
    """Return the source's rest (V, 3) moved onto the target's by the best similarity of pairs."""
    return _similarity(source, target, pairs)(np.asarray(to_numpy(source[0]), dtype=np.float64))


def _similarity(
    source: tuple[Array, Array], target: tuple[Array, Array], pairs: Array
) -> Similarity:
    rows = to_numpy(pairs)
    centroids = []
    for column, mesh in enumerate((source, target)):
        points, faces = as_mesh(to_numpy(mesh[0]), to_numpy(mesh[1]))
        centroids.append(points[faces[rows[:, column]]].mean(axis=1))
    return similarity(*centroids)


def inside_out(points: Array, faces: Array, *, least_volume: float = 1e-3) -> bool:
    """Return whether a mesh (V, 3), (F, 3) is wound with its normals inward: a negative volume.

    least_volume: what it needs at least, cubes of the size: an open sheet has hardly any volume of
    either sign.
    """
    positions, triangles = as_mesh(to_numpy(points), to_numpy(faces))
    size = extent(positions)
    if not size > 0:
        return False
    corners = ((positions - positions.mean(axis=0)) / size)[triangles]
    return bool(np.linalg.det(corners).sum() / 6.0 < -least_volume)
