"""Detection of many poses into buffers of fixed size: nothing is allocated, nothing waits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from dtrepair.device import DeviceQueue, start_warp
from dtrepair.intersect.detector import Detector
from dtrepair.intersect.ignored import CountedPairs, collapsed


@dataclass(frozen=True, kw_only=True)
class BufferOptions:
    """Sizes of the first buffers; they are made larger where they overflow.

    Args:
        candidates: Candidate pairs for each triangle of a pose: boxes of neighbours overlap.
        pairs: Intersecting pairs for each triangle of a pose.
        least: Pairs of either kind beside that: small meshes may be all knots.
    """

    candidates: float = 4.0
    pairs: float = 0.5
    least: int = 4096


class FixedDetection:
    """Intersecting pairs of `frames` poses at a time, as launches that a CUDA graph can hold.

    Pairs that floating point cannot settle are settled exactly. After
    `run`, `pairs` (capacity, 3) holds frame, triangle, triangle in its first `count` rows, in no
    order, and `triangles` (B,) the number of distinct triangles of each pose. Where a buffer was
    too small, `needed` (2,), the most candidates and pairs of all runs, tells what would do: then
    the rest is not to be used.
    """

    def __init__(
        self,
        detector: Detector,
        frames: int,
        queue: DeviceQueue,
        *,
        counted: CountedPairs | None = None,
        capacity: tuple[int, int] | None = None,
        options: BufferOptions = BufferOptions(),
    ) -> None:
        """Make buffers of `capacity` candidates and pairs (default: those of the options)."""
        self.queue = queue
        warp, device = start_warp(), detector.device
        faces = len(detector.faces)
        self.detector, self.frames = detector, frames
        self.capacity = capacity or (
            int(options.candidates * frames * faces) + options.least,
            int(options.pairs * frames * faces) + options.least,
        )
        everything = CountedPairs(np.zeros(faces, dtype=np.int32), np.ones((1, 1), dtype=bool))
        counted = counted or everything
        keys = counted.listed[:, 0].astype(np.int64) * faces + counted.listed[:, 1]
        self._filter = [
            warp.array(counted.group.astype(np.int32), dtype=warp.int32, device=device),
            warp.array(counted.counted.astype(np.uint8), dtype=warp.uint8, device=device),
            warp.array(np.sort(keys), dtype=warp.int64, device=device),
        ]
        self.points = torch.zeros((frames, detector.vertex_count, 3), device=device)
        self.pairs = torch.zeros((self.capacity[1], 3), dtype=torch.int32, device=device)
        self.count = torch.zeros(1, dtype=torch.int32, device=device)
        self._doubts = torch.zeros_like(self.pairs)
        self._doubt_count = torch.zeros_like(self.count)
        self._meet = torch.zeros(self.capacity[1], dtype=torch.bool, device=device)
        self.needed = torch.zeros(2, dtype=torch.int32, device=device)
        self._marks = torch.zeros((frames, faces), dtype=torch.int32, device=device)
        self._near = torch.zeros((self.capacity[0], 3), dtype=torch.int32, device=device)
        self._near_count = torch.zeros(1, dtype=torch.int32, device=device)
        # The same memory as Warp arrays.
        self.views = {
            name: warp.from_torch(tensor, dtype=kind)
            for name, tensor, kind in (
                ("points", self.points, warp.vec3f),
                ("pairs", self.pairs, warp.vec3i),
                ("count", self.count, warp.int32),
                ("doubts", self._doubts, warp.vec3i),
                ("doubt_count", self._doubt_count, warp.int32),
                ("meet", self._meet, warp.bool),
                ("marks", self._marks, warp.int32),
                ("near", self._near, warp.vec3i),
                ("near_count", self._near_count, warp.int32),
            )
        }
        self._boxes = detector.box_arrays(frames) if faces else []

    def run(self) -> None:
        """Find the pairs of `points` (B, V, 3), float32; poses of NaN have none, at no cost.

        Call it inside `queue.active()`.
        """
        self._near_count.zero_()
        self.count.zero_()
        self._doubt_count.zero_()
        self._marks.zero_()
        if not len(self.detector.faces):
            return
        from dtrepair.intersect import exact_kernels
        from dtrepair.intersect import fixed_kernels as kernels

        view, launch = self.views, self.queue.launch
        self.detector.fit(view["points"], self._boxes, launch)
        faces, welded, order = self.detector.topology
        self.detector.search(self._boxes, welded, view["near"], view["near_count"], launch)
        candidates = [view["near"], view["near_count"], view["points"]]
        pairs = [view["pairs"], view["count"]]
        doubts = [view["doubts"], view["doubt_count"]]
        inputs = [*candidates, faces, order, *self._filter, *doubts, *pairs]
        launch(kernels.keep_intersecting, self.capacity[:1], inputs)
        inputs = [*doubts, view["points"], faces, view["meet"]]
        launch(exact_kernels.settle, self.capacity[1:], inputs)
        launch(kernels.add_settled, self.capacity[1:], [*doubts, view["meet"], order, *pairs])
        launch(kernels.mark_triangles, self.capacity[1:], [*pairs, view["marks"]])
        found = torch.cat([self._near_count, torch.maximum(self.count, self._doubt_count)])
        torch.maximum(self.needed, found, out=self.needed)

    @property
    def triangles(self) -> Tensor:
        """Number of distinct intersecting triangles of each pose (B,), int64."""
        return self._marks.sum(dim=1)

    def larger_than(self, needed: Sequence[int]) -> tuple[int, int] | None:
        """Return a capacity with room for so many candidates and pairs; None: there is room.

        Raises CollapsedPoseError for more of them than poses may have.
        """
        faces = len(self.detector.faces)
        limits = self.detector.limits.of(faces * self.frames)
        if any(most > limit for most, limit in zip(needed, limits, strict=True)):
            raise collapsed(faces)
        if all(most <= room for most, room in zip(needed, self.capacity, strict=True)):
            return None
        first, second = (max(2 * n, c) for n, c in zip(needed, self.capacity, strict=True))
        return first, second
