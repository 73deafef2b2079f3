"""What a transfer starts from: source poses, target, and how their axes and sizes compare."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.errors import INPUT, InputError, PipelineError, UsageError
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.sources import (
    MeshSource,
    Points,
    Source,
    SourceMesh,
    StageSource,
    is_stage,
    open_source,
)
from dtrepair.wording import listed

_AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
# Bodies this many times larger or smaller than each other are a wrong unit, not another animal.
_SIZE_LIMIT = 20.0


class PoseFiles:
    """A rest mesh and its poses in mesh files: time codes 1, 2, ... in the order given."""

    def __init__(self, rest: Source, paths: Sequence[str], frames: str | None) -> None:
        """Take the rest's mesh; the files are read frame by frame."""
        from usd_io import parse_frames

        missing = [path for path in paths if not os.path.isfile(path)]
        if missing:
            raise InputError(f"{missing[0]}: no such file; check --poses")
        self.rest = rest
        self._paths = tuple(paths)
        self.name = rest.name
        self.meshes: tuple[SourceMesh, ...] = (replace(rest.meshes[0], has_rest=True),)
        self.times = self.all_times = self.clip_times = np.arange(1.0, len(paths) + 1.0)
        if frames is not None:
            self.times = self.times[parse_frames(frames).select(self.times, require=True)]
        self.warnings = rest.warnings
        self.up = rest.up
        self.origin = np.zeros(3)

    def check_unchanged(self) -> None:
        """Raise an error if the rest mesh was changed while it was read."""
        self.rest.check_unchanged()

    def path(self, time: float) -> str:
        """Return the file of a time code."""
        return self._paths[round(time) - 1]

    def read(self, mesh: SourceMesh, time: float) -> Points | None:
        """Read points (V, 3) as the file has them; FrameError for a file that does not fit."""
        from dtrepair.files.mesh_files import MeshFileError, read_mesh
        from usd_io import FrameError

        path = self.path(time)
        try:
            pose = read_mesh(path)
        except MeshFileError as error:
            raise FrameError(mesh.path, time, str(error)) from None
        if len(pose.points) != len(mesh.rest):
            raise FrameError(
                mesh.path,
                time,
                f"{path}: expected {len(mesh.rest)} vertices as the rest pose has, got "
                f"{len(pose.points)}; export the pose again",
            )
        if isinstance(self.rest, MeshSource):
            rest = self.rest.file
            same = np.array_equal(pose.counts, rest.counts)
            if not same or not np.array_equal(pose.corners, rest.corners):
                raise FrameError(
                    mesh.path,
                    time,
                    f"{path}: the faces are not those of the rest pose; export the pose again",
                )
        return pose.points

    def to_world(self, mesh: SourceMesh, time: float, points: Points) -> Points:
        """Return the points themselves."""
        return np.asarray(points, dtype=np.float64)

    def to_local(self, mesh: SourceMesh, time: float, points: Points) -> Points:
        """Return the points themselves."""
        return np.asarray(points, dtype=np.float64)


def open_poses(path: str, poses: Sequence[str], selection: Selection) -> Source:
    """Open the source: an animated stage, or a rest mesh with pose files or an animated stage."""
    if not poses:
        if not is_stage(path):
            raise UsageError(
                f"{path}: is a mesh file, which holds one pose; name its poses with --poses, or "
                "give an animated stage"
            )
        return _posing(open_source(path, selection, frames="samples"))
    if any(is_stage(pose) for pose in poses):
        if len(poses) > 1:
            raise UsageError(f"--poses: expected one stage or mesh files, got {len(poses)}")
        return _posing(open_source(poses[0], selection, frames="samples"))
    of_rest = replace(selection, frames=None)
    rest = _single(open_source(path, of_rest, frames="samples"), "--prim")
    return PoseFiles(rest, poses, selection.frames)


def _posing(source: Source) -> Source:
    """Return a source that is only read: its meshes in instances pose as the others do."""
    source.meshes = tuple(replace(mesh, collider=False) for mesh in source.meshes)
    return source


def open_target(path: str, prim: str | None, collider: str | None) -> StageSource | MeshSource:
    """Open the target: meshes of a stage, or a mesh file."""
    if prim is not None and not is_stage(path):
        raise UsageError(f"--target-prim: only for USD stages, and {path} is a mesh file")
    source = open_source(path, Selection(prim=prim), collider=collider, frames="samples")
    assert isinstance(source, StageSource | MeshSource)
    return source


def _single(source: Source, option: str) -> Source:
    """Return the source of a rest whose poses are mesh files, which hold one mesh."""
    if len(source.meshes) != 1:
        names = ", ".join(mesh.path for mesh in source.meshes[:4])
        more = ", ..." if len(source.meshes) > 4 else ""
        raise UsageError(
            f"{source.name}: expected one mesh, got {len(source.meshes)} ({names}{more}); "
            f"choose one with {option}"
        )
    return source


@contextmanager
def input_errors(*, code: int = INPUT, prefix: str = "") -> Iterator[None]:
    """Turn a ValueError about the user's arrays, or a file that cannot be read, into a failure."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise PipelineError(f"{prefix}{error}", code) from None


@dataclass(frozen=True)
class Axes:
    """How the source's local axes become the target's local axes.

    rotation: (3, 3) from one to the other; up: the target's up axis (3,), local.
    still: the source's matrix (4, 4), row vectors, at the first frame; None where it never moves.
    """

    rotation: NDArray[np.float64]
    up: NDArray[np.float64]
    still: NDArray[np.float64] | None

    def pose(self, source: Source, time: float, points: Points) -> NDArray[np.float64]:
        """Return local points (V, 3), moved as the source has moved since the first frame."""
        if self.still is None:
            return np.asarray(points, dtype=np.float64)
        from usd_io import inverse_matrix, transform_points, world_matrix

        world = world_matrix(source.meshes[0].handle, time)
        return transform_points(points, world @ inverse_matrix(self.still))


def compare_axes(source: Source, target: Source, ups: tuple[str | None, str | None]) -> Axes:
    """Compare the axes of both inputs; `ups` are names given by the user, else the stages' own.

    A mesh file does not say its up axis: it is taken for that of the other input.
    """
    from dtrepair.transfer.rests import local_rotation, rotation_of
    from usd_io import transform_times

    stages = _stage(source), _stage(target)
    known = [_AXES[name] if name else s and s.up for name, s in zip(ups, stages, strict=True)]
    source_up = known[0] or known[1] or _AXES["Y"]
    target_up = known[1] or known[0] or _AXES["Y"]
    matrices = _matrix(source), _matrix(target)
    rotation = local_rotation(source_up, target_up, *matrices)
    up = rotation_of(matrices[1][:3, :3]).T @ np.asarray(target_up)
    single = isinstance(source, StageSource) and len(source.meshes) == 1
    moves = single and len(transform_times(source.meshes[0].handle)) > 1
    return Axes(rotation, up, matrices[0] if moves else None)


def _stage(source: Source) -> StageSource | None:
    """Return the stage whose space a source's points are in."""
    found = source.rest if isinstance(source, PoseFiles) else source
    return found if isinstance(found, StageSource) else None


def _matrix(source: Source) -> NDArray[np.float64]:
    stage = _stage(source)
    if stage is None or len(stage.meshes) > 1:  # several meet in world space
        return np.eye(4)
    from usd_io import world_matrix

    return world_matrix(stage.meshes[0].handle, float(stage.times[0]))


def input_problems(source: Source, target: Source) -> list[str]:
    """Return what an artist should know of the rests before looking at the result."""
    from dtrepair.transfer.rests import inside_out
    from usd_io.polygons import nonmanifold_edges

    found = []
    sides: tuple[Source, ...] = (source, target)
    for side, mesh in ((own, mesh) for own in sides for mesh in own.meshes):
        # The reader of stages has told its own already.
        edges = 0 if _stage(side) else nonmanifold_edges(mesh.faces)
        if edges:
            found.append(f"{side.name}: {edges} non-manifold edges (more than two triangles)")
        if inside_out(mesh.rest, mesh.faces):
            found.append(
                f"{side.name}: {mesh.path} is wound inside out; matching compares normals: flip "
                "its faces, or its orientation in USD"
            )
    matrices = [_matrix(side)[:3, :3] for side in sides]
    if np.prod([np.linalg.det(matrix) for matrix in matrices]) < 0:
        found.append(
            f"{source.name}, {target.name}: the transform of one of them mirrors it; the motion "
            "may come out on the wrong side"
        )
    if not np.isnan(target.times).all():
        paths = listed([mesh.path for mesh in target.meshes if not mesh.collider])
        found.append(f"{target.name}: the animation of {paths} is replaced")
    stages = _stage(source), _stage(target)
    if stages[0] and stages[1]:
        found += _unit_problems(stages[0], stages[1])
    return found


def _unit_problems(source: StageSource, target: StageSource) -> list[str]:
    from dtrepair.numerics.geometry import extent

    sizes = []
    for side in (source, target):
        time = float(side.times[0])
        world = [side.to_world(mesh, time, mesh.rest) for mesh in side.meshes]
        sizes.append(extent(np.concatenate(world)) * side.meshes[0].handle.meters_per_unit)
    if sizes[0] < _SIZE_LIMIT * sizes[1] and sizes[1] < _SIZE_LIMIT * sizes[0]:
        return []
    return [
        f"{target.name}: the target measures {sizes[1]:.3g} m, the source {sizes[0]:.3g} m: is "
        "metersPerUnit right in both stages?"
    ]
