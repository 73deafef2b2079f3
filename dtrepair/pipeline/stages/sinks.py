"""Where repaired points go: a layer over the input stage, or a mesh file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.errors import InputError, UsageError
from dtrepair.pipeline.stages.outputs import check_writable, refuse_overwriting, writing
from dtrepair.pipeline.stages.sources import MeshSource, Source, StageSource, is_stage


class Sink(Protocol):
    """An output that appears whole with `commit`, or not at all."""

    def put(self, index: int, time: float, points: NDArray[np.float32] | None) -> None:
        """Take local points (V, 3) of mesh `index`; None keeps the input's."""

    def commit(self, record: dict[str, Any]) -> tuple[str, ...]:
        """Write; returns warnings."""

    def abort(self) -> None:
        """Drop everything; an older output stays as it was."""


def open_sink(
    source: Source,
    path: str,
    settings: dict[str, Any],
    *,
    normals: str = "recompute",
    only_frames: bool = False,
) -> Sink:
    """Check the output and open it, before anything is computed.

    normals: what is done with those of a stage. only_frames: write only frames that are put.
    """
    if isinstance(source, StageSource):
        return StageSink(source, path, settings, normals=normals, only_frames=only_frames)
    assert isinstance(source, MeshSource)
    if normals != "recompute" or only_frames:
        option = "--only-frames" if only_frames else "--normals"
        raise UsageError(f"{option}: only for USD stages, and {source.name} is a mesh file")
    return MeshSink(source, path)


def refuse_instances(source: StageSource) -> None:
    """Raise InputError where all that might change lies in instances, which cannot be written."""
    if all(mesh.handle.instanced for mesh in source.meshes):
        raise InputError(
            f"{source.name}: nothing may change: all lies in instances, as "
            f"{source.meshes[0].path} does; --uninstance lets it change"
        )


class StageSink:
    """A layer over a stage."""

    def __init__(
        self,
        source: StageSource,
        path: str,
        settings: dict[str, Any],
        *,
        normals: str = "recompute",
        only_frames: bool = False,
    ) -> None:
        from dtrepair import __version__
        from usd_io import OverrideWriter, input_digest

        if not is_stage(path):
            raise UsageError(
                f"{path}: the input is a USD stage, so the output is a layer over it; "
                "name a .usd, .usdc or .usda file"
            )
        refuse_instances(source)
        self._meshes = [mesh.handle for mesh in source.meshes]
        self._clock = source.clock
        self._own = [set(mesh.times.tolist()) for mesh in self._meshes]
        self._put: list[set[float]] = [set() for _ in self._meshes]
        self._written: set[int] = set()
        self._seen: set[float] = set()
        self._only_frames = only_frames
        self._writer = OverrideWriter(
            source.opened, path, settings=settings, version=__version__, normals=normals
        )
        self._record = {"input_digest": input_digest(source.opened)}

    def put(self, index: int, time: float, points: NDArray[np.float32] | None) -> None:
        """Write points; what is kept of a mesh shows at the end, if it is written at all."""
        self._seen.add(float(time))
        if points is not None:
            self._writer.write(self._meshes[index], time, points)
            self._written.add(index)
            self._put[index].add(float(time))

    def commit(self, record: dict[str, Any]) -> tuple[str, ...]:
        """Copy what was kept and move the layer to its place."""
        if self._only_frames and self._seen and not np.isnan(list(self._seen)).any():
            self._writer.replace_animation(min(self._seen), max(self._seen))
        for index in self._written:
            for time in self._kept_times(index):
                self._writer.keep(self._meshes[index], time)
        self._writer.commit(record={**self._record, **record})
        return tuple(self._writer.warnings)

    def _kept_times(self, index: int) -> list[float]:
        """Times at which a written mesh must be held as it was.

        Keys that were not repaired or not selected may be keys of other meshes; a mesh that has no
        sample there would else follow the repaired pose of the nearest frame. So it would in frames
        between two keys: it is held in those just before and after each that is written, or in
        all where it is not linear between keys.
        """
        if np.isnan(self._clock.keys).any():
            return []
        if self._only_frames:
            return sorted(self._seen - self._put[index])
        linear = self._meshes[index].linear
        near = self._clock.beside(self._put[index]) if linear else self._clock.every.tolist()
        kept = {*self._clock.keys.tolist(), *near}
        return sorted(kept - self._put[index] - self._own[index])

    def abort(self) -> None:
        """Remove the temporary layer."""
        self._writer.abort()


class MeshSink:
    """A mesh file."""

    def __init__(self, source: MeshSource, path: str) -> None:
        from dtrepair.files.mesh_files import MeshFileError, losses, writable_format

        if is_stage(path):
            raise UsageError(
                f"{path}: the input is a mesh file, so the output is one; name a file such as "
                f"{Path(path).stem}{Path(source.name).suffix}"
            )
        try:
            format = writable_format(path)
        except MeshFileError as error:
            raise UsageError(str(error)) from None
        refuse_overwriting(path, source.name)
        check_writable(path)
        self._path = path
        self._source = source
        self._points: NDArray[Any] = source.file.points
        self._warnings = tuple(f"{path}: {loss}" for loss in losses(source.file, format))

    def put(self, index: int, time: float, points: NDArray[np.float32] | None) -> None:
        """Take the points of the one mesh."""
        if points is not None:
            self._points = points

    def commit(self, record: dict[str, Any]) -> tuple[str, ...]:
        """Write the file."""
        from dtrepair.files.mesh_files import write_mesh

        with writing(self._path):
            write_mesh(self._path, self._source.file, self._points)
        return self._warnings

    def abort(self) -> None:
        """Nothing was written yet."""
