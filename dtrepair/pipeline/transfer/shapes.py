"""`dtrepair transfer --shapes`: each shape is transferred once and becomes a blend shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.errors import InputError, UsageError
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.outputs import check_writable, refuse_overwriting
from dtrepair.pipeline.stages.sources import (
    MeshSource,
    Points,
    Source,
    SourceMesh,
    StageSource,
    is_stage,
)
from dtrepair.pipeline.transfer.inputs import PoseFiles, open_poses
from dtrepair.pipeline.transfer.sinks import authored_mesh, stage_metadata

if TYPE_CHECKING:
    from usd_io.read.blend_shapes import BlendShapes


class ShapePoses(StageSource):
    """The blend shapes of a stage's mesh as poses at full weight: time codes 1, 2, ..."""

    shapes: BlendShapes

    def __init__(self, path: str, selection: Selection) -> None:
        """Read the shapes of the one selected mesh."""
        from usd_io.read.blend_shapes import read_blend_shapes

        super().__init__(path, selection, frames="samples")
        if len(self.meshes) != 1:
            raise UsageError(
                f"{path}: expected one mesh, got {len(self.meshes)}; choose one with --prim"
            )
        shapes = read_blend_shapes(self.meshes[0].handle)
        if shapes is None:
            raise InputError(
                f"{path}: {self.meshes[0].path} has no blend shapes; name shapes with --poses"
            )
        self.shapes = shapes
        self.meshes = (replace(self.meshes[0], has_rest=True),)
        self.times = np.arange(1.0, len(shapes.names) + 1.0)
        if shapes.skipped:
            names = ", ".join(shapes.skipped)
            self.warnings = (*self.warnings, f"{path}: in-between shapes are left out: {names}")

    def read(self, mesh: SourceMesh, time: float) -> Points | None:
        """Return rest points (V, 3) with one shape at full weight."""
        return np.asarray(mesh.rest + self.shapes.offsets[round(time) - 1])


def open_shapes(path: str, poses: Sequence[str], selection: Selection) -> Source:
    """Open the shapes: pose files, or the blend shapes of a stage's mesh."""
    if selection.frames is not None:
        raise UsageError("--frames: has no effect with --shapes; leave it out")
    if any(is_stage(pose) for pose in poses):
        raise UsageError("--poses: --shapes takes mesh files, one for each shape")
    return open_poses(path, poses, selection) if poses else ShapePoses(path, selection)


class ShapeSink:
    """Collects transferred shapes, and writes them as blend shapes of the target."""

    def __init__(
        self,
        source: Source,
        target: StageSource | MeshSource,
        path: str,
        settings: dict[str, Any],
        up: NDArray[np.float64],
    ) -> None:
        from usd_io.paths import check_output_path
        from usd_io.read.stages import check_not_an_input
        from usd_io.write.blend_shapes import check_target

        if not is_stage(path):
            raise UsageError(f"{path}: blend shapes need USD: name a .usd, .usdc or .usda file")
        for side in (source, target):
            refuse_overwriting(path, side.name)
            if isinstance(side, StageSource):
                check_not_an_input(side.opened.stage, path)
        if isinstance(target, StageSource):
            check_target(target.meshes[0].handle)
        check_output_path(path)
        check_writable(path)
        self._source, self._target, self._path = source, target, path
        self._settings, self._up = settings, up
        self._offsets: dict[int, NDArray[np.float64]] = {}

    def put(self, index: int, time: float, points: NDArray[np.float32] | None) -> None:
        """Take the target's points under one shape."""
        assert points is not None
        self._offsets[round(time) - 1] = points - self._target.meshes[0].rest

    def _shapes(self) -> BlendShapes:
        from usd_io.read.blend_shapes import BlendShapes, in_turn
        from usd_io.write.blend_shapes import valid_names

        kept = sorted(self._offsets)
        offsets = np.stack([self._offsets[row] for row in kept])
        if isinstance(self._source, ShapePoses):
            whole = self._source.shapes
            names = [whole.names[row] for row in kept]
            return BlendShapes(valid_names(names), offsets, whole.times, whole.weights[:, kept])
        assert isinstance(self._source, PoseFiles)
        names = [Path(self._source.path(row + 1.0)).stem for row in kept]
        return BlendShapes(valid_names(names), offsets, *in_turn(len(kept)))

    def commit(self, record: dict[str, Any]) -> tuple[str, ...]:
        """Write the stage, or the layer over the target."""
        from dtrepair import __version__
        from usd_io.write.blend_shapes import write_shapes, write_shapes_over

        record = {"version": __version__, "settings": self._settings, **record}
        shapes, target = self._shapes(), self._target
        if isinstance(target, StageSource):
            mesh = target.meshes[0].handle
            write_shapes_over(self._path, target.opened, mesh, shapes, record=record)
        else:
            metadata = stage_metadata(self._source, self._up)
            mesh = authored_mesh(target, [])
            write_shapes(self._path, mesh, shapes, record=record, **metadata)
        return ()

    def abort(self) -> None:
        """Nothing was written yet."""
