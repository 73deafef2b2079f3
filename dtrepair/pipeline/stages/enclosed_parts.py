"""What lies wholly inside what: parts that intersect nothing, which a count does not show."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dtrepair.numerics.geometry import weld_map
from dtrepair.pipeline.stages.bodies import outward_faces
from dtrepair.pipeline.stages.frames import Frame
from dtrepair.pipeline.stages.sources import Source, placing_time
from dtrepair.report.record import EnclosedRecord

if TYPE_CHECKING:
    from dtrepair.intersect.scene_counts import SceneCount


class EnclosedParts:
    """Looks for connected parts wholly inside closed ones, frame by frame.

    Args:
        source: the meshes.
        mode: "self" within a mesh, "inter" between meshes, "both".
        ignored: pairs of meshes (i, j), i <= j, that are left out.
    """

    def __init__(
        self, source: Source, *, mode: str = "both", ignored: Sequence[tuple[int, int]] = ()
    ) -> None:
        from dtrepair.repair.surface.containment import Enclosures, oriented_outwards

        self.paths = [mesh.path for mesh in source.meshes]
        self.mode, self.ignored = mode, set(ignored)
        time, several = placing_time(source, source.times), len(source.meshes) > 1
        rests, faces, owners, start = [], [], [], 0
        for index, mesh in enumerate(source.meshes):
            own = outward_faces(mesh, time) if several else mesh.faces
            rest = source.to_world(mesh, time, mesh.rest) if several else mesh.rest
            own = oriented_outwards(np.asarray(rest, dtype=np.float64), own)
            faces.append(weld_map(mesh.rest)[own] + start)
            rests.append(rest)
            owners.append(np.full(len(mesh.rest), index))
            start += len(mesh.rest)
        self._enclosures = Enclosures(np.concatenate(rests), np.concatenate(faces).astype(np.int32))
        self._body = np.zeros(self._enclosures.count, dtype=np.int64)
        used = self._enclosures.part >= 0
        self._body[self._enclosures.part[used]] = np.concatenate(owners)[used]

    def __call__(self, frame: Frame, count: SceneCount) -> tuple[EnclosedRecord, ...]:
        """Each pair of meshes once, with `count` of the same frame; inner is outer for parts."""
        points = np.concatenate([np.asarray(part, np.float64) for part in frame.spaces])
        parts = self._enclosures(points, count.every_pair).parts
        found: dict[tuple[int, int], int] = {}
        for inner, outer in self._body[parts].tolist():
            key = min(inner, outer), max(inner, outer)
            between = inner != outer
            counts = self.mode == "both" or between == (self.mode == "inter")
            if counts and key not in self.ignored:
                found[inner, outer] = found.get((inner, outer), 0) + 1
        return tuple(
            EnclosedRecord(inner=self.paths[i], outer=self.paths[j], parts=number)
            for (i, j), number in sorted(found.items())
        )
