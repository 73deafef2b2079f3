"""The published loop on a device: whole iterations without the host, batches, a CUDA graph."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np
import torch
from torch import Tensor

from dtrepair.device import start_warp
from dtrepair.geometry import FloatArray
from dtrepair.intersect.detector import Detector
from dtrepair.intersect.ignored import CountedPairs
from dtrepair.repair.descent import NOT_MEASURED, RUNAWAY, Descent, DescentResult
from dtrepair.repair.device_operators import Forces
from dtrepair.repair.fixed_detection import FixedDetection
from dtrepair.repair.optimizer import start

# Iterations in one CUDA graph: the host looks at the outcome after each replay.
STEPS = 10
# Poses that are worked on at once, as long as memory holds.
BATCH = 64


class DeviceDescent:
    """`Descent` with every iteration on the device of its detector; call it with poses.

    Frames of a batch that are clean, or have diverged, wait at the rest pose until all are. On CUDA
    `STEPS` iterations are one graph. Buffers that overflow are made larger, and a batch that does
    not fit into memory is halved; either starts the batch again, so that no pair is ever missed.
    The same poses in the same batches give the same bits; products of matrices of another width
    round differently. The same launches run on the CPU.

    Args:
        descent: The method; its tensors and operators are those of the device.
        detector: Detector of the same mesh on the device.
        rest: A pose (V, 3) with few intersections, where frames wait; units of `size`.
        size: What one unit of the poses is in the coordinates that are written and counted.
        counted: Which pairs count; default: all.
        dtype: Of the poses between iterations.
    """

    def __init__(
        self,
        descent: Descent,
        detector: Detector,
        *,
        rest: FloatArray,
        size: float = 1.0,
        counted: CountedPairs | None = None,
        dtype: torch.dtype = torch.float32,
        batch: int = BATCH,
        capacity: tuple[int, int] | None = None,
    ) -> None:
        """Keep the parts; see the class. capacity: what the buffers of a batch hold at first."""
        self.descent, self.detector, self.counted = descent, detector, counted
        self.rest, self.size, self.dtype = rest, size, dtype
        self.batch, self.capacity = batch, capacity
        self.forces = Forces(descent, detector)
        self._loop: _Loop | None = None

    def __call__(self, points: Tensor) -> DescentResult:
        """Repair poses (B, V, 3), float64; what does not move keeps every bit.

        torch.OutOfMemoryError if a single pose does not fit.
        """
        parts: list[DescentResult] = []
        first = 0
        while first < len(points):
            own = points[first : first + self.batch]
            try:
                parts.append(self._solved(own))
                first += len(own)
            except torch.OutOfMemoryError:
                if self.batch == 1 or len(own) == 1:
                    raise
                self._loop = None
                self.batch = len(own) // 2
                with suppress(RuntimeError):  # a build without CUDA has no cache
                    torch.cuda.empty_cache()
        return _joined(parts, points)

    def _solved(self, points: Tensor) -> DescentResult:
        """A batch, again with larger buffers until they do."""
        while True:
            if self._loop is None or self._loop.frames < len(points):
                self._loop = _Loop(self, len(points), self.capacity)
            loop = self._loop
            loop.load(points)
            while not loop.done and loop.fits:
                loop.advance()
            if loop.fits:
                return loop.result(points)
            self.capacity = loop.detection.overflow()
            self._loop = None


class _Loop:
    """Everything of one batch in fixed places, and the launches of an iteration."""

    def __init__(
        self, method: DeviceDescent, frames: int, capacity: tuple[int, int] | None
    ) -> None:
        descent, self.method, self.frames = method.descent, method, frames
        self.detection = FixedDetection(
            method.detector, frames, counted=method.counted, capacity=capacity
        )
        self.device = torch.device(method.detector.device)
        rest = torch.from_numpy(np.ascontiguousarray(method.rest)).to(self.device)
        self.parked = (rest * method.size).float()
        zeros = torch.zeros(frames, *rest.shape, dtype=method.dtype, device=self.device)
        self.origin, self.shift, self.best = zeros.clone(), zeros.clone(), zeros.clone()
        self.target = zeros.clone()
        self.written = self.parked.repeat(frames, 1, 1)
        self.moments = start(zeros)
        self.iteration = torch.zeros((), dtype=torch.int64, device=self.device)
        self.alive = torch.zeros(frames, dtype=torch.bool, device=self.device)
        self.diverged = self.alive.clone()
        self.fewest = torch.zeros(frames, dtype=torch.int64, device=self.device)
        self.chosen = self.fewest.clone()
        # One row more than iterations takes what is measured after the last.
        self.history = torch.zeros(
            (descent.iterations + 2, frames), dtype=torch.int64, device=self.device
        )
        self._replay = self._captured() if self.device.type == "cuda" else self._eagerly

    def load(self, points: Tensor) -> None:
        """Begin with poses (N, V, 3), N at most the number of frames; the others only wait."""
        count, descent = len(points), self.method.descent
        origin = points.to(self.device, self.method.dtype)
        self.origin[:count] = origin
        self.written[:count] = (points * self.method.size).float().to(self.device)
        self.target[:count] = descent.laplacian(origin)
        for tensor in (self.shift, self.best, *self.moments, self.iteration, self.chosen):
            tensor.zero_()
        self.alive.zero_()
        self.alive[:count] = True
        self.diverged.zero_()
        self.detection.needed.zero_()
        self.fewest.fill_(len(descent.faces) + 1)
        self.history.fill_(NOT_MEASURED)
        self.done = False

    @property
    def fits(self) -> bool:
        """Whether all pairs so far had room."""
        return self.detection.overflow() is None

    def advance(self) -> None:
        """`STEPS` iterations, as one graph on CUDA; then see whether any frame goes on."""
        self._replay()
        self.done = not bool(self.alive.any())

    def iterate(self) -> None:
        """Measure all frames that go on, keep what is better, and make a step."""
        descent, last = self.method.descent, self.method.descent.iterations
        points = self.origin + self.shift
        # NaN fails the comparison.
        sound = (points - self.origin).abs().amax(dim=(1, 2)) <= RUNAWAY
        self.diverged |= self.alive & ~sound
        self.alive &= sound
        alive = self.alive[:, None, None]
        moved = (self.written + self.shift * self.method.size).float()
        self.detection.points.copy_(torch.where(alive, moved, self.parked))
        self.detection.run()
        triangles = self.detection.triangles
        row = torch.where(self.alive, triangles, NOT_MEASURED)
        self.history.index_copy_(0, self.iteration.clamp(max=last + 1)[None], row[None])
        better = self.alive & (triangles < self.fewest)
        self.best.copy_(torch.where(better[:, None, None], self.shift, self.best))
        self.fewest.copy_(torch.where(better, triangles, self.fewest))
        self.chosen.copy_(torch.where(better, self.iteration, self.chosen))
        self.alive &= (triangles > 0) & (self.iteration < last)
        gradient = self.method.forces(points, self.detection, self.alive)
        step, moments = descent.move(points, gradient, self.target, self.moments)
        going = self.alive[:, None, None]
        self.shift.copy_(torch.where(going, self.shift - step, self.shift))
        for old, new in zip(self.moments, moments, strict=True):
            old.copy_(new)
        self.iteration += 1

    def result(self, points: Tensor) -> DescentResult:
        """The outcome for the poses (N, V, 3) that were loaded, on their device."""
        count, home = len(points), points.device

        def taken(tensor: Tensor) -> Tensor:
            return tensor[..., :count].to(home, copy=True)

        history = taken(self.history[:-1])
        rows = int((history != NOT_MEASURED).any(dim=1).sum())
        measured = (history != NOT_MEASURED).any(dim=0)
        best = self.best[:count].to(home, points.dtype)
        return DescentResult(
            torch.where(best != 0, points + best, points),
            torch.where(measured, taken(self.fewest), NOT_MEASURED),
            taken(self.chosen),
            taken(self.diverged),
            history[:rows],
        )

    def _eagerly(self) -> None:
        for _ in range(STEPS):
            self.iterate()

    def _captured(self) -> Callable[[], None]:
        """Replays a CUDA graph of `STEPS` iterations; recorded while all frames wait."""
        warp = start_warp()
        stream = torch.cuda.Stream(device=self.device)
        stream.wait_stream(torch.cuda.current_stream(self.device))
        graph = torch.cuda.CUDAGraph()
        with warp.ScopedStream(warp.stream_from_torch(stream)):
            with torch.cuda.stream(stream):
                self.iterate()  # loads kernels and workspaces, which a capture may not
            with torch.cuda.graph(graph, stream=stream):
                warp.capture_begin(force_module_load=False, external=True)
                try:
                    self._eagerly()
                finally:
                    warp.capture_end()
        torch.cuda.current_stream(self.device).wait_stream(stream)
        return lambda: graph.replay()


def _joined(parts: list[DescentResult], points: Tensor) -> DescentResult:
    """Results of batches as that of all poses; shorter histories are filled up."""
    if not parts:
        none = torch.zeros(0, dtype=torch.int64)
        return DescentResult(points.clone(), none, none, none.bool(), none.reshape(0, 0))
    rows = max(len(part.history) for part in parts)
    histories = []
    for part in parts:
        history = part.history.new_full((rows, part.history.shape[1]), NOT_MEASURED)
        history[: len(part.history)] = part.history
        histories.append(history)
    return DescentResult(
        torch.cat([part.points for part in parts]),
        torch.cat([part.triangles for part in parts]),
        torch.cat([part.iterations for part in parts]),
        torch.cat([part.diverged for part in parts]),
        torch.cat(histories, dim=1),
    )
