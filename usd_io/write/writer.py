"""Repaired points into a layer over the input (a new root layer of `over` prims)."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pxr import Sdf, Usd

from usd_io.errors import StageError, time_text
from usd_io.paths import check_output_path, relative_asset_path
from usd_io.read.mesh import AnimatedMesh
from usd_io.read.reader import raw_points
from usd_io.read.stages import OpenedStage, as_stage, check_not_an_input
from usd_io.read.transforms import transform_times
from usd_io.times import time_code
from usd_io.values import create_attribute, extent_of, vec3f_array
from usd_io.write.atomic_layer import AtomicLayer
from usd_io.write.metadata import copy_stage_metadata, set_record
from usd_io.write.normals_output import NormalsOutput
from usd_io.write.normals_sources import authored_rates
from usd_io.write.rates import author_rates
from usd_io.write.unbind import unbind, unbound_warnings


@dataclass
class _MeshOutput:
    """What was authored for one mesh: True for written time codes, False for kept ones."""

    mesh: AnimatedMesh
    path: Sdf.Path
    normals: NormalsOutput
    times: dict[float, bool] = field(default_factory=dict)
    default: bool | None = None


class OverrideWriter:
    """Writes one layer of changed points over a stage, atomically.

    The layer has the stage's root layer as its sublayer, its metadata, and for each mesh that was
    written or kept at any time: points and extent, normals and velocities where the input has
    them. All samples of such a mesh end up in the layer, untouched ones as copies, because the
    strongest layer with any sample owns the attribute. A mesh never named is not in the layer.

    As a context manager it leaves no file behind unless `commit` was called.

    Attributes:
        path: absolute path of the output.
        warnings: one line each, such as normals that had to be blocked.
    """

    def __init__(
        self,
        stage: OpenedStage | Usd.Stage,
        path: str | os.PathLike[str],
        *,
        settings: Mapping[str, Any],
        version: str = "",
        normals: str = "recompute",
    ) -> None:
        """Check the output and open a temporary layer beside it, before anything is computed.

        Args:
            stage: the stage whose meshes are written.
            path: output, .usd (binary), .usdc or .usda.
            settings: recorded in customLayerData.dtrepair.settings; plain nested values.
            version: version of the program that writes, recorded likewise.
            normals: "recompute", "keep" or "drop", see `NormalsOutput`.

        Raises:
            UsageError: the output is a layer of the stage, or not a USD layer (.usdz).
            OutputError: the output cannot be written.
            StageError: the stage exists in memory only, or no layer can refer to its path.
        """
        self._stage = as_stage(stage)
        self._opened = stage if isinstance(stage, OpenedStage) else None
        self.path = check_output_path(path)
        self.warnings: list[str] = []
        root = self._stage.GetRootLayer()
        if root.anonymous:
            raise StageError("the stage exists in memory only; save it to a file first")
        check_not_an_input(self._stage, self.path)
        directory = os.path.dirname(self.path)
        source = relative_asset_path(root.realPath or root.identifier, directory)
        if any(ord(character) < 32 or ord(character) == 127 for character in source):
            raise StageError(
                f"{root.identifier}: its path has control characters, so that no layer can be "
                "written over it; rename it"
            )
        told = {"version": version, "input": source, "settings": dict(settings)}
        self._record: dict[str, Any] = told
        self._meshes: dict[str, _MeshOutput] = {}
        self._keeps, self._normals = True, normals
        self._file = AtomicLayer(self.path)
        try:
            self._layer.subLayerPaths = [source]
            copy_stage_metadata(self._stage, self._layer, directory)
        except BaseException:
            self.abort()
            raise

    def replace_animation(self, start: float, end: float, rate: float | None = None) -> None:
        """Make what is written a new animation: samples of the input are not copied.

        Args:
            start: first time code of the stage.
            end: last time code of the stage.
            rate: time codes per second; None keeps the input's. Another rate rescales the times
                of everything else that the input animates.
        """
        self._keeps = False
        self._layer.startTimeCode, self._layer.endTimeCode = start, end
        if rate is not None:
            self._layer.timeCodesPerSecond = self._layer.framesPerSecond = rate

    def write(self, mesh: AnimatedMesh, time: float, points: ArrayLike) -> None:
        """Write local points (V, 3), stage units, at a time code (NaN: the default time).

        Any float type; rounded to float32. Time codes that the input has no sample at are added.

        Raises:
            ValueError: the shape is not that of the rest points, or a point is not finite in
                float32.
            OutputError: the disk is full or the like.
        """
        values = _checked(mesh, time, points)
        output = self._output(mesh)
        self._set_points(output, time, values)
        self._set_normals(output, time, values)
        self._done(output, time, written=True)

    def keep(self, mesh: AnimatedMesh, time: float) -> None:
        """Copy the input's points at a time code bit by bit; a blocked sample stays blocked.

        Nothing is checked: frames of NaN or of another point count are copied as they are.

        Raises:
            OutputError: the disk is full or the like.
        """
        output = self._output(mesh)
        points = raw_points(mesh, time)
        if points is None:
            for name in ("points", "extent"):
                self._set(output, name, time, Sdf.ValueBlock())
            output.normals.put_block(time)
        else:
            self._set_points(output, time, points)
            # Normals of a skinned mesh belong to the bind pose: they are stale in any case.
            self._set_normals(output, time, points if mesh.skinned else None)
        self._done(output, time, written=False)

    def commit(self, *, record: Mapping[str, Any] | None = None) -> None:
        """Copy the samples not yet named, finish velocities, and move the file to its place.

        Args:
            record: more entries of customLayerData.dtrepair, such as counts before and after.

        Raises:
            OutputError: the output cannot be written; an older one is unchanged.
            StageError: a file of the stage was changed while it was read.
        """
        try:
            for output in self._meshes.values() if self._keeps else ():
                self._keep_the_rest(output)
            for output in self._meshes.values():
                if output.times or output.default:
                    self._author_rates(output)
            skinned = [path for path, output in self._meshes.items() if output.mesh.skinned]
            self.warnings += unbound_warnings(skinned)
            if self._opened is not None:
                self._opened.check_unchanged()
            set_record(self._layer, {**self._record, **self._frames(), **(record or {})})
            self._file.commit()
        finally:
            self.abort()

    def abort(self) -> None:
        """Drop everything; the output path is as it was."""
        self._file.abort()

    def __enter__(self) -> OverrideWriter:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Abort unless committed."""
        self.abort()

    @property
    def _layer(self) -> Sdf.Layer:
        """The layer. Raises ValueError after commit or abort."""
        if self._file.layer is None:
            raise ValueError(f"{self.path}: committed or aborted before; make a new writer")
        return self._file.layer

    def _output(self, mesh: AnimatedMesh) -> _MeshOutput:
        """Return what was authored for a mesh; the first call creates its prim."""
        layer = self._layer
        if mesh.stage != self._stage:
            raise ValueError(f"{mesh.path}: lies on another stage; read the meshes again")
        if mesh.path not in self._meshes:
            path = Sdf.Path(mesh.path)
            for name in ("points", "extent"):
                create_attribute(layer, path, name)
            for instance in mesh.uninstanced:
                Sdf.CreatePrimInLayer(layer, instance).instanceable = False
            if mesh.skinned:
                unbind(layer, path)
            normals = NormalsOutput(self._file, path, mesh, self._normals)
            self._meshes[mesh.path] = _MeshOutput(mesh, path, normals)
        return self._meshes[mesh.path]

    def _set(self, output: _MeshOutput, name: str, time: float, value: object) -> None:
        """Author one sample."""
        path = create_attribute(self._layer, output.path, name)
        self._file.set_sample(path, time, value)

    def _set_points(self, output: _MeshOutput, time: float, points: NDArray[np.float32]) -> None:
        """Author points (V, 3) and their extent at a time."""
        self._set(output, "points", time, vec3f_array(points))
        self._set(output, "extent", time, extent_of(points))

    def _set_normals(
        self, output: _MeshOutput, time: float, changed: NDArray[np.float32] | None
    ) -> None:
        """Author normals of changed points; without points, those of the input."""
        for name in output.normals.put(time, changed):
            self.warnings.append(
                f"{output.mesh.path}: {name} cannot follow the points and are blocked"
            )

    def _done(self, output: _MeshOutput, time: float, *, written: bool) -> None:
        """Note a time code as written or kept; the layer is saved every few frames."""
        if math.isnan(time):
            output.default = written
        else:
            output.times[float(time)] = written
        self._file.end_frame()

    def _keep_the_rest(self, output: _MeshOutput) -> None:
        """Copy samples not yet authored; static points written as samples: see below."""
        times = output.mesh.times
        if np.isnan(times).any():
            # Static points on an animated transform: elsewhere they stay as they were.
            times = transform_times(output.mesh) if output.times else times[:0]
        for time in times:
            if float(time) not in output.times:
                self.keep(output.mesh, float(time))

    def _author_rates(self, output: _MeshOutput) -> None:
        """Author velocities and accelerations where the input has them."""
        prim = output.mesh.prim
        author_rates(
            self._file,
            output.path,
            authored_rates(output.mesh),
            # Rates of a skinned mesh were those of its base points: never worth a copy.
            {time: changed or output.mesh.skinned for time, changed in output.times.items()},
            self._layer.timeCodesPerSecond,
            original=lambda name, time: prim.GetAttribute(name).Get(time_code(time)),
        )

    def _frames(self) -> dict[str, Any]:
        """Return the time codes written, of all meshes together and of each one."""
        written = {
            path: sorted(time for time, changed in output.times.items() if changed)
            for path, output in self._meshes.items()
        }
        return {
            "frames": np.array(sorted(set().union(*written.values())), dtype=np.float64),
            "written": {path: times for path, times in written.items() if times},
            "written_default": [p for p, output in self._meshes.items() if output.default],
        }


def _checked(mesh: AnimatedMesh, time: float, points: ArrayLike) -> NDArray[np.float32]:
    """Return points (V, 3) as float32. Raises ValueError where they do not fit the mesh."""
    array = np.asarray(points)
    where = f"{mesh.path} at {time_text(time)}"
    if array.shape != mesh.rest.shape:
        raise ValueError(
            f"{where}: expected points {mesh.rest.shape}, got {array.shape}; write all points"
        )
    with np.errstate(over="ignore"):
        values = np.ascontiguousarray(array, dtype=np.float32)
    if not np.isfinite(values).all():
        raise ValueError(f"{where}: expected finite points, got NaN or infinity; keep the frame")
    return values
