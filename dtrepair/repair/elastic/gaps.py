"""Contacts as constraints: gaps between nearest points that a step must not close."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.device import start_warp
from dtrepair.numerics.geometry import FloatArray, IntArray, among, dots, lengths, pair_keys
from dtrepair.repair.surface.defects import Defects
from dtrepair.repair.surface.surface import BoolArray, Surface

# The bit that marks keys of gaps between a vertex and a triangle; keys of pairs and folds lack it.
FACING = 1 << 62


@dataclass(frozen=True, kw_only=True)
class GapOptions:
    """Numbers of the gaps that a step must not close.

    Args:
        stiffness: Of one gap, next to edges of weight about 1. Soft, so that the forces spread
            over a contact.
        stiffening: Factor by which a gap gets stiffer each time that it closed all the same; it
            gets softer by the same factor in each later step.
        shrink: Fraction of its width that a gap keeps in a step: the next step finds room left.
        margin: Least width, units of the size, well above what rounding to float32 moves.
        opening: Fraction of the clearance by which a narrow gap opens in a step: linear gaps are
            wrong for longer motions.
        retreat: Vertices that go back from what they face, by more than this part of the reach, do
            not look: what they face does, if it follows.
    """

    stiffness: float = 2.0
    stiffening: float = 2.0
    shrink: float = 0.5
    margin: float = 3e-4
    opening: float = 0.5
    retreat: float = 0.1


class Gaps:
    """Gaps of a clean pose, linearised: n . (B z) >= least for each, with forces that hold them.

    Each gap lies between the nearest points of two triangles; a triangle may be a single vertex
    or an edge. `forces` are the multipliers of an augmented Lagrangian (Nocedal & Wright 2006,
    section 17.3), kept from step to step.
    """

    def __init__(
        self, surface: Surface, mobility: FloatArray, *, options: GapOptions = GapOptions()
    ) -> None:
        """Start without gaps; `mobility` (V,) scales how far each vertex follows a step."""
        from dtrepair.repair.elastic import gap_kernels

        self.options = options
        self._kernels, self._warp, self._device = gap_kernels, start_warp(), surface.device
        self.surface, self.mobility = surface, mobility
        self.corners = np.zeros((0, 6), dtype=np.int32)
        self.keys = np.zeros(0, dtype=np.int64)
        self.forces = np.zeros(0)
        self._harder = np.zeros(0)
        self._mesh = surface.detector.mesh
        self._triangle_at = np.zeros(surface.count, dtype=np.int32)
        self._triangle_at[surface.faces.ravel()] = np.repeat(np.arange(len(surface.faces)), 3)

    def __len__(self) -> int:
        """Return the number of gaps."""
        return len(self.keys)

    def add_defects(self, defects: Defects) -> int:
        """Add gaps for pairs that a step made cross; known ones get stiffer. Return their number.

        Each crossing pair is one gap, each fold two.
        """
        faces = self.surface.faces
        folds = pair_keys(defects.folds)
        keys = np.concatenate([pair_keys(defects.crossings), folds, -folds])
        corners = [faces[defects.crossings].reshape(-1, 6), *_fold_corners(faces, defects.folds)]
        self._harder[np.isin(self.keys, keys)] *= self.options.stiffening
        self._insert(keys, np.concatenate(corners))
        return len(keys)

    def add_facing(
        self,
        points: FloatArray,
        areas: FloatArray,
        motion: FloatArray,
        radius: float,
    ) -> NDArray[np.int64]:
        """Add gaps between movable vertices and the triangles in front of them; return their keys.

        A triangle is in front where it lies along the vector area (V, 3) of the vertex, within a
        radius. motion: the way that each vertex is about to go (V, 3); those that go back do not
        look.
        """
        ahead = dots(motion, areas) >= -self.options.retreat * radius * lengths(areas)
        vertices = np.flatnonzero(ahead & (self.mobility > 0)).astype(np.int32)
        triangles = self._faced(points, areas, vertices, radius)
        pairs = np.stack([self._triangle_at[vertices], triangles], axis=1)[triangles >= 0]
        vertices = vertices[triangles >= 0]
        counts = self.surface.contacts.counts(pairs)
        vertices, triangles = vertices[counts], pairs[counts, 1]
        keys: NDArray[np.int64] = (
            vertices.astype(np.int64) << 32 | triangles.astype(np.int64) | FACING
        )
        alone = np.repeat(vertices[:, None], 3, axis=1)
        self._insert(keys, np.concatenate([alone, self.surface.faces[triangles]], axis=1))
        return keys

    def keep(self, mask: BoolArray) -> None:
        """Forget all other gaps; linearise again before use."""
        self.corners, self.keys = self.corners[mask], self.keys[mask]
        self.forces, self._harder = self.forces[mask], self._harder[mask]

    def soften(self) -> None:
        """Let stiff gaps go back towards the common stiffness."""
        self._harder = np.maximum(1.0, self._harder / self.options.stiffening)

    def scale(self, factor: FloatArray) -> None:
        """Scale each force by the largest factor (V,) of its corners."""
        self.forces *= factor[self.corners].max(axis=1)

    def linearise(self, points: FloatArray, *, clearance: float = 0.0) -> None:
        """Take directions, weights and least gaps from a clean pose (V, 3).

        With a clearance, gaps that are narrower are to open, by a fraction of it at most.
        """
        options = self.options
        first, second, gaps = self._nearest(points)
        widths = lengths(gaps)
        self._normals = gaps / np.maximum(widths, 1e-300)[:, None]
        columns = self.corners.ravel()
        weights = np.concatenate([first, -second], axis=1).ravel() * self.mobility[columns]
        shape, rows = (len(self), self.surface.count), np.repeat(np.arange(len(self)), 6)
        self._matrix = sparse.csr_matrix((weights, (rows, columns)), shape=shape)
        self._transposed = self._matrix.T.tocsr()
        least = np.maximum(np.minimum(options.margin, widths), options.shrink * widths)
        if clearance > 0.0:
            least = np.minimum(clearance, widths + options.opening * clearance)
        self.least = least - widths + self.width(points)
        # Many gaps at one vertex share the stiffness.
        absolute = abs(self._matrix)
        crowd = absolute @ np.asarray(absolute.sum(axis=0)).ravel()
        self.stiffness = options.stiffness * self._harder / np.maximum(1.0, 0.5 * crowd)

    def width(self, pose: FloatArray) -> FloatArray:
        """Return the linearised widths (C,) of a pose (V, 3), up to what does not move."""
        return dots(self._normals, self._matrix @ pose)

    def spread(self, forces: FloatArray) -> FloatArray:
        """Return the forces (C,) of the gaps as forces on the vertices (V, 3)."""
        on_vertices: FloatArray = self._transposed @ (self._normals * forces[:, None])
        return on_vertices

    def _insert(self, keys: NDArray[np.int64], corners: IntArray) -> None:
        new = ~among(keys, self.keys)
        self.keys = np.concatenate([self.keys, keys[new]])
        self.corners = np.concatenate([self.corners, corners[new]])
        self.forces = np.concatenate([self.forces, np.zeros(new.sum())])
        self._harder = np.concatenate([self._harder, np.ones(new.sum())])

    def _nearest(self, points: FloatArray) -> list[FloatArray]:
        warp, device = self._warp, self._device
        nearest = [device.empty(len(self), warp.vec3d) for _ in range(3)]
        corners = device.view(self.corners, warp.int32)
        inputs = [device.view(points, warp.vec3d), corners, *nearest]
        device.launch(self._kernels.nearest_points, len(self), inputs)
        return [array.numpy() for array in nearest]

    def _faced(
        self, points: FloatArray, areas: FloatArray, vertices: IntArray, radius: float
    ) -> IntArray:
        """Return the nearest triangle (Q,) along the normal of each vertex, or -1."""
        warp, device, surface, mesh = self._warp, self._device, self.surface, self._mesh
        normals = areas / (lengths(areas)[:, None] + 1e-300)
        low, high = surface.detector.boxes(surface.written(points)[None])[2:4]
        triangles = device.empty(len(vertices), warp.int32)
        positions = device.view(points, warp.vec3d)
        fronts = device.empty(len(surface.faces), warp.vec3d)
        inputs = [positions, mesh.faces, mesh.order, fronts]
        device.launch(self._kernels.front_areas, len(fronts), inputs)
        inputs = [positions, device.view(normals, warp.vec3d), device.view(vertices, warp.int32)]
        inputs += [mesh.faces, fronts, mesh.order, *mesh.leaves, low, high]
        inputs += [float(surface.size), float(radius), triangles]
        device.launch(self._kernels.faced_triangles, len(vertices), inputs)
        nearest: IntArray = triangles.numpy()
        return nearest


def _fold_corners(faces: IntArray, folds: IntArray) -> list[IntArray]:
    """Return corners (K, 6), twice, of folds: edge opposite the shared vertex, other triangle."""
    first, second = faces[folds[:, 0]], faces[folds[:, 1]]
    same = first[:, :, None] == second[:, None, :]
    corners = []
    for triangle, other, shared in (
        (first, second, same.any(axis=2)),
        (second, first, same.any(1)),
    ):
        rows, corner = np.arange(len(folds)), shared.argmax(axis=1)
        start, stop = (triangle[rows, (corner + k) % 3][:, None] for k in (1, 2))
        corners.append(np.concatenate([start, stop, stop, other], axis=1))
    return corners
