"""Questions to a mesh beside its intersecting pairs: folds, ring distances, ray crossings."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.geometry import FloatArray, IntArray, adjacency, pair_keys


class Queries:
    """Queries on the mesh of a `Detector`, which never change.

    They run on the CPU: their results steer the host's decisions.
    """

    def __init__(self, detector: Detector) -> None:
        """Use the tree and faces of `detector`."""
        from dtrepair.device import start_warp
        from dtrepair.intersect import query_kernels

        self._detector = detector
        self._warp = start_warp()
        self._kernels = query_kernels
        self._faces = self._array(detector.faces, self._warp.vec3i)

    def folds(
        self, points: NDArray[np.float32], *, active: NDArray[np.bool_] | None = None
    ) -> IntArray:
        """Return the pairs (K, 2) of triangles that share exactly one vertex and cross beyond it.

        With `active` (V,) only those whose shared vertex is active.
        """
        warp = self._warp
        mask = np.ones(self._detector.vertex_count, bool) if active is None else active
        positions = self._array(points, warp.vec3f)
        bent = warp.empty(len(mask), dtype=warp.uint8, device="cpu")
        inputs = [positions, self._corners[0], *self._rings]
        inputs += [self._array(mask.view(np.uint8), warp.uint8), bent]
        warp.launch(self._kernels.find_bent, dim=len(mask), inputs=inputs, device="cpu")
        rows = self._fan_rows(np.flatnonzero(bent.numpy()))
        folded = warp.empty(len(rows), dtype=warp.uint8, device="cpu")
        inputs = [positions, self._faces, self._fan_array, self._array(rows, warp.int32), folded]
        warp.launch(self._kernels.find_folds, dim=len(rows), inputs=inputs, device="cpu")
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
        warp = self._warp
        result = warp.empty(len(vertices), dtype=warp.int32, device="cpu")
        positions = warp.array(points[None], dtype=warp.vec3f, device="cpu", copy=False)
        low, high = self._node_boxes(points)
        inputs = [positions, *self._tree]
        inputs += [low, high, self._array(vertices.astype(np.int32), warp.int32)]
        inputs += [self._array(directions, warp.vec3d), self._array(part, warp.int32)]
        inputs += [self._array(over.view(np.uint8), warp.uint8), result]
        warp.launch(cast_rays, dim=len(vertices), inputs=inputs, device="cpu")
        counts: IntArray = result.numpy()
        return counts

    def vector_areas(self, points: FloatArray) -> FloatArray:
        """Return the vector area (V, 3) of each vertex: a third of its triangles'."""
        warp, count = self._warp, self._detector.vertex_count
        areas = warp.empty(count, dtype=warp.vec3d, device="cpu")
        inputs = [self._array(points, warp.vec3d), self._faces, *self._corners, areas]
        warp.launch(self._kernels.vertex_areas, dim=count, inputs=inputs, device="cpu")
        of_vertices: FloatArray = areas.numpy()
        return of_vertices

    def _node_boxes(self, points: NDArray[np.float32]) -> tuple[Any, Any]:
        """Return the lower and the upper corners of the tree's nodes for a pose (V, 3)."""
        boxes = self._detector.boxes(points[None])
        return boxes[2], boxes[3]

    @cached_property
    def _tree(self) -> list[Any]:
        """Triangles in leaf order, first of each leaf, skip links, on the device."""
        tree = self._detector.tree
        assert tree is not None
        links = [self._array(values, self._warp.int32) for values in (tree.leaf_start, tree.skip)]
        return [self._array(self._detector.faces[tree.order], self._warp.vec3i), *links]

    @cached_property
    def _corners(self) -> tuple[Any, Any]:
        """Corners (3 x triangle + corner) around each vertex, as compressed rows."""
        flat = self._detector.faces.ravel()
        starts = np.searchsorted(np.sort(flat), np.arange(self._detector.vertex_count + 1))
        order = np.argsort(flat, kind="stable").astype(np.int32)
        return (
            self._array(starts.astype(np.int32), self._warp.int32),
            self._array(order, self._warp.int32),
        )

    @cached_property
    def _rings(self) -> tuple[Any, Any]:
        """The next two vertices at each corner of `_corners`; which vertices they enclose (V,).

        A vertex is enclosed if each neighbour starts one triangle around it and ends another.
        """
        count, corners = self._detector.vertex_count, self._corners[1].numpy()
        faces, at = self._detector.faces[corners // 3], corners % 3
        rows = np.arange(len(corners))
        vertex, start, end = (faces[rows, (at + k) % 3] for k in range(3))
        starts, ends = (np.sort(vertex.astype(np.int64) * count + w) for w in (start, end))
        closed = np.ones(count, dtype=np.uint8)
        closed[np.setxor1d(starts, ends) // count] = 0
        closed[starts[1:][starts[1:] == starts[:-1]] // count] = 0
        ring = np.stack([start, end], axis=1)
        return self._array(ring, self._warp.vec2i), self._array(closed, self._warp.uint8)

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
        return self._array(self._fans, self._warp.vec4i)

    def _array(self, values: NDArray[Any], dtype: Any) -> Any:
        """Return values as a Warp array on the CPU."""
        return self._warp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu")


class RingDistances:
    """Tells how many edge rings lie between triangles of one mesh, as `pairs -> rings`.

    Threads may share one: what is remembered is replaced as a whole, never changed, so that at
    worst they find the same answer twice.

    Args:
        faces: Triangles (F, 3).
        vertex_count: Number of vertices.
        limit: Rings up to which distances are known; what is farther counts as one ring more. A
            search grows with the square of it.
    """

    def __init__(self, faces: IntArray, vertex_count: int, *, limit: int = 20) -> None:
        from dtrepair.device import start_warp
        from dtrepair.intersect import query_kernels

        self._warp, self._kernels = start_warp(), query_kernels
        self._faces, self._count, self.limit = faces, vertex_count, limit
        self._known = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int32)

    def __call__(self, pairs: IntArray) -> IntArray:
        """Return the edge rings (K,) between triangles of pairs (K, 2), at most `limit` + 1."""
        wanted = pair_keys(pairs)
        keys, rings = self._known
        place = np.searchsorted(keys, wanted)
        new = place == len(keys)
        new[~new] = keys[place[~new]] != wanted[~new]
        if new.any():
            unknown = np.sort(wanted[new])
            unknown = unknown[np.diff(unknown, prepend=-1) > 0]
            rows = np.stack([unknown >> 32, unknown & 0xFFFFFFFF], axis=1).astype(np.int32)
            every = np.concatenate([keys, unknown])
            found = np.concatenate([rings, self._search(rows)])
            order = np.argsort(every)
            self._known = keys, rings = every[order], found[order]
            place = np.searchsorted(keys, wanted)
        answer: IntArray = rings[place]
        return answer

    def _search(self, pairs: IntArray) -> IntArray:
        """Return the ring distances (K,) of pairs (K, 2) by breadth-first search."""
        warp, count = self._warp, self._count
        distance = warp.empty(len(pairs), dtype=warp.int32, device="cpu")
        faces, indptr, indices = self._mesh
        scratch = [warp.zeros((2, count), dtype=warp.int32, device="cpu") for _ in range(2)]
        queue = warp.empty(count, dtype=warp.int32, device="cpu")
        half = self.limit // 2
        inputs = [faces, indptr, indices, self._array(pairs, warp.vec2i)]
        inputs += [half, self.limit - half, *scratch, queue, distance]
        warp.launch(self._kernels.ring_distances, dim=1, inputs=inputs, device="cpu")
        found: IntArray = distance.numpy()
        return found

    @cached_property
    def _mesh(self) -> tuple[Any, Any, Any]:
        """Triangles, and neighbours of the vertices as compressed rows, on the device."""
        indptr, indices = adjacency(self._faces, self._count)
        rows = (self._array(part, self._warp.int32) for part in (indptr, indices))
        return self._array(self._faces, self._warp.vec3i), *rows

    def _array(self, values: NDArray[Any], dtype: Any) -> Any:
        return self._warp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu")


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


def link_labels(links: NDArray[np.integer], count: int) -> IntArray:
    """Return the connected component (count,) of each item under undirected links (K, 2).

    Components are numbered by their first items.
    """
    from dtrepair.device import start_warp
    from dtrepair.intersect import query_kernels

    warp, items = start_warp(), np.arange(count, dtype=np.int32)
    roots = warp.array(items, dtype=warp.int32, device="cpu")
    pairs = np.ascontiguousarray(links, dtype=np.int32).reshape(-1, 2)
    inputs = [warp.array(pairs, dtype=warp.vec2i, device="cpu"), roots]
    warp.launch(query_kernels.link_roots, dim=1, inputs=inputs, device="cpu")
    root = roots.numpy()
    labels: IntArray = (np.cumsum(root == items, dtype=np.int32) - 1)[root]
    return labels
