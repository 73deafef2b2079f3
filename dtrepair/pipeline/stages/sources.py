"""One view of both kinds of input: a USD stage, or a mesh file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.errors import InputError, UsageError
from dtrepair.pipeline.selection import Selection

if TYPE_CHECKING:
    from dtrepair.files.polygon_mesh import PolygonMesh
    from usd_io import MeshSelection

USD_EXTENSIONS = (".usd", ".usda", ".usdc", ".usdz")
Points = NDArray[Any]
# Whole frames and samples; samples alone, of skins whole frames; or see `usd_io.key_times`.
Frames = Literal["whole", "samples", "key poses"]

# Coordinates beyond have no float32.
LARGEST = float(np.finfo(np.float32).max)
# World coordinates whose float32 steps are a larger part of the scene are taken from its middle.
COARSE = 1e-5


@dataclass(frozen=True)
class SourceMesh:
    """One mesh of an input: rest (V, 3) in local space, faces (F, 3), and the stage's own mesh.

    has_rest: the input says which pose is the rest pose (USD: by points at the default time).
    collider: takes part in contact, but never moves; of_set: nobody called it so; faces_away: which
    of its triangles (F,) face away from what moves. prop: carried by a transform beside a body.
    """

    path: str
    rest: NDArray[np.float64]
    faces: NDArray[np.int32]
    has_rest: bool
    handle: Any = None
    collider: bool = False
    of_set: bool = False
    faces_away: NDArray[np.bool_] | None = None
    prop: bool = False

    @property
    def animated(self) -> bool:
        """Whether it changes over time, or is moved."""
        import usd_io

        own = self.handle
        return own is not None and max(len(own.times), len(usd_io.transform_times(own))) > 1


class Source(Protocol):
    """An opened input; `times` are those of the selected frames, `all_times` of all frames.

    clip_times: the same, but of key poses those of the frames between them as well.
    origin: Where in the world (3,) the common space of all meshes has its zero.
    """

    name: str
    meshes: tuple[SourceMesh, ...]
    times: NDArray[np.float64]
    all_times: NDArray[np.float64]
    clip_times: NDArray[np.float64]
    warnings: tuple[str, ...]
    up: tuple[float, float, float]
    origin: NDArray[np.float64]

    def check_unchanged(self) -> None:
        """Raise an error if a file of the input was changed while it was read."""

    def read(self, mesh: SourceMesh, time: float) -> Points | None:
        """Local points (V, 3) float32; None for a blocked sample. Raises FrameError."""

    def to_world(self, mesh: SourceMesh, time: float, points: Points) -> Points:
        """Points in the common space of all meshes, float64. Raises FrameError."""

    def to_local(self, mesh: SourceMesh, time: float, points: Points) -> Points:
        """The inverse of `to_world`. Raises FrameError."""


def is_stage(path: str) -> bool:
    """Return whether a path names a USD file, by its extension."""
    # A bracket at the end names a file in a package; elsewhere it is a part of a name.
    outer = path.partition("[")[0] if path.endswith("]") else path
    return Path(outer).suffix.lower() in USD_EXTENSIONS


def time_label(time: float | None) -> str:
    """Name of a frame in a table: its time code, or `default` for a pose without a time."""
    return "default" if time is None or math.isnan(time) else f"{time:.10g}"


def usable_times(source: Source, times: Iterable[float]) -> list[float]:
    """Return those of the times at which every mesh has a transform that is a number."""
    return [float(time) for time in times if _misplaced(source, float(time)) is None]


def few_times(source: Source) -> list[float]:
    """Return the first, middle and last times of the whole clip that can be used, one at least.

    The parts of a farm agree on them. Raises InputError where none can.
    """
    every = source.clip_times
    found = usable_times(source, np.unique(every[[0, len(every) // 2, -1]]))
    return found or [placing_time(source, every)]


def placing_time(source: Source, times: Iterable[float]) -> float:
    """Return the first of the times at which rests can be placed in the common space.

    Raises InputError where a transform is no number at all of them.
    """
    first: Exception | None = None
    for time in times:
        wrong = _misplaced(source, float(time))
        if wrong is None:
            return float(time)
        first = first or wrong
    raise InputError(f"{source.name}: no frame could be used: {first}")


def _misplaced(source: Source, time: float) -> Exception | None:
    """Return why rests cannot be placed at a time; None if they can, as one mesh always is."""
    from usd_io import FrameError

    try:
        for mesh in source.meshes if len(source.meshes) > 1 else ():
            source.to_world(mesh, time, mesh.rest)
    except FrameError as error:
        return error
    return None


def open_source(
    path: str, selection: Selection, *, collider: str | None = None, frames: Frames = "whole"
) -> Source:
    """Open a STAGE or MESH; `collider`: more meshes, that take part and never move."""
    if is_stage(path):
        return StageSource(path, selection, collider=collider, frames=frames)
    given = [*selection.given(), *(["--collider"] if collider else [])]
    if given:
        raise UsageError(
            f"{', '.join(given)}: only for USD stages, and {path} is a mesh file; leave it out"
        )
    return MeshSource(path)


class StageSource:
    """A USD stage: one or several meshes over time.

    times: the selected frames, of all whole ones from the first key to the last, and all keys;
    clock: these and all others. matrices: of the meshes, and when they are hidden.
    """

    def __init__(
        self,
        path: str,
        selection: Selection,
        *,
        collider: str | None = None,
        frames: Frames = "whole",
    ) -> None:
        import usd_io
        from usd_io.read.mesh import shape_warnings

        spec = usd_io.parse_frames(selection.frames) if selection.frames is not None else None
        self.name, self._given = path, (selection, collider, frames)
        self.opened = usd_io.open_stage(path, strict=selection.whole_stages_only)
        chosen = self._read(selection, selection.prim)
        still = self._read(selection, collider) if collider is not None else None
        colliders = {mesh.path for mesh in still.meshes} if still else set()
        parts = (chosen, still) if still else (chosen,)
        found = {mesh.path: mesh for part in parts for mesh in part.meshes}
        warnings = [told for part in (self.opened, *parts) for told in part.warnings]
        self.warnings = tuple(dict.fromkeys([*warnings, *shape_warnings(parts)]))
        self.meshes = tuple(
            SourceMesh(
                mesh.path,
                mesh.rest,
                mesh.faces,
                math.isnan(mesh.rest_time),
                handle=mesh,
                collider=mesh.path in colliders or mesh.instanced,
            )
            for mesh in found.values()
        )
        if colliders and all(mesh.collider for mesh in self.meshes):
            raise UsageError(f"--collider {collider}: then nothing may move; leave a mesh out")
        up = next(iter(found.values())).up
        self.up = (float(up[0]), float(up[1]), float(up[2]))
        handles = [mesh.handle for mesh in self.meshes]
        if frames == "key poses":
            self.clock = usd_io.key_times(handles, spec)
        else:
            whole, authored = frames == "whole", selection.samples_only
            self.clock = usd_io.stage_times(handles, spec, whole=whole, authored=authored)
        self.times, self.all_times = self.clock.chosen, self.clock.every
        self.clip_times = self.clock.keys if frames == "key poses" else self.all_times
        self.warnings += tuple(f"{path}: {warning}" for warning in self.clock.warnings)
        self.origin = np.zeros(3)
        self.matrices = usd_io.WorldMatrices(visibility=not selection.include_invisible)
        if len(self.meshes) > 1:
            self._leave_coarse_coordinates()

    def like(self, path: str) -> StageSource:
        """Open another stage as this one was opened, with all its frames."""
        selection, collider, frames = self._given
        return StageSource(path, replace(selection, frames=None), collider=collider, frames=frames)

    def _read(self, selection: Selection, prim: str | None) -> MeshSelection:
        import usd_io

        found = usd_io.read_meshes(
            self.opened,
            prim=prim,
            exclude=selection.exclude,
            include_invisible=selection.include_invisible,
            include_purposes=selection.include_purposes,
            skip_varying=selection.skip_varying,
            uninstance=selection.uninstance,
            instances=True,
        )
        if not found.meshes:
            error = InputError if prim is None else UsageError
            raise error(f"{self.name}: no usable mesh: {'; '.join(found.warnings)}")
        return found

    def _leave_coarse_coordinates(self) -> None:
        """Take world points from the middle of a scene that lies far from the world's origin.

        Looks at the whole clip, so that the parts of a farm agree.
        """
        boxes = np.concatenate([self.boxes(time) for time in few_times(self)])
        low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        with np.errstate(over="ignore", invalid="ignore"):
            step = float(np.spacing(np.float32(np.abs([low, high]).max())))
        if not step > COARSE * float((high - low).max()):
            return
        self.origin = np.round((low + high) / 2.0)
        where = ", ".join(f"{value:.10g}" for value in self.origin)
        self.warnings += (
            f"{self.name}: far from the world's origin, where float32 steps are {step:.3g} units; "
            f"world coordinates are taken relative to ({where})",
        )

    def boxes(
        self, time: float, poses: Mapping[int, Points] = MappingProxyType({})
    ) -> NDArray[np.float64]:
        """Return boxes (M, 2, 3) in the world that hold each mesh at a time.

        poses: points (V, 3) of some meshes, by index, in their local space; of others the rests.
        """
        corner_of = np.array(list(np.ndindex(2, 2, 2)))
        boxes = []
        for index, mesh in enumerate(self.meshes):
            box = np.stack([end(poses.get(index, mesh.rest), axis=0) for end in (np.min, np.max)])
            corners = self.to_world(mesh, time, box[corner_of, range(3)])
            boxes.append([corners.min(axis=0), corners.max(axis=0)])
        return np.array(boxes)

    def check_unchanged(self) -> None:
        """Raise StageError if a file of the stage was changed while it was read."""
        self.opened.check_unchanged()

    def read(self, mesh: SourceMesh, time: float) -> Points | None:
        """Local points (V, 3) float32; None for a blocked sample. Raises FrameError."""
        import usd_io

        return usd_io.read_frame(mesh.handle, time)

    def to_world(self, mesh: SourceMesh, time: float, points: Points) -> Points:
        """World points, float64; from the middle of a scene that is far from the origin."""
        import usd_io

        matrix = self.matrices(mesh.handle, time).copy()
        matrix[3, :3] -= self.origin
        moved = usd_io.transform_points(points, matrix)
        if moved.size and not np.abs(moved).max() < LARGEST:
            told = "points leave the range of float32 in world space; mend the scale"
            raise usd_io.FrameError(mesh.path, time, told)
        return moved

    def to_local(self, mesh: SourceMesh, time: float, points: Points) -> Points:
        """Local points, float64. Raises FrameError where the transform flattens space."""
        import usd_io

        matrix = self.matrices(mesh.handle, time)
        return usd_io.local_points(mesh.handle, time, points + self.origin, matrix)


class MeshSource:
    """A mesh file: one mesh, one frame without a time."""

    def __init__(self, path: str) -> None:
        from dtrepair.files.mesh_files import read_mesh
        from usd_io.polygons import triangulate

        self.name = path
        self.file: PolygonMesh = read_mesh(path)
        points = self.file.points
        faces = triangulate(self.file.counts, self.file.corners, points).faces
        self.meshes: tuple[SourceMesh, ...] = (SourceMesh(Path(path).name, points, faces, True),)
        self.times = self.all_times = self.clip_times = np.array([np.nan])
        self.warnings: tuple[str, ...] = ()
        self.up = (0.0, 1.0, 0.0)
        self.origin = np.zeros(3)

    def check_unchanged(self) -> None:
        """Nothing is read of it any more."""

    def read(self, mesh: SourceMesh, time: float) -> Points | None:
        """Points (V, 3) float32."""
        return self.file.points.astype(np.float32)

    def to_world(self, mesh: SourceMesh, time: float, points: Points) -> Points:
        """The points themselves."""
        return np.asarray(points, dtype=np.float64)

    def to_local(self, mesh: SourceMesh, time: float, points: Points) -> Points:
        """The points themselves."""
        return np.asarray(points, dtype=np.float64)
