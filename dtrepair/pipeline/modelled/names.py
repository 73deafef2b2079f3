"""Names of the connected parts of an input, and places, so that a reader finds them again."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.attached.touches import without_touches
from dtrepair.numerics.geometry import FloatArray, components, weld_maps
from dtrepair.pipeline.stages.sources import Source, SourceMesh, placing_time
from dtrepair.report.parts import PartRecord, Point

# Positions are told to this part of the diagonal of all meshes.
DIGITS = 1e-3


class PartNames:
    """Names connected parts of the meshes of a source, and tells where triangles lie.

    Triangles are those of all meshes in a row, everywhere.
    """

    def __init__(self, source: Source) -> None:
        self.source = source

    @cached_property
    def connected(self) -> NDArray[np.integer]:
        """The connected part (F,) of each triangle, where vertices at one place are one.

        Parts that overlap and touch in a vertex are several, as for what was modelled.
        """
        from dtrepair.intersect.detector import Detector

        time = placing_time(self.source, self.source.all_times)
        placed = [self._in_world(mesh, time, mesh.rest) for mesh in self.source.meshes]
        points, weld = np.concatenate(placed), weld_maps(placed)
        faces = self._faces.astype(np.int32)
        apart = without_touches(faces, weld, lambda: Detector(points, faces)(points, weld=weld))
        faces = apart[faces]
        label = components(faces, len(self._rest))
        return np.unique(label[faces[:, 0]], return_inverse=True)[1].reshape(-1)

    def named(self, part_of: NDArray[np.integer], count: int) -> list[PartRecord]:
        """Return records of connected parts by the part (F,) of each triangle."""
        faces = self._faces
        mesh_of, number, sizes = numbered(part_of, self._mesh_of, count)
        low, high = np.full((len(sizes), 3), np.inf), np.full((len(sizes), 3), -np.inf)
        for corner in range(3):
            np.minimum.at(low, part_of, self._rest[faces[:, corner]])
            np.maximum.at(high, part_of, self._rest[faces[:, corner]])
        several = np.bincount(mesh_of, minlength=len(self.source.meshes)) > 1
        return [
            PartRecord(
                path=self.source.meshes[mesh_of[part]].path,
                number=int(number[part]) if several[mesh_of[part]] else None,
                triangles=int(sizes[part]),
                centre=self._told(0.5 * (low[part] + high[part])),
            )
            for part in range(len(sizes))
        ]

    @cached_property
    def _mesh_of(self) -> NDArray[np.integer]:
        """The mesh (F,) of each triangle."""
        sizes = [len(mesh.faces) for mesh in self.source.meshes]
        return np.repeat(np.arange(len(sizes)), sizes)

    @cached_property
    def _faces(self) -> NDArray[np.int64]:
        """Triangles (F, 3) of all meshes in a row."""
        starts = np.cumsum([0, *(len(mesh.rest) for mesh in self.source.meshes)])
        shifted = zip(self.source.meshes, starts, strict=False)
        return np.concatenate([mesh.faces + start for mesh, start in shifted])

    @cached_property
    def _rest(self) -> FloatArray:
        """Points (V, 3) of all meshes before anything deforms them, world space."""
        time = placing_time(self.source, self.source.all_times)
        placed = [self._in_world(mesh, time, mesh.rest) for mesh in self.source.meshes]
        return np.concatenate(placed) + self.source.origin

    @cached_property
    def _decimals(self) -> int:
        step = DIGITS * float(np.linalg.norm(np.ptp(self._rest, axis=0)))
        return -int(np.floor(np.log10(step))) if step > 0.0 else 6

    def _told(self, point: FloatArray) -> Point:
        """Return a position with as many digits as anybody can make use of."""
        x, y, z = (np.round(point, self._decimals) + 0.0).tolist()
        return (x, y, z)

    def where(self, points: NDArray[Any], contacts: NDArray[np.integer], time: float) -> Point:
        """Return the middle of the triangles of contacts (K, 2) of a pose (V, 3), in the world."""
        corners = self._faces[np.unique(contacts)]
        middle = points[corners].astype(np.float64).mean(axis=(0, 1))
        if len(self.source.meshes) == 1:
            middle = self._in_world(self.source.meshes[0], time, middle[None])[0]
        return self._told(middle + self.source.origin)

    def _in_world(self, mesh: SourceMesh, time: float, points: NDArray[Any]) -> FloatArray:
        """Return points in world space; as they are where the transform is no number."""
        from usd_io import FrameError

        try:
            return np.asarray(self.source.to_world(mesh, time, points))
        except FrameError:
            return np.asarray(points, dtype=np.float64)


def numbered(
    part_of: NDArray[np.integer], mesh_of: NDArray[np.integer], count: int
) -> tuple[NDArray[np.integer], NDArray[np.integer], NDArray[np.integer]]:
    """Return of each of so many parts its mesh, its number there, and how many triangles it has.

    part_of, mesh_of: of each triangle (F,). 1 is the part of a mesh with most triangles.
    """
    sizes = np.bincount(part_of, minlength=count)
    mesh_of_part = np.zeros(len(sizes), dtype=np.int64)
    mesh_of_part[part_of] = mesh_of
    order = np.lexsort((-sizes, mesh_of_part))
    first = np.flatnonzero(np.diff(mesh_of_part[order], prepend=-1))
    number = np.empty(len(sizes), dtype=np.int64)
    number[order] = 1 + np.arange(len(sizes)) - np.repeat(first, np.diff([*first, len(sizes)]))
    return mesh_of_part, number, sizes
