"""Which of two bodies is worn by the other, and whether leading them apart would take it off."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.geometry import FloatArray, IntArray
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

    def takes_off(self, first: int, second: int, before: FloatArray, after: FloatArray) -> bool:
        """Return whether one of two bodies, worn in the rest, goes round the other no longer.

        before, after: poses (V, 3). A ring that is rigid or stiff may have to leave: it cannot
        give way.
        """
        worn = self.of(first, second)
        if worn is None:
            return False
        kept = self._options.kept * self._around(worn, before)
        return self._around(worn, after) < kept

    def companions(self, body: int, other: int) -> tuple[int, ...]:
        """Return a body, and what goes along when it leaves another one: what one of them wears.

        Only itself where it and the other belong to one dress.
        """
        dress = self._dresses[body]
        if dress == self._dresses[other]:
            return (body,)
        along = (self._dresses == dress) & ~self._scene.never_moves
        along[body] = True
        return tuple(np.flatnonzero(along).tolist())

    @cached_property
    def _dresses(self) -> IntArray:
        """The dress that each body belongs to (B,): who wears something, and all that is worn."""
        scene = self._scene
        near = boxes_of(scene.rest, scene.vertex_starts)
        low, high = near[:, 0], near[:, 1]
        meet = ((low[:, None] <= high) & (high[:, None] >= low)).all(axis=2)
        pairs = np.argwhere(np.triu(meet, 1)).tolist()
        links = [own for own in pairs if self.of(*own) is not None]
        covering = scene.covering
        if covering is not None:
            body = np.zeros(len(covering.over), dtype=np.int64)
            body[covering.part] = scene.body_of_vertex
            links += body[np.argwhere(covering.over)].tolist()
        count = len(scene.bodies)
        rows, columns = np.array(links, dtype=np.int64).reshape(-1, 2).T
        graph = sparse.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count))
        return np.asarray(csgraph.connected_components(graph, directed=False)[1])

    def _around(self, both: tuple[int, int], points: FloatArray) -> float:
        """Return how much the first of two bodies goes round the second in a pose (V, 3)."""
        outer, inner = (self._shape(body) for body in both)
        solids = (Solid(points, shape.faces, shape.closed) for shape in (outer, inner))
        return worn_measure(*solids, options=self._options).share
