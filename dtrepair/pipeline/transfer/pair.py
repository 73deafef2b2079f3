"""Source and target of a transfer, opened: their meshes as one each, rest poses and axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.stages.frames import Frame, placed_frame
from dtrepair.pipeline.stages.rest import Rest, choose_rests
from dtrepair.pipeline.stages.sources import MeshSource, Source, StageSource
from dtrepair.pipeline.transfer.inputs import (
    Axes,
    compare_axes,
    input_problems,
    open_poses,
    open_target,
)
from dtrepair.pipeline.transfer.settings import TransferSettings
from dtrepair.pipeline.transfer.shapes import open_shapes

Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]


class JoinedMeshes:
    """The meshes of an input that move, one after the other: a single one in its local space.

    Several are in world space, as they lie at the first time. Colliders stay where they are.
    """

    def __init__(self, source: Source, rests: Sequence[Rest]) -> None:
        """Take the rest of each mesh, in its local space."""
        self.source, self.several = source, len(source.meshes) > 1
        self.rests = tuple(rests)
        self.moving = [i for i, mesh in enumerate(source.meshes) if not mesh.collider]
        time = float(source.all_times[0])
        every = self.placed(time, [rest.points for rest in rests])
        placed = [np.asarray(every[index], np.float64) for index in self.moving]
        faces = [source.meshes[index].faces for index in self.moving]
        self._vertices = np.cumsum([0, *(len(points) for points in placed)])
        self._triangles = np.cumsum([0, *(len(own) for own in faces)])
        self.points: NDArray[np.float64] = placed[0] if len(placed) == 1 else np.concatenate(placed)
        shifted = [own + start for own, start in zip(faces, self._vertices, strict=False)]
        self.faces = np.concatenate(shifted).astype(np.int32)

    def placed(
        self, time: float, points: Sequence[NDArray[np.floating]]
    ) -> list[NDArray[np.floating]]:
        """Return local points of every mesh in the space of the frames."""
        if not self.several:
            return list(points)
        both = zip(self.source.meshes, points, strict=True)
        return [self.source.to_world(mesh, time, own) for mesh, own in both]

    @property
    def mesh(self) -> Mesh:
        """All of them: points (V, 3) and triangles (F, 3)."""
        return self.points, self.faces

    @property
    def paths(self) -> list[str]:
        """What they are called."""
        return [self.source.meshes[index].path for index in self.moving]

    def part(self, place: int) -> Mesh:
        """Return one of them, numbered for itself."""
        own = self.triangles(place)
        return self.points[self.vertices(place)], self.faces[own] - self._vertices[place]

    def vertices(self, place: int) -> slice:
        """Return the vertices of one of them."""
        return slice(int(self._vertices[place]), int(self._vertices[place + 1]))

    def triangles(self, place: int) -> slice:
        """Return the triangles of one of them."""
        return slice(int(self._triangles[place]), int(self._triangles[place + 1]))

    def pose(self, frame: Frame) -> NDArray[np.float64]:
        """Return the points (V, 3) of a frame of the input."""
        parts = [np.asarray(frame.spaces[index], np.float64) for index in self.moving]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def split(self, values: NDArray[Any]) -> list[NDArray[Any] | None]:
        """Return values (V, ...) of vertices by mesh; None for those that stay."""
        parts: list[NDArray[Any] | None] = [None] * len(self.source.meshes)
        for index, (first, stop) in zip(self.moving, pairwise(self._vertices), strict=True):
            parts[index] = values[first:stop]
        return parts

    def frame(self, time: float, points: NDArray[np.float64]) -> Frame:
        """Return points (V, 3) as a frame of the input: local, float32, with their space.

        Raises FrameError where a transform flattens space.
        """
        local = []
        meshes = zip(self.source.meshes, self.split(points), self.rests, strict=True)
        for mesh, part, rest in meshes:
            if part is None:
                part = rest.points
            elif self.several:
                part = self.source.to_local(mesh, time, part)
            local.append(part.astype(np.float32))
        return placed_frame(self.source, time, local)


@dataclass(frozen=True)
class Pair:
    """Both inputs with their meshes as one in their rest poses; what should be known of them."""

    source: Source
    target: StageSource | MeshSource
    from_meshes: JoinedMeshes
    to_meshes: JoinedMeshes
    axes: Axes
    warnings: tuple[str, ...]

    @property
    def meshes(self) -> tuple[Mesh, Mesh]:
        """Rest points and faces of source and target."""
        return self.from_meshes.mesh, self.to_meshes.mesh


def open_pair(source_path: str, target_path: str, settings: TransferSettings, device: str) -> Pair:
    """Open both inputs and choose their rest poses."""
    options = settings.options
    open_source = open_shapes if options.shapes else open_poses
    source = open_source(source_path, settings.poses, settings.selection)
    target = open_target(target_path, options.target_prim, settings.objects.collider)
    if options.shapes and len(target.meshes) > 1:
        raise UsageError("--shapes: of one mesh; choose it with --target-prim")
    warnings = [*source.warnings, *target.warnings, *input_problems(source, target)]
    rest = settings.rest
    if rest is None and source.name != source_path:
        rest = source_path  # the poses are a stage of their own, the source its rest
    axes = compare_axes(source, target, (options.source_up, options.target_up))
    rests = choose_rests(source, rest, device=device), choose_rests(target, None, device=device)
    for side, found in zip((source, target), rests, strict=True):
        for mesh, own in zip(side.meshes, found, strict=True):
            if own.of_frame:
                warnings.append(
                    f"{side.name}: {mesh.path} has no points at the default time; its rest pose is "
                    f"taken from {own.origin}"
                )
    joined = JoinedMeshes(source, rests[0]), JoinedMeshes(target, rests[1])
    # One stage may be both, and has the same to tell on either side.
    return Pair(source, target, *joined, axes, tuple(dict.fromkeys(warnings)))
