"""Two bodies of a pose that go deep into each other: what is inside, and the ways out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import FloatArray, IntArray, triangle_areas
from dtrepair.numerics.metrics import volume
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.surface.rays import exits_along, frame_along, windings


@dataclass(frozen=True, kw_only=True)
class PenetrationOptions:
    """How many vertices and directions are looked at; rays cost the most here.

    Args:
        inside_probes: Vertices that are looked at to find what is inside.
        ranking_probes: Vertices that rank directions.
        length_probes: Vertices that measure the best directions.
        best: Directions that are compared in all poses.
        nudges: The best one is turned by about so much, radians, as long as that is shorter.
    """

    inside_probes: int = 600
    ranking_probes: int = 16
    length_probes: int = 120
    best: int = 10
    nudges: tuple[float, ...] = (0.25, 0.1)


Vertices = NDArray[np.integer]


class BodyShape:
    """One body as it is at rest.

    Args:
        scene: The scene that `vertices` and `faces` (F, 3) are numbered in.
        body: Which one.
    """

    def __init__(self, scene: Scene, body: int) -> None:
        own, triangles = scene.vertices_of(body), scene.triangles_of(body)
        self.vertices = np.arange(own.start, own.stop)
        self.faces: IntArray = scene.faces[triangles]
        parts = scene.enclosures.part_of_face[triangles]
        self.closed = bool(scene.enclosures.closed[parts].all())
        self.rest = scene.rest

    @cached_property
    def area(self) -> float:
        """Area of the surface at rest."""
        return float(triangle_areas(self.rest, self.faces).sum())

    @cached_property
    def thickness(self) -> float:
        """Twice the volume over the area: the thickness of a sheet, the radius of a rod."""
        return 2.0 * abs(volume(self.rest, self.faces)) / (self.area or 1.0)


class Inside(NamedTuple):
    """Vertices of one body inside another.

    Args:
        vertices: Which ones; of many a sample.
        depth: How deep the deepest is, length units.
        width: Root mean square of their second widest extent, length units.
        fraction: Of the vertices of the body, how many are inside.
    """

    vertices: Vertices
    depth: float
    width: float
    fraction: float


def find_inside(
    points: FloatArray,
    inner: BodyShape,
    outer: BodyShape,
    *,
    options: PenetrationOptions = PenetrationOptions(),
) -> Inside:
    """Return what of a body of a pose (V, 3) is inside another.

    Nothing is inside a body that is not closed.
    """
    none = Inside(np.zeros(0, dtype=np.int64), 0.0, 0.0, 0.0)
    if not outer.closed:
        return none
    around = points[outer.vertices]
    low, high = around.min(axis=0), around.max(axis=0)
    own = points[inner.vertices]
    near = inner.vertices[((own > low) & (own < high)).all(axis=1)]
    if len(near) == 0:
        return none
    looked = picked(near, options.inside_probes)
    found = looked[windings(points[looked], points[outer.faces]) > 0]
    if len(found) == 0:
        return none
    depth = float(cKDTree(around).query(points[found])[0].max())
    offsets = points[found] - points[found].mean(axis=0)
    width = float(np.linalg.svd(offsets, compute_uv=False)[1:2].sum()) / len(found) ** 0.5
    fraction = len(found) / len(looked) * len(near) / len(inner.vertices)
    return Inside(found, depth, width, fraction)


class Penetration:
    """Two bodies in some poses, `first` to be moved out of `second` along a direction.

    Args:
        first: The body that moves.
        second: The other one.
        poses: Poses (V, 3).
        inside: What of the first is inside of the second, and the reverse, in each of them.
        options: How much is looked at.
    """

    def __init__(
        self,
        first: BodyShape,
        second: BodyShape,
        poses: list[FloatArray],
        inside: list[tuple[Inside, Inside]],
        *,
        options: PenetrationOptions = PenetrationOptions(),
    ) -> None:
        self.first, self.second, self.poses, self.inside = first, second, poses, inside
        self._options = options

    def directions(self) -> list[FloatArray]:
        """Return unit directions (3,), the one with the least motion over all poses first.

        Candidates are 26 directions, the axes of the first body and the ways to the surface.
        """
        few = self._options.ranking_probes
        found = self._candidates()
        units = [way / np.linalg.norm(way) for way in found if np.linalg.norm(way) > 1e-12]
        deepest = [max(mine.depth, theirs.depth) for mine, theirs in self.inside]
        worst = int(np.argmax(deepest))
        units.sort(key=lambda way: self.length(worst, way, probes=few))
        near = units[: self._options.best]
        ranked = sorted((self._cost(way), index) for index, way in enumerate(near))
        cost, best = ranked[0][0], units[ranked[0][1]]
        for nudge in self._options.nudges:
            for side in frame_along(best).T[1:]:
                for trial in (best + nudge * side, best - nudge * side):
                    trial /= np.linalg.norm(trial)
                    value = self._cost(trial)
                    if value < cost:
                        cost, best = value, trial
        return [best, *(units[index] for _, index in ranked)]

    def _candidates(self) -> list[FloatArray]:
        found = [np.array(way, dtype=np.float64) for way in product((-1, 0, 1), repeat=3)]
        for points, (mine, theirs) in zip(self.poses, self.inside, strict=True):
            body = points[self.first.vertices]
            axes = np.linalg.svd(body - body.mean(axis=0), full_matrices=False)[2]
            found += [*axes, *-axes]
            for inside, other, sign in ((mine, self.second, 1.0), (theirs, self.first, -1.0)):
                if len(inside.vertices):
                    tree = cKDTree(points[other.vertices])
                    place = tree.query(points[inside.vertices])[1]
                    offsets = points[other.vertices[place]] - points[inside.vertices]
                    found += [sign * offsets.mean(axis=0)]
        return found

    def length(self, index: int, direction: FloatArray, *, probes: int | None = None) -> float:
        """Return how far the first body has to go in a pose until nothing known is inside.

        `probes` vertices are looked at.
        """
        count = self._options.length_probes if probes is None else probes
        points, (mine, theirs) = self.poses[index], self.inside[index]
        farthest = 0.0
        for found, other, sign in ((mine, self.second, 1.0), (theirs, self.first, -1.0)):
            if len(found.vertices):
                starts = points[picked(found.vertices, count)]
                exits = exits_along(sign * direction, starts, points[other.faces])
                farthest = max(farthest, float(exits.max()))
        return farthest

    def _cost(self, direction: FloatArray) -> float:
        """Return the sum of squared lengths over the poses, by a few vertices."""
        few = self._options.ranking_probes
        return sum(self.length(k, direction, probes=few) ** 2 for k in range(len(self.poses)))


def picked(vertices: Vertices, count: int) -> Vertices:
    """Return at most `count` vertices spread evenly over the given ones."""
    if len(vertices) <= count:
        return vertices
    return vertices[np.linspace(0, len(vertices) - 1, count).round().astype(np.int64)]


def shares_of_way(scene: Scene, shapes: tuple[BodyShape, BodyShape]) -> tuple[float, float] | None:
    """Return the fractions of a way that two bodies go; None where neither may move.

    The least sum of squared displacements over both surfaces: the larger one goes less.
    """
    freedom = []
    for shape in shapes:
        if scene.direction[shape.vertices].any():
            return None
        mobility = scene.mobility[shape.vertices]
        whole = mobility.min() == mobility.max()
        freedom.append(mobility.min() / (shape.area or 1.0) if whole else 0.0)
    total = sum(freedom)
    return None if total == 0.0 else (freedom[0] / total, freedom[1] / total)
