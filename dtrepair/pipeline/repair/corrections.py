"""Corrections instead of points: blend shapes on the rig, or offsets alone, over the input."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import diagonal
from dtrepair.numerics.low_rank import fewest_shapes
from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.observer import CorrectionWritten, Observer
from dtrepair.pipeline.stages.frames import Frame, frame_time, read_frame
from dtrepair.pipeline.stages.sources import Source, StageSource, is_stage
from dtrepair.report.record import ContactRecord, FrameRecord
from dtrepair.wording import counted, listed

if TYPE_CHECKING:
    from dtrepair.intersect.scene_counts import SceneCount, SceneCounter
    from usd_io.write.corrections import Correction

# Shapes give the repaired points to this part of the diagonal of their mesh. Where that makes
# surfaces touch that were apart, it is tried again with the smaller ones: more shapes, less error.
TOLERANCES = (1e-4, 1e-5, 1e-6)


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
        """Take the offsets (V, 3) of a frame, and how much joints stretch them (V,)."""
        rows = np.flatnonzero(offsets.any(axis=1))
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


class CorrectionSink:
    """Collects what a repair moves, in memory; a layer over the stage at the end, or nothing."""

    def __init__(self, source: Source, path: str, settings: dict[str, Any], form: str) -> None:
        """Check the output, before anything is computed; form: "shapes" or "offsets"."""
        from usd_io.paths import check_output_path
        from usd_io.read.stages import check_not_an_input
        from usd_io.write.corrections import check_correctable

        if not isinstance(source, StageSource):
            option = "--shapes" if form == "shapes" else "--delta"
            raise UsageError(f"{option}: only for USD stages, and {source.name} is a mesh file")
        if not is_stage(path):
            raise UsageError(f"{path}: the output is a layer; name a .usd, .usdc or .usda file")
        check_output_path(path)
        check_not_an_input(source.opened.stage, path)
        for mesh in source.meshes:
            if form == "shapes" and not mesh.collider:
                check_correctable(mesh.handle)
        self.form = form
        self._source, self._path, self._settings = source, path, settings
        self._moved = [_Moved() for _ in source.meshes]
        self._corrections: list[Correction] | None = None
        self._error = 0.0
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

    def settle(self, tolerance: float = TOLERANCES[0]) -> None:
        """Find shapes that leave no vertex farther off than a part of the diagonal of its mesh."""
        self._corrections, self._error = [], 0.0
        for mesh, moved in zip(self._source.meshes, self._moved, strict=True):
            vertices, offsets, stretches = moved.together()
            if not len(vertices):
                continue
            size = diagonal(mesh.rest) or 1.0
            times, shapes, weights = moved.times, offsets, np.eye(len(offsets), dtype=np.float32)
            if self.form == "shapes":
                found = fewest_shapes(offsets, tolerance * size, scales=stretches)
                left = np.linalg.norm(found.displacements - offsets, axis=2) * stretches
                self._error = max(self._error, float(left.max()) / size)
                shapes, weights = found.shapes, found.weights
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

    def recounted(
        self, counter: SceneCounter, records: Sequence[FrameRecord]
    ) -> tuple[list[FrameRecord], list[str]]:
        """Count again with the shapes as they will be written; settle on how near they must come.

        Returns the records as the output deserves them, and warnings.
        """
        if self.form != "shapes":
            self.settle()
            return list(records), []
        found: dict[float | None, SceneCount] = {}
        worse: list[FrameRecord] = []
        for tolerance in TOLERANCES:
            self.settle(tolerance)
            found = self._counts(counter, records)
            worse = [
                record
                for record in records
                if record.time in found
                and record.after is not None
                and found[record.time].total.pairs > record.after.pairs
            ]
            if not worse:
                break
        changed = {record.time: self._worse(record, found[record.time]) for record in worse}
        if not worse:
            return list(records), []
        times = listed([f"{record.time:.10g}" for record in worse if record.time is not None])
        return [changed.get(record.time, record) for record in records], [
            f"{self._path}: with shapes instead of points {counted(len(worse), 'frame')} "
            f"({times or 'default'}) intersect again; --clearance leaves room for their rounding"
        ]

    def _counts(
        self, counter: SceneCounter, records: Sequence[FrameRecord]
    ) -> dict[float | None, SceneCount]:
        """Counts of the frames that have corrections, posed by the stage as it will be."""
        from usd_io.write.corrections import points_of, preview

        assert self._corrections is not None
        stage = preview(self._source.opened, self._corrections)
        moved = {own.mesh.path: own for own in self._corrections}
        wanted = {time for own in self._moved for time in own.times}
        found: dict[float | None, SceneCount] = {}
        for record in records:
            time = np.nan if record.time is None else record.time
            if record.after is None or not (time in wanted or (record.time is None and wanted)):
                continue
            frame = read_frame(self._source, time)
            if not frame.usable:
                continue
            spaces = list(frame.spaces)
            for index, mesh in enumerate(self._source.meshes):
                if mesh.path not in moved:
                    continue
                points = points_of(stage, mesh.path, time)
                assert points is not None
                several = len(self._source.meshes) > 1
                spaces[index] = self._source.to_world(mesh, time, points) if several else points
            found[frame_time(Frame(time))] = counter(spaces)
        return found

    def _worse(self, record: FrameRecord, count: SceneCount) -> FrameRecord:
        """The record of a frame of which fewer intersections went than of its points."""
        assert record.before is not None
        paths = [mesh.path for mesh in self._source.meshes]
        own = dict(zip(paths, count.each, strict=True))
        prims = tuple(replace(prim, after=own[prim.path]) for prim in record.prims)
        met = {(paths[i], paths[j]): pairs for (i, j), pairs in count.met.items()}
        known = {(old.first, old.second): old for old in record.contacts}
        contacts = [
            replace(known.get(key, ContactRecord(key[0], key[1], 0, 0)), after=met.get(key, 0))
            for key in sorted({*known, *(met if len(paths) > 1 else ())})
        ]
        better = count.total.pairs < record.before.pairs
        return replace(
            record,
            status="improved" if better else "unchanged",
            after=count.total,
            prims=prims,
            contacts=tuple(contacts),
            message=record.message or "the shapes of the output come near, and not near enough",
        )

    def commit(self, record: dict[str, Any]) -> tuple[str, ...]:
        """Write the layer."""
        from dtrepair import __version__
        from usd_io.write.corrections import write_corrections, write_offsets

        if self._corrections is None:
            self.settle()
        assert self._corrections is not None
        write = write_corrections if self.form == "shapes" else write_offsets
        whole = {"version": __version__, "settings": self._settings, "form": self.form, **record}
        write(self._path, self._source.opened, self._corrections, record=whole)
        return tuple(self._warnings)

    def tell(self, observer: Observer) -> None:
        """Tell what was written, and how large it is."""
        assert self._corrections is not None
        observer.remark(
            CorrectionWritten(
                form=self.form,
                shapes=sum(len(own.shapes) for own in self._corrections),
                vertices=sum(len(own.vertices) for own in self._corrections),
                bytes=os.path.getsize(self._path),
                error=self._error,
            )
        )

    def abort(self) -> None:
        """Nothing was written yet."""
