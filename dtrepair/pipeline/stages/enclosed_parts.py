"""What lies wholly inside what: parts that intersect nothing, which a count does not show."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dtrepair.numerics.geometry import weld_maps
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
        from dtrepair.repair.surface.containment import Enclosures, meshes_oriented_outwards

        self.paths = [mesh.path for mesh in source.meshes]
        self.mode, self.ignored = mode, set(ignored)
        time, several = placing_time(source, source.times), len(source.meshes) > 1
        if several:
            rests = [source.to_world(mesh, time, mesh.rest) for mesh in source.meshes]
            faces = [outward_faces(mesh, time) for mesh in source.meshes]
        else:
            rests, faces = [source.meshes[0].rest], [source.meshes[0].faces]
        outwards = meshes_oriented_outwards(list(zip(rests, faces, strict=True)))
        sizes = [len(mesh.rest) for mesh in source.meshes]
        shifted = [
            own + start for own, start in zip(outwards, np.cumsum([0, *sizes]), strict=False)
        ]
        welded = weld_maps([mesh.rest for mesh in source.meshes])[np.concatenate(shifted)]
        self._enclosures = Enclosures(np.concatenate(rests), welded)
        self._body = np.zeros(self._enclosures.count, dtype=np.int64)
        used = self._enclosures.part >= 0
        self._body[self._enclosures.part[used]] = np.repeat(np.arange(len(sizes)), sizes)[used]

    def __call__(self, frame: Frame, count: SceneCount) -> tuple[EnclosedRecord, ...]:
        """Each pair of meshes once, with `count` of the same frame; inner is outer for parts."""
        points = np.concatenate([np.asarray(part, np.float64) for part in frame.spaces])
        parts = self._enclosures(points, count.every_pair).parts
        found: dict[tuple[int, int], int] = {}
        for inner, outer in self._body[parts].tolist():
            if not frame.hidden.isdisjoint((inner, outer)):
                continue
            key = min(inner, outer), max(inner, outer)
            between = inner != outer
            counts = self.mode == "both" or between == (self.mode == "inter")
            if counts and key not in self.ignored:
                found[inner, outer] = found.get((inner, outer), 0) + 1
        return tuple(
            EnclosedRecord(inner=self.paths[i], outer=self.paths[j], parts=number)
            for (i, j), number in sorted(found.items())
        )
