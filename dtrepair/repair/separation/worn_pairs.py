"""Which of two bodies is worn by the other or fitted to one, and whether a shift takes it off."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import FloatArray, diagonal
from dtrepair.numerics.recent import Recent
from dtrepair.numerics.scale import boxes_of
from dtrepair.numerics.worn.measure import Solid, WornOptions, worn_measure
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.separation.penetration import BodyShape


class WornPairs:
    """Answers for the bodies of a scene; what the rest tells of two of them is found once.

    Args:
        scene: The bodies.
        shape: The shape of a body.
        options: From when on a body is worn.
    """

    def __init__(
        self, scene: Scene, shape: Callable[[int], BodyShape], options: WornOptions
    ) -> None:
        self._scene, self._shape, self._options = scene, shape, options
        # Of two bodies the worn one and its wearer; None where neither is worn.
        self._known: dict[tuple[int, int], tuple[int, int] | None] = {}
        self._dresses: dict[int, tuple[int, ...]] = {}
        self._fitted: dict[int, bool] = {}
        self._trees: dict[int, cKDTree] = {}
        # Many shifts of one pose are asked for.
        self._before: dict[tuple[int, int], Recent[float]] = {}

    def of(self, first: int, second: int) -> tuple[int, int] | None:
        """Return the worn one of two bodies and its wearer, by the rest; None where none is."""
        both = first, second
        if both not in self._known:
            self._known[both] = None
            soft = not any(self._scene.is_stiff(body) for body in both)
            for order in (both, both[::-1]) if soft else ():
                if self._around(order, self._scene.rest) >= self._options.worn:
                    self._known[both] = order
        return self._known[both]

    def goes_round(self, body: int) -> bool:
        """Return whether a body is worn by another one."""
        solid = np.diff(self._scene.triangle_starts) > 0
        others = np.flatnonzero(self._near[body] & solid & solid[body]).tolist()
        found = (self.of(min(body, other), max(body, other)) for other in others if other != body)
        return any(own is not None and own[0] == body for own in found)

    def takes_off(self, first: int, second: int, before: FloatArray, after: FloatArray) -> bool:
        """Return whether one of two bodies, worn in the rest, goes round the other no longer.

        before, after: poses (V, 3). A ring that is rigid or stiff may have to leave: it cannot
        give way.
        """
        worn = self.of(first, second)
        if worn is None:
            return False
        known = self._before.setdefault(worn, Recent())
        kept = self._options.kept * known(partial(self._around, worn), before)
        return self._around(worn, after, least=kept) < kept

    def fitted(self, body: int) -> bool:
        """Return whether a body lies close on a far larger soft one in the rest, as a plate does.

        Half of its vertices are near the other: of what only touches it, as a ball a floor, few.
        """
        if body not in self._fitted:
            scene, own = self._scene, self._shape(body)
            points = scene.centred_rest[own.vertices]
            near = self._options.near * diagonal(points)
            self._fitted[body] = any(
                self._shape(other).area >= self._options.larger * own.area
                and not (scene.is_stiff(other) or scene.never_moves[other])
                and self._close(other, points, near)
                for other in range(len(scene.bodies))
                if other != body and len(self._shape(other).faces)
            )
        return self._fitted[body]

    def _close(self, body: int, points: FloatArray, near: float) -> bool:
        """Return whether half of points (N, 3) are so near vertices of a body at rest."""
        own = self._scene.centred_rest[self._shape(body).vertices]
        if body not in self._trees:
            self._trees[body] = cKDTree(own)
        near = min(near, self._options.close * diagonal(own))
        found = self._trees[body].query(points, distance_upper_bound=near)[0]
        return bool(np.median(found) < near)

    def companions(self, body: int, other: int) -> tuple[int, ...]:
        """Return a body, and what goes along when it leaves another one: what one of them wears.

        Only itself where it and the other belong to one dress, or something of it is held.
        """
        dress = self._dress(body)
        vertices = np.concatenate([self._shape(own).vertices for own in dress])
        if other in dress or (self._scene.mobility[vertices] < 1.0).any():
            return (body,)
        return dress

    def hangs(self, body: int, other: int, cluster: NDArray[np.integer]) -> bool:
        """Return whether a body, or what goes along when it leaves another, is attached to more.

        cluster: what is attached together (B,), a number for each body.
        """
        own = list(self.companions(body, other))
        return bool(np.isin(np.delete(cluster, own), cluster[own]).any())

    def _dress(self, body: int) -> tuple[int, ...]:
        """Return the bodies, this one among them, that wear each other."""
        if body not in self._dresses:
            found = [body]
            for own in found:
                near = set(np.flatnonzero(self._near[own]).tolist()) - set(found)
                found += [k for k in sorted(near) if self._covers[own, k] or self.of(own, k)]
            self._dresses |= dict.fromkeys(found, tuple(sorted(found)))
        return self._dresses[body]

    @cached_property
    def _near(self) -> NDArray[np.bool_]:
        """Of which bodies (B, B) the middle of one is in the box of the other at rest."""
        low, high = np.moveaxis(boxes_of(self._scene.rest, self._scene.vertex_starts), 1, 0)
        middle = 0.5 * (low + high)
        inside = ((low <= middle[:, None]) & (middle[:, None] <= high)).all(axis=2)
        return np.asarray(inside | inside.T | self._covers)

    @cached_property
    def _covers(self) -> NDArray[np.bool_]:
        """Of which bodies (B, B) one lies over the other as an open layer."""
        over = covered_bodies(self._scene)
        return over | over.T

    def _around(self, both: tuple[int, int], points: FloatArray, *, least: float = 0.0) -> float:
        """Return how much the first of two bodies goes round the second in a pose (V, 3).

        least: smaller ones may be told as zero.
        """
        outer, inner = (self._shape(body) for body in both)
        solids = (Solid(points, shape.faces, shape.closed) for shape in (outer, inner))
        return worn_measure(*solids, least=least, options=self._options).share


def covered_bodies(scene: Scene) -> NDArray[np.bool_]:
    """Return of which bodies (B, B) something of the first lies over the second as cloth does."""
    covering, result = scene.covering, np.zeros((len(scene.bodies),) * 2, dtype=bool)
    if covering is not None:
        body = np.zeros(len(covering.over), dtype=np.int64)
        body[covering.part] = scene.body_of_vertex
        upper, lower = body[np.argwhere(covering.over)].reshape(-1, 2).T
        result[upper, lower] = True
    return result
