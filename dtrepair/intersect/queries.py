"""Questions to a mesh beside its intersecting pairs: folds, areas, ray crossings."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.device import start_warp
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.geometry import FloatArray, IntArray


class Queries:
    """Queries on the mesh of a `Detector`, on its device; they never change.

    What they tell comes back to the host, whose decisions it steers.
    """

    def __init__(self, detector: Detector) -> None:
        """Use the tree and faces of `detector`."""
        from dtrepair.intersect import query_kernels

        self._detector, self._mesh = detector, detector.mesh
        self._device, self._warp = detector.mesh.device, start_warp()
        self._kernels = query_kernels

    def folds(
        self, points: NDArray[np.float32], *, active: NDArray[np.bool_] | None = None
    ) -> IntArray:
        """Return the pairs (K, 2) of triangles that share exactly one vertex and cross beyond it.

        With `active` (V,) only those whose shared vertex is active.
        """
        warp, device = self._warp, self._device
        mask = np.ones(self._detector.vertex_count, bool) if active is None else active
        positions = device.view(points, warp.vec3f)
        bent = device.empty(len(mask), warp.uint8)
        inputs = [positions, self._mesh.corners[0], *self._rings]
        inputs += [device.view(mask.view(np.uint8), warp.uint8), bent]
        device.launch(self._kernels.find_bent, len(mask), inputs)
        rows = self._fan_rows(np.flatnonzero(bent.numpy()))
        folded = device.empty(len(rows), warp.uint8)
        inputs = [positions, self._mesh.faces, self._fan_array]
        inputs += [device.view(rows, warp.int32), folded]
        device.launch(self._kernels.find_folds, len(rows), inputs)
        return np.sort(self._fans[rows[folded.numpy().astype(bool)]][:, [0, 2]], axis=1)

    def _fan_rows(self, vertices: NDArray[np.int64]) -> IntArray:
        """Return the rows of `_fans` whose shared vertex is one of `vertices`."""
        starts, stops = self._fan_starts[vertices], self._fan_starts[vertices + 1]
        sizes = stops - starts
        offsets = np.repeat(starts - np.cumsum(sizes) + sizes, sizes)
        return (offsets + np.arange(len(offsets))).astype(np.int32)

    def crossings(
        self,
        points: NDArray[np.float32],
        vertices: IntArray,
        directions: FloatArray,
        *,
        part: IntArray | None = None,
        over: NDArray[np.bool_] | None = None,
    ) -> IntArray:
        """Return the signed surface crossings (R,) of rays from vertices (R,).

        directions: (R, 3), any length.

        Each exit counts 1 and each entry -1; triangles at the vertex do not count, nor do those of
        a part that lies over that of the vertex: `part` (V,) numbers, `over` (P, P) [upper, lower].
        """
        from dtrepair.intersect.proximity_kernels import cast_rays

        if part is None or over is None:
            part, over = np.zeros(len(points), dtype=np.int32), np.zeros((1, 1), dtype=bool)
        warp, device, mesh = self._warp, self._device, self._mesh
        result = device.empty(len(vertices), warp.int32)
        positions = device.view(points[None], warp.vec3f)
        low, high = self._node_boxes(points)
        inputs = [positions, mesh.ordered, *mesh.leaves]
        inputs += [low, high, device.view(vertices.astype(np.int32), warp.int32)]
        inputs += [device.view(directions, warp.vec3d), device.array(part, warp.int32)]
        inputs += [device.view(over.view(np.uint8), warp.uint8), result]
        device.launch(cast_rays, len(vertices), inputs)
        counts: IntArray = result.numpy()
        return counts

    def vector_areas(self, points: FloatArray) -> FloatArray:
        """Return the vector area (V, 3) of each vertex: a third of its triangles'."""
        mesh, device, kind = self._mesh, self._device, self._warp.vec3d
        areas = device.empty(mesh.vertex_count, kind)
        inputs = [device.view(points, kind), mesh.faces, *mesh.corners, areas]
        device.launch(self._kernels.vertex_areas, mesh.vertex_count, inputs)
        of_vertices: FloatArray = areas.numpy()
        return of_vertices

    def _node_boxes(self, points: NDArray[np.float32]) -> tuple[Any, Any]:
        """Return the lower and the upper corners of the tree's nodes for a pose (V, 3)."""
        boxes = self._detector.boxes(points[None])
        return boxes[2], boxes[3]

    @cached_property
    def _rings(self) -> tuple[Any, Any]:
        """The next two vertices at each corner around a vertex; which vertices they enclose (V,).

        A vertex is enclosed if each neighbour starts one triangle around it and ends another.
        """
        count, corners = self._detector.vertex_count, self._mesh.corners[1].numpy()
        faces, at = self._detector.faces[corners // 3], corners % 3
        rows = np.arange(len(corners))
        vertex, start, end = (faces[rows, (at + k) % 3] for k in range(3))
        starts, ends = (np.sort(vertex.astype(np.int64) * count + w) for w in (start, end))
        closed = np.ones(count, dtype=np.uint8)
        closed[np.setxor1d(starts, ends) // count] = 0
        closed[starts[1:][starts[1:] == starts[:-1]] // count] = 0
        upload, ring = self._device.array, np.stack([start, end], axis=1)
        return upload(ring, self._warp.vec2i), upload(closed, self._warp.uint8)

    @cached_property
    def _fans(self) -> IntArray:
        """Pairs of triangles around each vertex; see `one_vertex_pairs`."""
        return one_vertex_pairs(self._detector.faces, self._detector.vertex_count)

    @cached_property
    def _fan_starts(self) -> NDArray[np.int64]:
        """First row of each vertex in the fans, which are sorted by shared vertex (V + 1,)."""
        fans, faces = self._fans, self._detector.faces
        shared = faces[fans[:, 0], fans[:, 1]]
        return np.searchsorted(shared, np.arange(self._detector.vertex_count + 1))

    @cached_property
    def _fan_array(self) -> Any:
        """The fans on the device."""
        return self._device.array(self._fans, self._warp.vec4i)


def one_vertex_pairs(faces: IntArray, count: int) -> IntArray:
    """Return the pairs of triangles that share exactly one vertex, (K, 4).

    Rows are (triangle, its corner, triangle, its corner).

    Sorted by the shared vertex.
    """
    corners = np.argsort(faces.ravel(), kind="stable")
    valence = np.bincount(faces.ravel(), minlength=count)
    starts = np.concatenate([[0], np.cumsum(valence)])
    by_valence = []
    for size in np.unique(valence[valence > 1]):
        vertices = np.flatnonzero(valence == size)
        around = corners[starts[vertices][:, None] + np.arange(size)]
        i, j = np.triu_indices(size, 1)
        by_valence.append(np.stack([around[:, i].ravel(), around[:, j].ravel()], axis=1))
    if not by_valence:
        return np.zeros((0, 4), dtype=np.int32)
    first, second = np.concatenate(by_valence).T
    shared = (faces[first // 3][:, :, None] == faces[second // 3][:, None, :]).sum(axis=(1, 2))
    first, second = first[shared == 1], second[shared == 1]
    rows = np.stack([first // 3, first % 3, second // 3, second % 3], axis=1).astype(np.int32)
    return rows[np.argsort(faces.ravel()[first], kind="stable")]
