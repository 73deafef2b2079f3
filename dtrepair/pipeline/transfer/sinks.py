"""Where a transferred animation goes: a layer over the target's stage, or a new stage."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.stages.outputs import check_writable, refuse_overwriting
from dtrepair.pipeline.stages.sinks import Sink
from dtrepair.pipeline.stages.sources import MeshSource, Source, StageSource, is_stage

if TYPE_CHECKING:
    from usd_io import AuthoredMesh


def open_clip(
    source: Source,
    target: StageSource | MeshSource,
    path: str,
    settings: dict[str, Any],
    up: NDArray[np.float64],
) -> Sink:
    """Check the output and open it, before anything is computed; `up`: the target's axis (3,)."""
    if not is_stage(path):
        raise UsageError(
            f"{path}: a transfer writes an animation: name a .usd, .usdc or .usda file"
        )
    if isinstance(source, StageSource):
        from usd_io.read.stages import check_not_an_input

        check_not_an_input(source.opened.stage, path)
    if isinstance(target, StageSource):
        return LayerClip(source, target, path, settings)
    return NewStage(source, target, path, settings, up)


class LayerClip:
    """A layer over the target's stage in which the target moves as transferred."""

    def __init__(
        self, source: Source, target: StageSource, path: str, settings: dict[str, Any]
    ) -> None:
        from dtrepair import __version__
        from usd_io import OverrideWriter

        self._meshes = [mesh.handle for mesh in target.meshes]
        stage, rate = target.opened.stage, frame_rate(source)
        self._warnings: list[str] = []
        self._writer = OverrideWriter(target.opened, path, settings=settings, version=__version__)
        if stage.HasAuthoredTimeCodeRange() and rate not in (None, stage.GetTimeCodesPerSecond()):
            # Another rate would rescale what else the target's stage animates.
            self._warnings.append(
                f"{target.name}: plays {stage.GetTimeCodesPerSecond():g} time codes a second, the "
                f"source {rate:g}; the source's time codes are kept, so the clip changes its speed"
            )
            rate = None
        start, end = float(source.times.min()), float(source.times.max())
        self._writer.replace_animation(start, end, rate)

    def put(self, index: int, time: float, points: NDArray[np.float32] | None) -> None:
        """Write the local points of a mesh of the target."""
        assert points is not None
        self._writer.write(self._meshes[index], time, points)

    def commit(self, record: dict[str, Any]) -> tuple[str, ...]:
        """Move the layer to its place."""
        self._writer.commit(record=record)
        return (*self._warnings, *self._writer.warnings)

    def abort(self) -> None:
        """Remove the temporary layer."""
        self._writer.abort()


class NewStage:
    """A stage of its own for a target that is a mesh file."""

    def __init__(
        self,
        source: Source,
        target: MeshSource,
        path: str,
        settings: dict[str, Any],
        up: NDArray[np.float64],
    ) -> None:
        from usd_io.paths import check_output_path

        refuse_overwriting(path, target.name, source.name)
        check_output_path(path)
        check_writable(path)
        self._path, self._source, self._target = path, source, target
        self._settings, self._up = settings, up
        self._points: dict[float, NDArray[np.float32]] = {}

    def put(self, index: int, time: float, points: NDArray[np.float32] | None) -> None:
        """Take the target's points of a frame."""
        assert points is not None
        self._points[time] = points

    def commit(self, record: dict[str, Any]) -> tuple[str, ...]:
        """Write the stage."""
        from dtrepair import __version__
        from usd_io import write_animation

        times = sorted(self._points)
        record = {"version": __version__, "settings": self._settings, **record}
        write_animation(
            self._path,
            authored_mesh(self._target, [self._points[time] for time in times]),
            times=times,
            record=record,
            **stage_metadata(self._source, self._up),
        )
        return ()

    def abort(self) -> None:
        """Nothing was written yet."""


def authored_mesh(target: MeshSource, points: list[NDArray[np.float32]]) -> AuthoredMesh:
    """Return the target as a mesh of a new stage, with its polygons and texture coordinates."""
    from usd_io import AuthoredMesh

    mesh = target.file
    name = prim_name(target.name)
    corners = mesh.texture_corners
    textured = mesh.texture is not None and corners is not None and bool((corners >= 0).all())
    return AuthoredMesh(
        path=f"/{name}/Mesh",
        faces=[part.tolist() for part in np.split(mesh.corners, np.cumsum(mesh.counts)[:-1])],
        points=points,
        rest=mesh.points,
        st=mesh.texture if textured else None,
        st_indices=corners if textured else None,
    )


def stage_metadata(source: Source, up: NDArray[np.float64]) -> dict[str, Any]:
    """Return the up axis (3,) of a target, by name, and a source stage's units and rate."""
    axis = {"up": "Z" if up[2] > 0.5 else "Y"}
    if not isinstance(source, StageSource):
        return axis
    units = source.meshes[0].handle.meters_per_unit
    return {**axis, "meters_per_unit": units, "fps": frame_rate(source)}


def frame_rate(source: Source) -> float | None:
    """Return time codes per second of a source stage; None for mesh files."""
    if not isinstance(source, StageSource):
        return None
    return float(source.opened.stage.GetTimeCodesPerSecond())


def prim_name(path: str) -> str:
    """Return a prim name made of a file name."""
    stem = Path(path).stem
    name = "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in stem)
    return name if name and not name[0].isdigit() else f"_{name}"
