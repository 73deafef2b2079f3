"""Source frames in, frames of the target out; pins, and figures of the whole."""

from __future__ import annotations

import time as clock
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.errors import InputError
from dtrepair.pipeline.repair.solve import Repaired
from dtrepair.pipeline.stages.bodies import read_pins
from dtrepair.pipeline.stages.frames import Frame, count_frame, frame_time, read_frames, unusable
from dtrepair.pipeline.stages.sources import MeshSource
from dtrepair.pipeline.transfer.correspondence import read_arrays
from dtrepair.pipeline.transfer.inputs import input_errors
from dtrepair.pipeline.transfer.pair import JoinedMeshes, Pair
from dtrepair.report.record import FramePrimRecord, FrameRecord

if TYPE_CHECKING:
    from dtrepair.intersect.scene_counts import SceneCounter
    from dtrepair.transfer import Transfer, TransferReport

_SAMPLES = 48  # frames that the figures of a clip are taken from


@dataclass(frozen=True)
class PinSet:
    """Target vertices (P,) held at positions (P, 3), or (T, P, 3) with NaN where free."""

    vertices: NDArray[np.int64]
    positions: NDArray[np.float64]

    def at(self, frame: int) -> NDArray[np.float64]:
        """Return positions (P, 3) in a frame."""
        return self.positions if self.positions.ndim == 2 else self.positions[frame]

    def mask(self, count: int) -> NDArray[np.float64]:
        """Return weights (V,): 1 at the pins, 0 elsewhere."""
        weights = np.zeros(count)
        weights[self.vertices] = 1.0
        return weights


def read_pin_set(target: JoinedMeshes, option: str | None, frame_count: int) -> PinSet | None:
    """Read --pin: an npz of vertices and positions, or a primvar or GeomSubset held at rest."""
    if option is None:
        return None
    rest = target.points
    if not option.lower().endswith(".npz"):
        if isinstance(target.source, MeshSource):
            raise InputError(
                f"--pin {option}: a mesh file has no primvars: name an npz of vertices"
            )
        weights = read_pins(target.source, option)
        parts = [
            np.zeros(len(own.points)) if weight is None else weight
            for weight, own in zip(weights, target.rests, strict=True)
        ]
        together = np.concatenate([parts[index] for index in target.moving])
        vertices = np.flatnonzero(together >= 0.5)
        return PinSet(vertices, rest[vertices])
    content = read_arrays(option, "vertices")
    vertices = content["vertices"]
    if vertices.ndim != 1 or vertices.min(initial=0) < 0 or vertices.max(initial=0) >= len(rest):
        raise InputError(
            f"--pin {option}: vertices should be indices (P,) below {len(rest)}, got "
            f"{vertices.shape} up to {vertices.max(initial=0)}"
        )
    positions = np.asarray(content.get("positions", rest[vertices.astype(np.int64)]))
    shapes = ((len(vertices), 3), (frame_count, len(vertices), 3))
    if positions.shape not in shapes:
        raise InputError(
            f"--pin {option}: positions should have shape {shapes[0]} or {shapes[1]}, got "
            f"{positions.shape}"
        )
    return PinSet(vertices, positions.astype(np.float64))


@dataclass
class FrameTransfer:
    """Transfers the frames of a source, keeping some for `examine`."""

    transfer: Transfer
    pair: Pair
    pins: PinSet | None = None
    samples: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=lambda: {"read": 0.0, "transfer": 0.0})

    def __post_init__(self) -> None:
        """Prepare the pins: one back-substitution each."""
        from dtrepair.transfer import Pins

        self._hold: Pins | None = None
        if self.pins is not None:
            with input_errors(prefix="--pin: "):
                self._hold = Pins(self.transfer, self.pins.vertices)

    def frames(self) -> Iterator[Frame]:
        """Yield frames of the target: local points (V, 3) float32; unusable ones stay unusable."""
        source = self.pair.source
        times = source.times
        looked_at = set(np.linspace(0, len(times) - 1, min(_SAMPLES, len(times))).astype(int))
        start = clock.perf_counter()
        for index, frame in enumerate(read_frames(source, times)):
            middle = clock.perf_counter()
            self.seconds["read"] += middle - start
            moved = self._moved(index, frame, index in looked_at) if frame.usable else frame
            self.seconds["transfer"] += clock.perf_counter() - middle
            yield moved
            start = clock.perf_counter()

    def _moved(self, index: int, frame: Frame, keep: bool) -> Frame:
        from usd_io import FrameError

        pair = self.pair
        try:
            pose = pair.axes.pose(pair.source, frame.time, pair.from_meshes.pose(frame))
            points = self._points(index, pose)
            moved = pair.to_meshes.frame(frame.time, points)
        except (FrameError, ValueError) as error:
            return replace(frame, points=(), spaces=(), failure=str(error))
        if keep:
            self.samples.append((pose, points))
        return moved

    def _points(self, index: int, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        if self._hold is None or self.pins is None:
            return np.asarray(self.transfer(pose))
        return np.asarray(self._hold(pose, self.pins.at(index)))

    def examined(self) -> TransferReport | None:
        """Return the figures over the frames that were kept; None if none was usable."""
        from dtrepair.transfer import examine

        if not self.samples:
            return None
        poses, points = (np.stack(part) for part in zip(*self.samples, strict=True))
        return examine(self.transfer, poses, points)


def counted_frames(
    frames: Iterable[Frame], target: JoinedMeshes, counter: SceneCounter
) -> Iterator[Repaired]:
    """Count the intersections of frames and leave them as they are."""
    meshes = target.source.meshes
    unchanged = (None,) * len(meshes)
    for given in frames:
        start = clock.perf_counter()
        frame, found = count_frame(counter, given)
        seconds = clock.perf_counter() - start
        if found is None:
            yield Repaired(frame, unchanged, frame.spaces, unusable(frame), {})
            continue
        count = found.total
        record = FrameRecord(
            time=frame_time(frame),
            status="unchanged" if count.pairs else "clean",
            before=count,
            after=count,
            seconds=seconds,
            prims=tuple(
                FramePrimRecord(path=mesh.path, before=own, after=own)
                for mesh, own in zip(meshes, found.each, strict=True)
            ),
        )
        yield Repaired(frame, unchanged, frame.spaces, record, {"detect": seconds})
