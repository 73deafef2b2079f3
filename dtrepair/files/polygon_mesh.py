"""The polygons of a mesh file: what every format's reader returns and every writer takes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


class MeshFileError(ValueError):
    """A mesh file that cannot be read, or a format that cannot be written."""

    exit_code = 3  # as the errors of usd_io about inputs


@dataclass(frozen=True)
class PolygonMesh:
    """One mesh as its file stores it: vertex order, polygons and texture coordinates untouched.

    points: (V, 3) float64. counts: (P,) int32 corners of each polygon. corners: (sum of counts,)
    int32 vertex of each corner. texture: (N, 2) float64 or None; texture_corners: (sum of counts,)
    int32 row of `texture` for each corner, -1 for none. original: what the format's own writer
    needs to keep everything else of the file (comments, materials, groups, colours).
    """

    format: str
    points: NDArray[np.float64]
    counts: NDArray[np.int32]
    corners: NDArray[np.int32]
    texture: NDArray[np.float64] | None = None
    texture_corners: NDArray[np.int32] | None = None
    original: Any = None

    def faces(self) -> NDArray[np.int32]:
        """Return (F, 3) int32 triangles: a fan from the first corner of each polygon, in order."""
        inner = np.maximum(self.counts - 2, 0)
        starts = np.cumsum(self.counts) - self.counts
        start = np.repeat(starts, inner)
        step = np.arange(len(start)) - np.repeat(np.cumsum(inner) - inner, inner)
        rows = np.stack([start, start + step + 1, start + step + 2], axis=1)
        return np.ascontiguousarray(self.corners[rows], dtype=np.int32).reshape(-1, 3)

    def has_vertex_texture(self) -> bool:
        """Return whether there is one texture coordinate for each vertex, in vertex order."""
        rows = self.texture_corners
        return self.texture is not None and rows is not None and np.array_equal(rows, self.corners)

    def changed(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return (V,) True where a vertex of `points` (V, 3) differs as float32 coordinates."""
        new = np.asarray(points)
        if new.shape != self.points.shape:
            raise ValueError(
                f"points: expected shape {self.points.shape} as in the file, got {new.shape}"
            )
        if not np.isfinite(new).all():
            raise ValueError("points: expected finite coordinates, got NaN or infinity")
        different: NDArray[np.bool_] = new.astype(np.float32) != self.points.astype(np.float32)
        return np.asarray(different.any(axis=1))


def polygon_mesh(
    format: str,
    points: ArrayLike,
    polygons: list[list[int]] | NDArray[Any],
    **more: Any,
) -> PolygonMesh:
    """Build a PolygonMesh from polygons given as lists (or an (F, n) array) of vertex indices.

    Raises MeshFileError for points that are not (V, 3), for indices out of range, and for those
    that are no whole numbers.
    """
    coordinates = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    counts = np.fromiter((len(p) for p in polygons), dtype=np.int32, count=len(polygons))
    given = polygons if isinstance(polygons, np.ndarray) else list(chain.from_iterable(polygons))
    flat = np.asarray(given).reshape(-1)
    if flat.dtype.kind == "f" and not (flat == np.floor(flat)).all():
        raise MeshFileError("expected whole numbers as face indices, got others")
    corners = flat.astype(np.int64)
    if len(corners) and (corners.min() < 0 or corners.max() >= len(coordinates)):
        wrong = corners[(corners < 0) | (corners >= len(coordinates))][0]
        raise MeshFileError(
            f"expected face indices below {len(coordinates)} (the vertex count), got {wrong}"
        )
    return PolygonMesh(format, coordinates, counts, corners.astype(np.int32), **more)


def vertex_normals(points: ArrayLike, faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return (V, 3) unit vertex normals, the mean of the incident triangles weighted by area."""
    corners = np.asarray(points, dtype=np.float64)
    a, b, c = (corners[faces[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    normals = np.zeros_like(corners)
    for k in range(3):
        np.add.at(normals, faces[:, k], area)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(length > 0, length, 1)
