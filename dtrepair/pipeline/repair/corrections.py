"""Corrections instead of points: blend shapes on the rig, or offsets alone, over the input."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import diagonal
from dtrepair.numerics.low_rank import fewest_shapes
from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.observer import CorrectionWritten, Observer
from dtrepair.pipeline.stages.frames import Frame, placed_frame, read_frame, told_size
from dtrepair.pipeline.stages.sinks import refuse_instances
from dtrepair.pipeline.stages.sources import Source, StageSource, is_stage

if TYPE_CHECKING:
    from usd_io.write.corrections import Correction

# Shapes give the repaired points to this part of the diagonal of their mesh.
TOLERANCE = 1e-4


@dataclass
class _Moved:
    """What is added to one mesh, frame by frame: vertices, offsets (N, 3), and stretches (N,)."""

    vertices: list[NDArray[np.int64]] = field(default_factory=list)
    offsets: list[NDArray[np.float32]] = field(default_factory=list)
    stretches: list[NDArray[np.float32]] = field(default_factory=list)
    times: list[float] = field(default_factory=list)

    def add(
        self, time: float, offsets: NDArray[np.floating], stretches: NDArray[np.floating]
    ) -> None:
        """Take the offsets (V, 3) of a frame, and how much joints stretch them (V,).

        They replace those that the frame had.
        """
        rows = np.flatnonzero(offsets.any(axis=1))
        if _key(time) in map(_key, self.times):
            old = [_key(other) for other in self.times].index(_key(time))
            for part in (self.times, self.vertices, self.offsets, self.stretches):
                del part[old]
        self.times.append(time)
        self.vertices.append(rows)
        self.offsets.append(offsets[rows].astype(np.float32))
        self.stretches.append(stretches[rows].astype(np.float32))

    def together(self) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.float32]]:
        """All vertices that ever move (M,), offsets (T, M, 3) and largest stretches (T, M)."""
        vertices = np.unique(np.concatenate([np.zeros(0, np.int64), *self.vertices]))
        offsets = np.zeros((len(self.times), len(vertices), 3), np.float32)
        stretches = np.zeros(offsets.shape[:2], np.float32)
        for row, own in enumerate(self.vertices):
            place = np.searchsorted(vertices, own)
            offsets[row, place], stretches[row, place] = self.offsets[row], self.stretches[row]
        # Where a vertex is at its place it must be left there: as if stretched as ever.
        largest = stretches.max(axis=0, initial=0.0)
        return vertices, offsets, np.where(stretches > 0.0, stretches, largest)


def _key(time: float) -> float | None:
    """A time that equals itself: None for the default time."""
    return None if np.isnan(time) else time


class CorrectionSink:
    """Collects what a repair moves, in memory; a layer over the stage at the end, or nothing."""

    def __init__(self, source: Source, path: str, settings: dict[str, Any], form: str) -> None:
        """Check the output, before anything is computed; form: "shapes" or "offsets"."""
        from usd_io import input_digest
        from usd_io.paths import check_output_path
        from usd_io.read.stages import check_not_an_input
        from usd_io.write.corrections import check_correctable

        if not isinstance(source, StageSource):
            option = "--shapes" if form == "shapes" else "--delta"
            raise UsageError(f"{option}: only for USD stages, and {source.name} is a mesh file")
        if not is_stage(path):
            raise UsageError(f"{path}: the output is a layer; name a .usd, .usdc or .usda file")
        refuse_instances(source)
        check_output_path(path)
        check_not_an_input(source.opened.stage, path)
        for mesh in source.meshes:
            if form == "shapes" and not mesh.collider:
                check_correctable(mesh.handle)
        self.form = form
        self._source, self._settings, self.path = source, settings, path
        self._moved = [_Moved() for _ in source.meshes]
        self._digest = input_digest(source.opened)
        self._corrections: list[Correction] | None = None
        self._error = 0.0
        self._size: float | None = None
        self._warnings: list[str] = []

    def put(self, index: int, time: float, points: NDArray[np.float32] | None) -> None:
        """Take local points (V, 3) of a mesh; None: it is as the input has it."""
        from usd_io import FrameError
        from usd_io.read.bind_space import bind_offsets

        if points is None:
            return
        mesh = self._source.meshes[index]
        if self.form == "shapes":
            try:
                offsets, stretches = bind_offsets(mesh.handle, time, points)
            except FrameError as error:
                self._warnings.append(f"{error}; the frame is left as it was")
                return
        else:
            old = self._source.read(mesh, time)
            offsets = np.asarray(points, np.float64) - np.asarray(old, np.float64)
            stretches = np.ones(len(offsets))
        self._moved[index].add(time, offsets, stretches)

    def settle(self, tolerance: float = TOLERANCE) -> None:
        """Find shapes that leave no vertex farther off than a part of the diagonal of its mesh."""
        self._corrections, self._error, self._size, self._least = [], 0.0, None, 0
        for mesh, moved in zip(self._source.meshes, self._moved, strict=True):
            vertices, offsets, stretches = moved.together()
            if not len(vertices):
                continue
            size = diagonal(mesh.rest) or 1.0
            times, shapes, weights = moved.times, offsets, np.eye(len(offsets), dtype=np.float32)
            if self.form == "shapes":
                found = fewest_shapes(offsets, tolerance * size, scales=stretches)
                left = np.linalg.norm(found.displacements - offsets, axis=2) * stretches
                error = float(left.max()) / size
                if error >= self._error:
                    time = moved.times[0]
                    self._error, self._size = error, told_size(self._source, mesh, time, mesh.rest)
                shapes, weights = found.shapes, found.weights
                self._least += found.least
            self._corrections.append(
                self._held(mesh.handle, vertices, np.array(times), shapes, weights)
            )

    def _held(
        self,
        mesh: Any,
        vertices: NDArray[np.int64],
        times: NDArray[np.float64],
        shapes: NDArray[np.float32],
        weights: NDArray[np.float32],
    ) -> Correction:
        """A correction that is zero in the frames just before and after those it is for."""
        from usd_io.write.corrections import Correction

        beside = np.zeros(0)
        if not np.isnan(times).any():
            beside = np.array(sorted(self._source.clock.beside(times) - set(times.tolist())))
        every = np.concatenate([times, beside])
        order = np.argsort(every)
        if self.form == "offsets":
            still = np.zeros((len(beside), *shapes.shape[1:]), np.float32)
            shapes = np.concatenate([shapes, still])[order]
        weights = np.concatenate([weights, np.zeros((len(beside), weights.shape[1]), np.float32)])
        return Correction(mesh, vertices, shapes, every[order], weights[order])

    def posed(self, times: Sequence[float]) -> Iterator[Frame]:
        """Yield those of the frames that are corrected, posed by the stage as it will be."""
        from usd_io.write.corrections import points_of, preview

        assert self._corrections is not None
        stage = preview(self._source.opened, self._corrections)
        moved = {own.mesh.path for own in self._corrections}
        wanted = {_key(time) for own in self._moved for time in own.times}
        for time in times:
            frame = read_frame(self._source, time) if _key(time) in wanted else None
            if frame is None or not frame.usable:
                continue
            points = list(frame.points)
            for index, mesh in enumerate(self._source.meshes):
                if mesh.path in moved:
                    own = points_of(stage, mesh.path, time)
                    assert own is not None
                    points[index] = own
            yield placed_frame(self._source, time, points)

    def commit(self, record: dict[str, Any]) -> tuple[str, ...]:
        """Write the layer."""
        from dtrepair import __version__
        from usd_io.write.corrections import write_corrections, write_offsets

        if self._corrections is None:
            self.settle()
        assert self._corrections is not None
        write = write_corrections if self.form == "shapes" else write_offsets
        own = {"version": __version__, "settings": self._settings, "form": self.form}
        whole = {**own, "input_digest": self._digest, **record}
        write(self.path, self._source.opened, self._corrections, record=whole)
        return tuple(self._warnings)

    def tell(self, observer: Observer) -> None:
        """Tell what was written, and how large it is."""
        assert self._corrections is not None
        number = sum(len(own.shapes) for own in self._corrections)
        if self.form == "offsets":  # of several meshes in one frame
            number = len(np.unique([time for own in self._corrections for time in own.times]))
        observer.remark(
            CorrectionWritten(
                form=self.form,
                shapes=number,
                vertices=sum(len(own.vertices) for own in self._corrections),
                bytes=os.path.getsize(self.path),
                error=self._error,
                size=self._size,
                least=self._least,
            )
        )

    def abort(self) -> None:
        """Nothing was written yet."""
