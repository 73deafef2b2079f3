"""The connected parts of a mesh in one pose: their surfaces, and what lies behind these."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.numerics.closest_point import NearestTriangles, barycentric
from dtrepair.numerics.enclosure import Dipoles
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    border_edges,
    dots,
    lengths,
    triangle_areas,
    unique_edges,
    vector_areas,
)

BoolArray = NDArray[np.bool_]


class PosedParts:
    """Parts of a mesh in a pose.

    Args:
        points, faces: The pose (V, 3), and triangles (F, 3).
        part_of_vertex, part_of: The part (V,) of each vertex, -1 for none, and (F,) of each
            triangle.
        cells: Along the extent of a part, for its winding numbers.
        enclosed: Behind a part lies what it encloses by this winding number.
    """

    def __init__(
        self,
        points: FloatArray,
        faces: IntArray,
        part_of_vertex: IntArray,
        part_of: IntArray,
        *,
        cells: int,
        enclosed: float,
    ) -> None:
        self.points, self.faces = points, faces
        self.part_of_vertex, self.part_of = part_of_vertex, part_of
        self.parts = int(part_of.max(initial=-1)) + 1
        self._cells, self._enclosed = cells, enclosed
        edges = unique_edges(faces)
        length = lengths(self.points[edges[:, 0]] - self.points[edges[:, 1]])
        both = np.concatenate([edges, edges[:, ::-1]])
        weights = np.concatenate([length, length]) + np.finfo(np.float32).tiny
        shape = (len(part_of_vertex), len(part_of_vertex))
        self.graph = sparse.csr_matrix((weights, (both[:, 0], both[:, 1])), shape=shape)
        self.edge_length = np.full(len(part_of_vertex), 0.0)
        np.maximum.at(self.edge_length, both[:, 0], np.concatenate([length, length]))
        # A head has hundreds of lashes and locks.
        self._trees: dict[int, NearestTriangles] = {}
        self._dipoles: dict[int, Dipoles] = {}
        order = np.argsort(part_of_vertex, kind="stable").astype(np.int32)
        self._order = order
        self._starts = np.searchsorted(part_of_vertex[order], np.arange(self.parts + 1))
        self._face_order = np.argsort(part_of, kind="stable").astype(np.int32)
        self._face_starts = np.searchsorted(part_of[self._face_order], np.arange(self.parts + 1))

    @cached_property
    def open(self) -> BoolArray:
        """Which parts (P,) have a border."""
        borders = border_edges(self.faces, len(self.points))
        result = np.zeros(self.parts, dtype=bool)
        result[self.part_of_vertex[self.faces.ravel()[borders[:, 0]]]] = True
        return result

    @cached_property
    def normals(self) -> FloatArray:
        """Vector area (V, 3) of the triangles around each vertex."""
        areas = np.repeat(vector_areas(self.points, self.faces), 3, axis=0)
        flat = self.faces.ravel()
        columns = [np.bincount(flat, areas[:, k], len(self.points)) for k in range(3)]
        return np.stack(columns, axis=1)

    @cached_property
    def areas(self) -> FloatArray:
        """Area (P,) of each part."""
        areas = triangle_areas(self.points, self.faces)
        total = np.bincount(self.part_of, areas, minlength=self.parts)
        return total.astype(np.float64)

    def vertices(self, part: int) -> IntArray:
        """Return the vertices of a part, ascending."""
        return self._order[self._starts[part] : self._starts[part + 1]]

    def triangles(self, part: int) -> IntArray:
        """Return the triangles of a part, ascending."""
        return self._face_order[self._face_starts[part] : self._face_starts[part + 1]]

    def _corners(self, part: int) -> FloatArray:
        """Return the corners (N, 3, 3) of the triangles of a part."""
        return np.asarray(self.points[self.faces[self.triangles(part)]])

    def tree(self, part: int) -> NearestTriangles:
        """Return the triangles of a part to be asked for the nearest."""
        if part not in self._trees:
            self._trees[part] = NearestTriangles(self._corners(part))
        return self._trees[part]

    def behind(self, part: int, other: int) -> IntArray:
        """Return the vertices of a part behind, or enclosed by, another one, within its box."""
        own, triangles = self.vertices(part), self.triangles(other)
        other_points = self.points[self.vertices(other)]
        low, high = other_points.min(axis=0), other_points.max(axis=0)
        points = self.points[own]
        own = np.asarray(own[((points >= low) & (points <= high)).all(axis=1)])
        if len(own) == 0:
            return own
        if not self.open[other]:
            points = self.points[own]
            nearest, closest = self.tree(other).nearest(points)
            weights = barycentric(closest, self.tree(other).corners[nearest])
            normals = self.normals[self.faces[triangles[nearest]]]
            normal = np.einsum("ik,ikj->ij", weights, normals)
            # Where a surface turns sharply such normals may have what is outside behind it.
            own = np.asarray(own[dots(points - closest, normal) < 0.0])
        if len(own) == 0:
            return own
        if other not in self._dipoles:
            self._dipoles[other] = Dipoles(self._corners(other), self._cells)
        around = np.abs(self._dipoles[other].enclose_closely(self.points[own]))
        return np.asarray(own[around > self._enclosed])
