"""The mesh that is solved for a scene, and the method that solves it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.full.method import FullMethod
from dtrepair.repair.options import Solved
from dtrepair.repair.scene.bodies import about_centre
from dtrepair.repair.surface.surface import BodyRange, Surface

if TYPE_CHECKING:
    from dtrepair.repair.repairer import SceneRepairer


class System:
    """The mesh that is solved: all bodies in one, vertices that belong together made one."""

    def __init__(self, scene: SceneRepairer, together: IntArray) -> None:
        self.kept, self.place = np.unique(together, return_inverse=True)
        faces = self.place[scene._faces].astype(np.int32)
        # A triangle between two vertices that became one has no area and takes no part.
        solid = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2])
        faces = faces[solid & (faces[:, 2] != faces[:, 0])]
        starts = np.searchsorted(self.kept, scene._vertices)
        options = scene.options
        bodies = [
            BodyRange(int(a), int(b), body.diffusion or options.diffusion, rigid=body.rigid)
            for a, b, body in zip(starts[:-1], starts[1:], scene.bodies, strict=True)
        ]
        mobility = np.ones(len(self.kept))
        np.minimum.at(mobility, self.place, scene._mobility)
        self.surface = Surface(
            about_centre(scene._rest)[0][self.kept],
            faces,
            bodies=bodies,
            mobility=mobility,
            mode=options.mode,
            leave_rest=options.rest_contacts == "leave",
            ignored=scene.ignored,
            direction=scene._direction[self.kept] if scene._direction.any() else None,
        )
        if options.method == "paper":
            from dtrepair.repair.paper.method import PaperMethod

            self.method: Any = PaperMethod(self.surface, options, queue=scene.queue)
        else:
            limit = options.maximum_displacement
            self.method = FullMethod(
                self.surface,
                rounds=options.tighten,
                farthest=None if limit is None else limit / self.surface.size,
                clearance=options.clearance / self.surface.size,
                skip=options.skip,
            )

    def solve(self, poses: Sequence[FloatArray]) -> list[tuple[FloatArray, Solved]]:
        """Repaired poses (V, 3); vertices that stayed where they were keep every bit."""
        units = [points[self.kept] / self.surface.size for points in poses]
        if isinstance(self.method, FullMethod):
            found = [self.method(unit) for unit in units]
        else:
            found = self.method.batch(units)
        return [(self._placed(*each), each[2]) for each in zip(poses, units, found, strict=True)]

    def _placed(self, points: FloatArray, unit: FloatArray, solved: Solved) -> FloatArray:
        """What was found for a pose, as points (V, 3)."""
        solved.points = self.surface.rigid.fitted(unit, solved.points)
        stayed = (solved.points == unit).all(axis=1)[self.place]
        final = (solved.points * self.surface.size)[self.place]
        return np.where(stayed[:, None], points, final)
