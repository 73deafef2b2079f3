"""All pairs of intersecting triangles of a mesh, exactly, for one pose or a batch of poses."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dtrepair.device import Device, start_warp
from dtrepair.intersect.exact import settled
from dtrepair.intersect.ignored import PairLimits, collapsed
from dtrepair.intersect.topology.device_mesh import DeviceMesh
from dtrepair.intersect.tree import build_tree, leaf_neighbors
from dtrepair.numerics.attachments import Attachments
from dtrepair.numerics.geometry import as_mesh, as_numpy, weld_map
from dtrepair.numerics.work import add_work

if TYPE_CHECKING:
    import torch

# Levels of the tree that one launch on a GPU fits.
LEVELS = 3

# Of poses (B, V, 3) and rows of their candidates (K, 4), which ones (K,) to keep.
Settle = Callable[[NDArray[np.float32], NDArray[np.int32]], NDArray[np.bool_]]
# Launches a Warp kernel: kernel, dimensions, inputs.
Launch = Callable[[Any, tuple[int, ...], list[Any]], None]


class Detector:
    """Finds intersecting triangles of the poses of one topology; built once per topology.

    A pair counts if its triangles share no vertex (after `weld`) and have a common point; touching
    counts; coordinates are rounded to float32 first. A triangle without area is the segment, or
    the point, that its corners span.

    Args:
        rest: Rest positions (V, 3), any length unit: the hierarchy is built on them.
        faces: Triangles (F, 3).
        weld: Representative of each vertex (V,); vertices with one representative are one vertex.
            Default: each vertex stands for itself.
        device: "cpu" or "cuda:N".
        limits: With how many pairs a pose has collapsed.

    Raises:
        ValueError: shapes, indices or numbers that are not those of a mesh.
    """

    def __init__(
        self,
        rest: ArrayLike,
        faces: ArrayLike,
        *,
        weld: ArrayLike | None = None,
        device: str = "cpu",
        limits: PairLimits = PairLimits(),
    ) -> None:
        from dtrepair.intersect import kernels

        points, triangles = as_mesh(rest, faces)
        self.device, self.limits = device, limits
        self.vertex_count = len(points)
        self.faces = triangles
        self.tree = build_tree(points[triangles].mean(axis=1)) if len(triangles) else None
        self._warp, self._kernels, self._there = start_warp(), kernels, Device(device)
        self.mesh = DeviceMesh(triangles, len(points), tree=self.tree, device=self._there)
        if self.tree is None:
            return
        self._capacity = max(4096, 4 * len(triangles))
        near = leaf_neighbors(triangles[self.tree.order], self.tree.leaf_start)
        upload = self._there.array
        self._neighbors = [upload(a, self._warp.int32) for a in (near.start, near.leaf)]
        self._neighbors += [upload(near.excluded, self._warp.uint64)]
        self._all_active = self._active(np.ones(len(triangles), dtype=bool))
        self._no_zones = self.zones_of(None)
        self._welded = self._weld(weld) if weld is not None else self.mesh.ordered

    def __call__(
        self,
        points: Any,
        *,
        weld: ArrayLike | None = None,
        exact: bool | Settle = True,
        active: NDArray[np.bool_] | None = None,
        zones: Any = None,
    ) -> NDArray[np.int32]:
        """Return the intersecting pairs of a pose (V, 3) as (K, 2), of poses (B, V, 3) as (K, 3).

        Columns are (i, j) or (frame, i, j) with i < j; rows are sorted. `weld` replaces the weld
        map for this call. With `exact=False` pairs that floating point cannot settle count as
        intersecting: never fewer pairs, and no host arithmetic in an inner loop; a function
        says which rows of `candidates` to keep. `active` (F,) leaves out the pairs of which neither
        triangle is active, `zones` (of `zones_of`) modelled contacts, which a collapsed pose may
        have any number of. Raises CollapsedPoseError where more are left than can be kept.
        """
        rounded = self._rounded(points)
        looked_at = len(self.faces) if active is None else int(active.sum())
        add_work(len(rounded) * looked_at)
        pairs = self.candidates(rounded, weld=weld, active=active, zones=zones)
        if callable(exact):
            pairs = pairs[exact(rounded, pairs)]
        elif exact:
            pairs = self._settled(rounded, pairs)
        pairs = pairs[np.lexsort((pairs[:, 2], pairs[:, 1], pairs[:, 0])), :3]
        return np.ascontiguousarray(pairs[:, 1:] if np.ndim(points) == 2 else pairs)

    def candidates(
        self,
        points: NDArray[np.float32],
        *,
        weld: ArrayLike | None = None,
        active: NDArray[np.bool_] | None = None,
        zones: Any = None,
    ) -> NDArray[np.int32]:
        """Return rows (frame, i, j, certainty), unsorted, of poses (B, V, 3).

        Certainty: 1 if they intersect, 2 if floating point cannot tell, 3 if it cannot as one of
        them has no area.
        """
        if self.tree is None or points.shape[0] == 0:
            return np.zeros((0, 4), dtype=np.int32)
        warp = self._warp
        welded = self._welded if weld is None else self._weld(weld)
        positions = self._there.view(points, warp.vec3f)
        near = self._near(positions, welded, active, zones)
        pairs = self._there.empty(len(near), warp.vec4i)
        count = self._there.zeros(1, warp.int32)
        inputs = [near, positions, self.mesh.ordered, self.mesh.order, pairs, count]
        self._there.launch(self._kernels.test_candidates, (len(near),), inputs)
        found = int(count.numpy()[0])
        if found > self.limits.of(len(self.faces) * len(points))[1]:
            raise collapsed(len(self.faces))
        rows: NDArray[np.int32] = pairs.numpy()[:found]
        return rows

    def _near(
        self,
        positions: Any,
        welded: Any,
        active: NDArray[np.bool_] | None,
        zones: Any,
    ) -> Any:
        """Return candidate pairs (frame, i, j) in leaf order, a Warp array of their number."""
        assert self.tree is not None
        warp = self._warp
        boxes = self.boxes(positions)
        most = self.limits.of(len(self.faces) * positions.shape[0])[0]
        while True:
            capacity = self._capacity  # another thread may raise it meanwhile
            near = self._there.empty(capacity, warp.vec3i)
            count = self._there.zeros(1, warp.int32)
            launch = self._there.launch
            self.search(boxes, welded, near, count, launch, active=active, zones=zones)
            needed = int(count.numpy()[0])
            if needed > most:
                raise collapsed(len(self.faces))
            if needed <= capacity:
                return near[:needed]
            self._capacity = max(self._capacity, min(2 * needed, most))

    def _active(self, active: NDArray[np.bool_]) -> Any:
        """Return the tree's marks of active triangles (F,) on the device. Raises ValueError."""
        assert self.tree is not None
        if active.shape != (len(self.faces),) or active.dtype != bool:
            raise ValueError(
                f"active should be booleans of shape ({len(self.faces)},), one for each "
                f"triangle, got {active.dtype} of shape {active.shape}"
            )
        return self._there.view(self.tree.marks(active), self._warp.uint8)

    def _rounded(self, points: Any) -> NDArray[np.float32]:
        """Return points as float32 poses (B, V, 3). Raises ValueError for others."""
        array = as_numpy(points)
        if array.ndim not in (2, 3) or array.shape[-2:] != (self.vertex_count, 3):
            raise ValueError(
                f"points should have shape ({self.vertex_count}, 3) or (B, {self.vertex_count}, 3)"
                f", got {array.shape}: a pose must have the topology of its rest"
            )
        with np.errstate(over="ignore"):
            rounded = np.ascontiguousarray(array, dtype=np.float32)
        if not np.isfinite(rounded).all():
            raise ValueError(
                "points should be finite in float32, got NaN or a number beyond 3.4e38: "
                "check the pose"
            )
        return rounded[None] if rounded.ndim == 2 else rounded

    def _settled(self, points: NDArray[np.float32], pairs: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return the rows (K, 4) that intersect: uncertain ones are decided in integers."""
        uncertain = pairs[:, 3] > 1
        keep = ~uncertain
        keep[uncertain] = settled(self.mesh, points, pairs[uncertain, :3])
        return pairs if keep.all() else pairs[keep]

    def boxes(self, points: Any) -> list[Any]:
        """Return the boxes of triangles (in leaf order) and nodes of poses (B, V, 3).

        The fifth array holds the boxes of the triangles once more, as blocks by leaf.
        """
        warp = self._warp
        positions = self._there.view(points, warp.vec3f)
        boxes = self.box_arrays(points.shape[0])
        self.fit(positions, boxes, self._there.launch)
        return boxes

    def box_arrays(self, frames: int) -> list[Any]:
        """Return empty arrays for the boxes of `frames` poses, to be filled by `fit`."""
        assert self.tree is not None
        warp, nodes = self._warp, self.tree.node_count
        boxes = [
            self._there.empty((frames, count), warp.vec3f)
            for count in (len(self.faces), len(self.faces), nodes, nodes)
        ]
        blocks = (frames, self.tree.leaf_count, 6)
        return [*boxes, self._there.empty(blocks, self._kernels.vec8f)]

    def fit(self, positions: Any, boxes: list[Any], launch: Launch) -> None:
        """Fill the `box_arrays` of poses, a Warp array (B, V) of vec3f."""
        assert self.tree is not None
        frames = positions.shape[0]
        leaves = [positions, self.mesh.ordered, self.mesh.leaves[0], *boxes]
        launch(self._kernels.fit_leaves, (frames, self.tree.leaf_count), leaves)
        # Threads that run one after the other need no launches in between.
        levels = max(self.tree.depth, 1) if self._there.serial else LEVELS
        for bottom in range(self.tree.depth, 0, -levels):
            top = max(0, bottom - levels)
            inputs = [(1 << top) - 1, bottom - top, *boxes[2:4]]
            launch(self._kernels.fit_levels, (frames, 1 << top), inputs)

    def search(
        self,
        boxes: list[Any],
        welded: Any,
        near: Any,
        count: Any,
        launch: Launch,
        *,
        active: NDArray[np.bool_] | None = None,
        zones: Any = None,
    ) -> None:
        """Write candidates (frame, i, j) in leaf order to `near`, as far as there is room.

        welded: Corners (F, 3) in leaf order; triangles with a common one are no candidates.

        Their number is added to `count`, up to a little more than `limits` allow; both are Warp
        arrays.
        """
        assert self.tree is not None
        marks = self._all_active if active is None else self._active(active)
        most = self.limits.of(len(self.faces) * boxes[0].shape[0])[0]
        known = self._no_zones if zones is None else zones
        inputs = [*self.mesh.leaves, welded, *self._neighbors, marks, known, *boxes]
        inputs += [most, self.limits.of_leaf, near, count]
        launch(self._kernels.find_candidates, (boxes[0].shape[0], self.tree.leaf_count), inputs)

    def zones_of(self, attachments: Attachments | None) -> Any:
        """Return a Warp structure of what was modelled, for `search` to leave out.

        Of no triangles for None, and where parts are too many for bits.
        """
        from dtrepair.intersect.predicates import Zones

        part, third = np.zeros(0, dtype=np.int32), np.zeros((0, 0), dtype=np.uint8)
        towards, result = np.zeros((0, 0), dtype=np.uint64), Zones()
        bits = None if attachments is None else attachments.zone_bits
        if attachments is not None and bits is not None and self.tree is not None:
            order, count = self.tree.order, attachments.count
            part, towards = attachments.part_of[order].astype(np.int32), bits[order]
            third = np.zeros((count, count), dtype=np.uint8)
            first, second = np.divmod(attachments.by_third, count)
            third[first, second] = third[second, first] = 1
        result.part = self._there.array(part, self._warp.int32)
        result.towards = self._there.array(towards, self._warp.uint64)
        result.by_third = self._there.array(third, self._warp.uint8)
        return result

    @property
    def topology(self) -> list[Any]:
        """Warp arrays of the triangles in leaf order: corners, welded corners, own numbers."""
        return [self.mesh.ordered, self._welded, self.mesh.order]

    def _weld(self, weld: ArrayLike) -> Any:
        """Return the welded corners (F, 3) in leaf order on the device. Raises ValueError."""
        assert self.tree is not None
        welded = np.asarray(weld)
        if welded.shape != (self.vertex_count,) or not np.issubdtype(welded.dtype, np.integer):
            raise ValueError(
                f"weld should be integers of shape ({self.vertex_count},), one for each vertex, "
                f"got {welded.dtype} of shape {welded.shape}"
            )
        corners = welded.astype(np.int32)[self.faces[self.tree.order]]
        return self._there.array(corners, self._warp.vec3i)


@overload
def find_intersections(points: torch.Tensor, faces: Any) -> torch.Tensor: ...


@overload
def find_intersections(points: ArrayLike, faces: Any) -> NDArray[np.int32]: ...


def find_intersections(points: Any, faces: Any) -> Any:
    """Return the intersecting pairs (K, 2) of a mesh (V, 3), (F, 3): i < j, sorted, exact.

    An int32 array, or a tensor where the points are one, on their device.
    Vertices at one float32 position count as one vertex. For several poses of one topology build a
    `Detector` once.
    """
    vertices, triangles = as_mesh(as_numpy(points), as_numpy(faces))
    with np.errstate(over="ignore"):  # the detector tells what is beyond float32
        weld = weld_map(vertices)
    pairs = Detector(vertices, triangles, weld=weld)(vertices)
    if not hasattr(points, "detach"):
        return pairs
    import torch

    return torch.from_numpy(pairs).to(points.device)


def triangle_count(pairs: NDArray[np.int32]) -> int:
    """Return the number of distinct triangles in pairs (K, 2)."""
    return len(np.unique(pairs))


__all__ = ["Detector", "find_intersections", "triangle_count"]
