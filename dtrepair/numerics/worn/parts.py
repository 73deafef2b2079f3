"""The connected parts of a mesh in a few poses: vertices, normals, areas, lengths of edges."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    cross,
    dots,
    extent,
    lengths,
    triangle_areas,
    unique_edges,
    vector_areas,
)

BoolArray = NDArray[np.bool_]


class Parts:
    """Connected parts of a mesh, and the poses in which they are looked at.

    Args:
        faces: Triangles (F, 3); duplicates along seams are one vertex.
        part: The part (V,) of each vertex, -1 for those without a triangle.
        closed: Which parts are closed surfaces.
        poses: Poses (V, 3), the rest first.
    """

    def __init__(
        self, faces: IntArray, part: IntArray, closed: BoolArray, poses: Sequence[FloatArray]
    ) -> None:
        self.faces, self.part, self.closed, self.poses = faces, part, closed, tuple(poses)
        order = np.argsort(part, kind="stable")
        starts = np.searchsorted(part[order], np.arange(len(closed) + 1))
        self.vertices = [order[a:b].astype(np.int32) for a, b in pairwise(starts)]
        of_face = part[faces[:, 0]]
        order = np.argsort(of_face, kind="stable")
        starts = np.searchsorted(of_face[order], np.arange(len(closed) + 1))
        self.triangles = [faces[order[a:b]] for a, b in pairwise(starts)]
        rest = self.poses[0]
        edges = unique_edges(faces)
        length = lengths(rest[edges[:, 0]] - rest[edges[:, 1]])
        # The longest edge at each vertex: between those of a coarse mesh the surface is nearer.
        self.spacing = np.zeros(len(rest))
        np.maximum.at(self.spacing, edges.ravel(), np.repeat(length, 2))
        self._normals: dict[tuple[int, int], FloatArray] = {}

    def normals(self, part: int, pose: int) -> FloatArray:
        """Return unit normals (n, 3) of the vertices of a part in a pose."""
        if (part, pose) not in self._normals:
            areas = vertex_normals(self.poses[pose], self.triangles[part], self.vertices[part])
            self._normals[part, pose] = areas
        return self._normals[part, pose]

    def area_shares(self, part: int) -> FloatArray:
        """Return the share (n,) of a part's area at rest that is around each of its vertices."""
        triangles, own = self.triangles[part], self.vertices[part]
        areas = np.repeat(triangle_areas(self.poses[0], triangles), 3)
        place = np.searchsorted(own, triangles.ravel())
        shares: FloatArray = np.bincount(place, areas, len(own)) / (areas.sum() or 1.0)
        return shares

    def thickness(self, part: int, pose: int) -> float:
        """Return how thick a closed part is in the mean, units of its extent."""
        corners = self.poses[pose][self.triangles[part]]
        areas = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2.0
        middle = corners.mean(axis=(0, 1))
        volume = float(dots(corners[:, 0] - middle, areas).sum()) / 3.0
        # A sheet has two sides: half its area times its thickness is its volume.
        across = 2.0 * abs(volume) / max(float(lengths(areas).sum()), np.finfo(float).tiny)
        return across / max(extent(corners.reshape(-1, 3)), np.finfo(float).tiny)


def vertex_normals(points: FloatArray, triangles: IntArray, vertices: IntArray) -> FloatArray:
    """Return unit normals (n, 3) at vertices (n,), ascending, of triangles (F, 3) among them."""
    areas = np.repeat(vector_areas(points, triangles), 3, axis=0)
    place = np.searchsorted(vertices, triangles.ravel())
    summed = [np.bincount(place, areas[:, k], len(vertices)) for k in range(3)]
    normals: FloatArray = np.stack(summed, axis=1).astype(np.float64)
    length = lengths(normals)[:, None]
    return np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
