"""What is attached is brought back to its place where a correction led it off.

Pushing opens contacts beside a joint, and the two parts of the joint slide. Of the displacements
near the smooth ones are taken that change those of the correction least and leave the ties of the
attachments as they were.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from dtrepair.numerics.geometry import FloatArray, lengths, vertex_areas
from dtrepair.numerics.operators import Factor, cotangent_laplacian
from dtrepair.repair.scene.scene import Scene


@dataclass(frozen=True, kw_only=True)
class HoldOptions:
    """How attached parts are brought back.

    Args:
        reach: The change fades out over this fraction of the diagonal of the rest.
        hold: Weight of the ties next to that of the change.
        time: Standard deviation, in frames, over which it comes and goes.
        unseen: Changes up to this fraction of the diagonal are left out: what is far stays.
    """

    reach: float = 0.02
    hold: float = 300.0
    time: float = 1.5
    unseen: float = 3e-5


def is_tied(scene: Scene) -> bool:
    """Return whether anything of a scene is tied to something else."""
    return scene.held is not None and scene.held.tied


class Holding:
    """Brings attached parts of a scene together; what it solves with is factored once."""

    def __init__(self, scene: Scene, *, options: HoldOptions = HoldOptions()) -> None:
        assert scene.attachments is not None
        self.scene, self.options = scene, options
        faces, count = scene.rest_weld[scene.faces], len(scene.rest)
        rest = scene.centred_rest
        self.size = size = scene.scale.diagonal(rest) or 1.0
        mass = np.maximum(vertex_areas(rest, faces), 1e-12 * size**2)
        laplacian = cotangent_laplacian(rest, faces, clamp=(1e-3, 1e3))
        smooth = laplacian @ sparse.diags(1.0 / mass) @ laplacian
        vertices, triangles, weights, _ = scene.attachments.ties
        rows = np.arange(len(vertices))
        every = np.concatenate([rows, np.repeat(rows, 3)])
        ends = np.concatenate([vertices, faces[triangles].ravel()])
        values = np.concatenate([np.ones(len(rows)), -weights.ravel()])
        self.ties = sparse.csr_matrix((values, (every, ends)), shape=(len(rows), count))
        self.pull = options.hold * self.ties.T @ sparse.diags(mass[vertices])
        fixed = np.where(scene.mobility == 0.0, 1e6, 0.0)
        system = sparse.diags(mass * (1.0 + fixed)) + (options.reach * size) ** 4 * smooth
        self._factor = Factor(system + self.pull @ self.ties)

    def __call__(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return the change (V, 3) of a correction that brings attached parts together."""
        off = self.ties @ (after - before)[self.scene.rest_weld]
        change = -self._factor(self.pull @ off)[self.scene.rest_sewn]
        return np.where(lengths(change)[:, None] > self.options.unseen * self.size, change, 0.0)
