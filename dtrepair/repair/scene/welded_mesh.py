"""The mesh that is solved for poses of a scene: seam duplicates that belong together are one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dtrepair.device import DeviceQueue
from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.full.method import FullMethod, FullOptions
from dtrepair.repair.result import Solved
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.surface.surface import BodyRange, Surface


class WeldedMesh:
    """All bodies of a scene in one surface, and the method that repairs single poses of it.

    Args:
        scene: The bodies and options.
        together: For each vertex (V,) the one that stands for it.
        queue: Where work on a GPU is queued; None on the CPU.
        full: Numbers of the full method.
    """

    def __init__(
        self,
        scene: Scene,
        together: IntArray,
        queue: DeviceQueue | None = None,
        *,
        full: FullOptions = FullOptions(),
    ) -> None:
        self.kept, self.place = np.unique(together, return_inverse=True)
        faces = self.place[scene.faces].astype(np.int32)
        # A triangle between two vertices that became one has no area and takes no part.
        solid = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2])
        solid &= faces[:, 2] != faces[:, 0]
        faces, kept = faces[solid], np.flatnonzero(solid).astype(np.int32)
        starts = np.searchsorted(self.kept, scene.vertex_starts)
        options = scene.options
        bodies = [
            BodyRange(int(a), int(b), body.diffusion or options.diffusion, rigid=body.rigid)
            for a, b, body in zip(starts[:-1], starts[1:], scene.bodies, strict=True)
        ]
        mobility = np.ones(len(self.kept))
        np.minimum.at(mobility, self.place, scene.mobility)
        self.surface = Surface(
            scene.centred_rest[self.kept],
            faces,
            bodies=bodies,
            mobility=mobility,
            mode=options.mode,
            leave_rest=options.rest_contacts == "leave",
            ignored=scene.ignored,
            direction=scene.direction[self.kept] if scene.direction.any() else None,
            attachments=scene.attachments and scene.attachments.of_triangles(kept, self.place),
        )
        # In units of the surface's size.
        limit = options.maximum_displacement
        self.farthest = None if limit is None else limit / self.surface.size
        self.clearance = options.clearance / self.surface.size
        if options.method == "paper":
            from dtrepair.repair.paper.method import PaperMethod

            self.method: Any = PaperMethod(self.surface, options, queue=queue)
        else:
            self.method = FullMethod(
                self.surface,
                rounds=options.tighten,
                farthest=self.farthest,
                clearance=self.clearance,
                skip=options.skip,
                options=full,
            )

    def solve(self, poses: Sequence[FloatArray]) -> list[tuple[FloatArray, Solved]]:
        """Repaired poses (V, 3); vertices that stayed where they were keep every bit."""
        units = [self.reduced(points) for points in poses]
        if isinstance(self.method, FullMethod):
            found = [self.method(unit) for unit in units]
        else:
            found = self.method.batch(units)
        return [
            (self.expanded(points, unit, solved.points), solved)
            for points, unit, solved in zip(poses, units, found, strict=True)
        ]

    def reduced(self, points: FloatArray) -> FloatArray:
        """Points (V, 3) of the scene as those of the surface, in units of its size."""
        return points[self.kept] / self.surface.size

    def expanded(self, points: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
        """A solved pose of the surface as points (V, 3) of the scene.

        `before` is what `points` were reduced to: vertices that stayed there keep every bit.
        """
        after = self.surface.rigid.fitted(before, after)
        stayed = (after == before).all(axis=1)[self.place]
        return np.where(stayed[:, None], points, (after * self.surface.size)[self.place])


class WeldedMeshes:
    """The welded meshes of a scene, each built once.

    Args:
        scene: The bodies and options.
        queue: Where work on a GPU is queued, one for all meshes: PyTorch has few streams, and
            gives them out again. None on the CPU.
        full: Numbers of the full method.
    """

    def __init__(
        self,
        scene: Scene,
        queue: DeviceQueue | None = None,
        *,
        full: FullOptions = FullOptions(),
    ) -> None:
        self._scene, self._queue, self._full = scene, queue, full
        self._known: dict[bytes, WeldedMesh] = {}

    def __call__(self, welds: Sequence[IntArray]) -> WeldedMesh:
        """The mesh of poses with welds (V,): what coincides in the rest and all poses is one."""
        rest_weld = self._scene.rest_weld
        joined = np.ones(len(rest_weld), dtype=bool)
        for weld in welds:
            joined &= weld[rest_weld] == weld
        together = np.where(joined, rest_weld, np.arange(len(rest_weld)))
        key = together.tobytes()
        if key not in self._known:
            self._known[key] = WeldedMesh(self._scene, together, self._queue, full=self._full)
        return self._known[key]
