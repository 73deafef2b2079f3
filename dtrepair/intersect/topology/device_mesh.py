"""The triangles of one mesh, and the tree over them, as arrays on a device."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from dtrepair.device import Device, start_warp
from dtrepair.intersect.tree import Tree
from dtrepair.numerics.geometry import IntArray, adjacency


class DeviceMesh:
    """What kernels need to know of a topology: Warp arrays, each made once, when asked for.

    What is built on a mesh works on its device: no other place names one.

    Args:
        faces: Triangles (F, 3).
        vertex_count: Number of vertices V.
        tree: The tree over the triangles; without one there are no arrays of it.
        device: Where the arrays are.
    """

    def __init__(
        self, faces: IntArray, vertex_count: int, *, tree: Tree | None = None, device: Device
    ) -> None:
        self.triangles, self.vertex_count = faces, vertex_count
        self.tree, self.device = tree, device
        self._warp = start_warp()

    @cached_property
    def faces(self) -> Any:
        """The triangles (F,), vec3i."""
        return self.device.array(self.triangles, self._warp.vec3i)

    @cached_property
    def ordered(self) -> Any:
        """The triangles (F,) in leaf order, vec3i."""
        assert self.tree is not None
        return self.device.array(self.triangles[self.tree.order], self._warp.vec3i)

    @cached_property
    def order(self) -> Any:
        """The number (F,) of each triangle in leaf order."""
        assert self.tree is not None
        return self.device.array(self.tree.order, self._warp.int32)

    @cached_property
    def leaves(self) -> tuple[Any, Any]:
        """Where each leaf starts in leaf order, and the skip links of the nodes."""
        assert self.tree is not None
        tree, kind = self.tree, self._warp.int32
        return self.device.array(tree.leaf_start, kind), self.device.array(tree.skip, kind)

    @cached_property
    def neighbours(self) -> tuple[Any, Any]:
        """Neighbours of the vertices, as compressed rows."""
        indptr, indices = adjacency(self.triangles, self.vertex_count)
        kind = self._warp.int32
        return self.device.array(indptr, kind), self.device.array(indices, kind)

    @cached_property
    def corners(self) -> tuple[Any, Any]:
        """Corners (3 x triangle + corner) around each vertex, as compressed rows."""
        flat = self.triangles.ravel()
        starts = np.searchsorted(np.sort(flat), np.arange(self.vertex_count + 1))
        order = np.argsort(flat, kind="stable").astype(np.int32)
        kind = self._warp.int32
        return self.device.array(starts.astype(np.int32), kind), self.device.array(order, kind)
