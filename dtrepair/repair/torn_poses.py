"""Single poses whose bodies are led apart otherwise where solving tore them, or left pairs."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dtrepair.intersect.proximity import close_pairs
from dtrepair.numerics.geometry import FloatArray, IntArray, extent
from dtrepair.numerics.metrics import displacements, edge_log_ratio
from dtrepair.repair.result import Solved
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh
from dtrepair.repair.separation.penetration import BodyShape, find_inside
from dtrepair.repair.separation.separation import SeparationOptions, separated_frames
from dtrepair.repair.separation.untangling import contact_counts, tangled_contacts
from dtrepair.repair.surface.surface import BoolArray


@dataclass(frozen=True, kw_only=True)
class TornOptions:
    """Which bodies are torn.

    Args:
        changed: Those whose edges changed by more, the rms of the logarithms of their ratios.
        sides: What is pressed by so many other bodies has no way out, and is left as it is.
        pressed: Distance of a body that presses, as a fraction of the size of the torn one.
    """

    changed: float = 0.1
    sides: int = 3
    pressed: float = 0.01


class LedPose(NamedTuple):
    """A pose of several bodies on its way to be solved.

    opened: as it came; start: with its enclosed parts led out (V, 3); separation, options: numbers.
    """

    scene: Scene
    mesh: WeldedMesh
    opened: OpenedPose
    start: FloatArray
    separation: SeparationOptions
    options: TornOptions

    def separated(
        self,
        points: FloatArray,
        pairs: IntArray,
        sheets: frozenset[int] = frozenset(),
        tangled: frozenset[tuple[int, int]] = frozenset(),
    ) -> FloatArray:
        """Return a pose (V, 3) with `pairs` (K, 2) whose penetrating bodies are led apart."""
        frames = separated_frames(
            self.scene,
            self.mesh,
            points[None],
            [pairs],
            np.zeros(1),
            sheets=sheets,
            tangled=tangled,
            options=self.separation,
        )
        pose: FloatArray = frames[0]
        return pose

    def improved(
        self, found: tuple[FloatArray, Solved], separated: FloatArray
    ) -> tuple[FloatArray, Solved]:
        """Return what was found; where it is torn or has pairs, with sheets led apart if better.

        Bodies that are not concerned, nor meet those that are, stay where they were found.
        """
        scene, pairs = self.scene, self.opened.pairs
        judged = self._judged(found[0])
        torn = judged.stretched >= self.options.changed
        if torn.any():
            torn &= ~squeezed(self.mesh, found[0], torn, options=self.options)
        troubled = {*np.flatnonzero(torn).tolist(), *scene.body_of[judged.pairs].ravel().tolist()}
        if not troubled:
            return found
        met, counts = contact_counts(scene.body_of, pairs)
        concerned = np.isin(met, list(troubled)).any(axis=1)
        fresh = [*troubled, *met[concerned].ravel()]
        again = np.isin(scene.body_of_vertex, fresh)
        other = self.separated(
            np.where(again[:, None], self.start, found[0]),
            pairs[np.isin(scene.body_of[pairs], fresh).any(axis=1)],
            frozenset(troubled),
            self._tangled((met[concerned], counts[concerned]), judged.pairs, torn=bool(torn.any())),
        )
        if np.array_equal(other[again], separated[again]):
            return found
        solved = self.mesh.solve([other])[0]
        return solved if self._judged(solved[0]).rank < judged.rank else found

    def _tangled(
        self, met: tuple[IntArray, IntArray], left: IntArray, *, torn: bool
    ) -> frozenset[tuple[int, int]]:
        """Return which bodies that met are tangled, by the pairs (K, 2) that are left.

        What was torn but came apart is tangled only where next to nothing is inside of the other.
        """
        options = self.separation.untangling
        still = contact_counts(self.scene.body_of, self.opened.pairs if torn else left)
        stuck = tangled_contacts([met], [still], options=options)
        return frozenset(both for both in stuck if len(left) or self._passes_through(*both))

    def _passes_through(self, first: int, second: int) -> bool:
        """Return whether at most a small fraction of either body is inside of the other."""
        options = self.separation
        one, other = BodyShape(self.scene, first), BodyShape(self.scene, second)
        inside = [
            find_inside(self.start, *both, options=options.penetration)
            for both in ((one, other), (other, one))
        ]
        return max(found.fraction for found in inside) < options.fraction

    def _judged(self, points: FloatArray) -> _Judged:
        """Return what a pose (V, 3) is worth beside the start."""
        scene, mesh, start = self.scene, self.mesh, self.start
        surface = mesh.surface
        old, new = start[mesh.kept], points[mesh.kept]
        body_of_edge = surface.body_of_vertex[surface.edges[:, 0]]
        parts = np.split(surface.edges, np.searchsorted(body_of_edge, range(1, len(scene.bodies))))
        own = [slice(*ends) for ends in pairwise(scene.vertex_starts)]
        return _Judged(
            scene.pairs(points, scene.weld(points)),
            np.array([edge_log_ratio(old, new, edges) for edges in parts]),
            np.array([displacements(start[part], points[part]).mean() for part in own]),
        )


class _Judged(NamedTuple):
    """Pairs (K, 2) of a pose; change of the edges, and mean motion, of each body (B,)."""

    pairs: IntArray
    stretched: FloatArray
    moved: FloatArray

    @property
    def rank(self) -> tuple[int, float]:
        """Pairs first, then what the worst body changed and moved: smaller is better."""
        return len(self.pairs), float((self.stretched + self.moved).max())


def squeezed(
    mesh: WeldedMesh,
    points: FloatArray,
    torn: BoolArray,
    *,
    options: TornOptions = TornOptions(),
) -> BoolArray:
    """Return which bodies (B,) are pressed from many sides in a pose (V, 3).

    What is near is measured by the smallest of the `torn` (B,) bodies.
    """
    surface = mesh.surface
    bodies = [surface.bodies[body] for body in np.flatnonzero(torn)]
    smallest = min(extent(points[mesh.kept[own.start : own.stop]]) for own in bodies)
    written = points[mesh.kept].astype(np.float32)
    close = close_pairs(surface.detector, written, options.pressed * smallest)
    sides = contact_counts(surface.body_of, close)[0].ravel()
    return np.bincount(sides, minlength=len(torn)) >= options.sides
