"""The published loop on a device: whole iterations without the host, batches, a CUDA graph."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

import torch
from torch import Tensor

from dtrepair.device import DeviceQueue, out_of_memory
from dtrepair.intersect.detector import Detector
from dtrepair.intersect.ignored import CollapsedPoseError, CountedPairs
from dtrepair.repair.paper.descent import NOT_MEASURED, Descent, DescentResult
from dtrepair.repair.paper.gpu_detection import BufferOptions, FixedDetection
from dtrepair.repair.paper.gpu_operators import Forces
from dtrepair.repair.paper.optimizer import start


@dataclass(frozen=True, kw_only=True)
class GpuOptions:
    """How the loop runs on a device.

    Args:
        steps: Iterations in one CUDA graph; the host looks at the outcome after each replay, and
            waits for it: few iterations are wasted, and little time.
        batch: Poses that are worked on at once, as long as memory holds: enough to fill a GPU.
        buffers: Sizes of the buffers of detection.
    """

    steps: int = 10
    batch: int = 64
    buffers: BufferOptions = field(default_factory=BufferOptions)


class DeviceDescent:
    """`Descent` with every iteration on the device of its detector; call it with poses.

    Frames of a batch that are clean, or have diverged, are neither searched nor pushed. On CUDA
    some iterations are one graph. Buffers that overflow are made larger, and a batch that does
    not fit into memory is halved; either starts the batch again, so that no pair is ever missed.
    Pairs are those of `Descent` and points agree to 1e-5 of the size, as all is in double: in
    single precision rounding tips decisions of the optimiser, and after some 20 iterations another
    result, as good, comes out. The same poses in the same batches give the same bits; products of
    matrices of another width round differently. The same launches run on the CPU.

    Args:
        descent: The method; its tensors and operators are those of the device.
        detector: Detector of the same mesh on the device.
        size: What one unit of the poses is in the coordinates that are written and counted.
        counted: Which pairs count; default: all.
        queue: Where to work: the queue of the operators of `descent`.
        capacity: Candidates and pairs that the first buffers hold; default: those of the options.
        options: How the loop runs.

    Raises:
        MemoryError: a single pose does not fit on the device.
        CollapsedPoseError: a pose has more pairs than can be kept.
    """

    def __init__(
        self,
        descent: Descent,
        detector: Detector,
        queue: DeviceQueue,
        *,
        size: float = 1.0,
        counted: CountedPairs | None = None,
        capacity: tuple[int, int] | None = None,
        options: GpuOptions = GpuOptions(),
    ) -> None:
        self.descent, self.detector, self.counted = descent, detector, counted
        self.size, self.capacity, self.options = size, capacity, options
        self.batch = options.batch  # fewer where memory does not hold them
        self.queue = queue
        self.forces = Forces(descent)
        self._loop: _Loop | None = None

    def __call__(self, points: Tensor) -> DescentResult:
        """Repair poses (B, V, 3), float64; frames are independent of each other."""
        parts: list[DescentResult] = []
        first = 0
        while first < len(points):
            own = points[first : first + self.batch]
            shortage = None
            try:
                parts.append(self._solved(own))
                first += len(own)
            except RuntimeError as error:
                self._drop_loop()
                if not out_of_memory(error):
                    raise
                # The traceback holds tensors, whose memory is to be freed.
                shortage = error.with_traceback(None)
            if shortage is not None:
                if len(own) == 1:
                    raise too_large("a single pose", self.detector) from shortage
                self.batch = len(own) // 2
                with suppress(RuntimeError):  # a build without CUDA has no cache
                    torch.cuda.empty_cache()
        return _joined(parts, points)

    def _solved(self, points: Tensor) -> DescentResult:
        """Solve a batch, again with larger buffers until they do."""
        while True:
            # Never a wider one: its products would round differently.
            if self._loop is None or self._loop.frames != len(points):
                self._drop_loop()
                self._loop = _Loop(self, len(points), self.capacity)
            loop = self._loop
            try:
                with self.queue.active():
                    loop.load(points)
                    while not loop.done and loop.larger is None:
                        loop.advance()
                    if loop.larger is None:
                        return loop.result(points)
            except CollapsedPoseError:
                self._drop_loop()  # it keeps the most that was needed
                raise
            self.capacity = loop.larger
            del loop
            self._drop_loop()

    def _drop_loop(self) -> None:
        """Free the memory of the loop, before another one takes some."""
        if self._loop is not None:
            self._loop.graph = None  # it refers to the loop
            self._loop = None


class _Loop:
    """Everything of one batch in fixed places, and the launches of an iteration."""

    def __init__(
        self, method: DeviceDescent, frames: int, capacity: tuple[int, int] | None
    ) -> None:
        descent, self.method, self.frames = method.descent, method, frames
        self.detection = FixedDetection(
            method.detector,
            frames,
            method.queue,
            counted=method.counted,
            capacity=capacity,
            options=method.options.buffers,
        )
        self.device = torch.device(method.detector.device)
        shape = (frames, method.detector.vertex_count, 3)
        self.origin = torch.zeros(shape, dtype=torch.float64, device=self.device)
        self.points, self.best, self.target = (torch.zeros_like(self.origin) for _ in range(3))
        self.moments = start(self.origin)
        self.iteration = torch.zeros((), dtype=torch.int64, device=self.device)
        self.alive = torch.zeros(frames, dtype=torch.bool, device=self.device)
        self.diverged = self.alive.clone()
        self.fewest = torch.zeros(frames, dtype=torch.int64, device=self.device)
        self.chosen = self.fewest.clone()
        # One row more than iterations takes what is measured after the last.
        self.history = torch.zeros(
            (descent.iterations + 2, frames), dtype=torch.int64, device=self.device
        )
        self.larger: tuple[int, int] | None = None
        self.graph: Callable[[], None] | None = None
        # What was uploaded is there before a queue of its own asks for it.
        method.queue.wait()

    def load(self, points: Tensor) -> None:
        """Begin with poses (N, V, 3), N at most the number of frames; the others only wait."""
        count, descent = len(points), self.method.descent
        self.origin[:count] = points
        self.points.copy_(self.origin)
        self.best.copy_(self.origin)
        self.target.copy_(descent.laplacian(self.origin))
        for tensor in (*self.moments, self.iteration, self.chosen):
            tensor.zero_()
        self.alive.zero_()
        self.alive[:count] = True
        self.diverged.zero_()
        self.fewest.fill_(len(descent.faces) + 1)
        self.history.fill_(NOT_MEASURED)
        self.done = False

    def advance(self) -> None:
        """Run some iterations, as one graph on CUDA; then see what became of them.

        done: no frame goes on; larger: the capacity that it takes, where buffers were too small.
        """
        if self.graph is None:
            self.iterate()  # readies all that a graph calls
            self.graph = self.method.queue.repeated(self.iterate, self.method.options.steps)
        self.graph()
        alive, *needed = torch.cat([self.alive.any()[None].int(), self.detection.needed]).tolist()
        self.larger = self.detection.larger_than(needed)
        self.done = not alive

    def iterate(self) -> None:
        """Measure all frames that go on, keep what is better, and make a step."""
        descent, last = self.method.descent, self.method.descent.iterations
        # NaN fails the comparison.
        sound = (self.points - self.origin).abs().amax(dim=(1, 2)) <= descent.runaway
        self.diverged |= self.alive & ~sound
        self.alive &= sound
        alive = self.alive[:, None, None]
        # Rounded as on the CPU; frames that wait are nowhere, which leaves nothing to search.
        written = self.points * self.method.size
        self.detection.points.copy_(written.masked_fill(~alive, torch.nan))
        self.detection.run()
        triangles = self.detection.triangles
        row = triangles.masked_fill(~self.alive, NOT_MEASURED)
        self.history.index_copy_(0, self.iteration.clamp(max=last + 1)[None], row[None])
        better = self.alive & (triangles < self.fewest)
        self.best.copy_(torch.where(better[:, None, None], self.points, self.best))
        self.fewest.copy_(torch.where(better, triangles, self.fewest))
        self.chosen.copy_(torch.where(better, self.iteration, self.chosen))
        self.alive &= (triangles > 0) & (self.iteration < last)
        gradient = self.method.forces(self.points, self.detection, self.alive)
        step, moments = descent.move(self.points, gradient, self.target, self.moments)
        going = self.alive[:, None, None]
        self.points.copy_(torch.where(going, self.points - step, self.points))
        for old, new in zip(self.moments, moments, strict=True):
            old.copy_(new)
        self.iteration += 1

    def result(self, points: Tensor) -> DescentResult:
        """Return the outcome for the poses (N, V, 3) that were loaded, on their device."""
        count, home = len(points), points.device

        def taken(tensor: Tensor) -> Tensor:
            return tensor[..., :count].to(home, copy=True)

        history = taken(self.history[:-1])
        rows = int((history != NOT_MEASURED).any(dim=1).sum())
        measured = (history != NOT_MEASURED).any(dim=0)
        return DescentResult(
            self.best[:count].to(home, copy=True),
            torch.where(measured, taken(self.fewest), NOT_MEASURED),
            taken(self.chosen),
            taken(self.diverged),
            history[:rows],
        )


def too_large(what: str, detector: Detector) -> MemoryError:
    """Return the error where something does not fit on a device."""
    return MemoryError(
        f"{what} of {len(detector.faces)} triangles should fit into the memory of "
        f"{detector.device}, but does not: free memory there, or use device 'cpu'"
    )


def _joined(parts: list[DescentResult], points: Tensor) -> DescentResult:
    """Return the results of batches as one; shorter histories are filled up."""
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
