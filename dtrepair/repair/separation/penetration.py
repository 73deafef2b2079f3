"""Two bodies of a pose that go deep into each other: what is inside, and the ways out."""

from __future__ import annotations

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

# Vertices that are looked at: to find what is inside, to rank ways, and to measure the best ones.
MANY, FEW, SOME = 600, 16, 120
# So many ways are compared in all poses; the best is turned by these parts of a radian.
BEST, NUDGES = 10, (0.25, 0.1)

Vertices = NDArray[np.integer]


class Shape:
    """One body as it is at rest: vertices start..stop of the scene, faces (F, 3) of the scene."""

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

    How deep the deepest is, the root mean square of their second widest extent, and which part of
    the body they are.
    """

    vertices: Vertices
    depth: float
    width: float
    part: float


def find_inside(points: FloatArray, inner: Shape, outer: Shape) -> Inside:
    """What of a body of a pose (V, 3) is inside another; of a large one a sample is looked at.

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
    looked = picked(near, MANY)
    found = looked[windings(points[looked], points[outer.faces]) > 0]
    if len(found) == 0:
        return none
    depth = float(cKDTree(around).query(points[found])[0].max())
    offsets = points[found] - points[found].mean(axis=0)
    width = float(np.linalg.svd(offsets, compute_uv=False)[1:2].sum()) / len(found) ** 0.5
    part = len(found) / len(looked) * len(near) / len(inner.vertices)
    return Inside(found, depth, width, part)


class Piercing:
    """Two bodies in some poses, `first` to be moved out of `second` along a way."""

    def __init__(
        self,
        first: Shape,
        second: Shape,
        poses: list[FloatArray],
        inside: list[tuple[Inside, Inside]],
    ) -> None:
        """Take poses (V, 3), and what is inside of each other in each of them."""
        self.first, self.second, self.poses, self.inside = first, second, poses, inside

    def ways(self) -> list[FloatArray]:
        """Unit directions (3,), the one with the least motion over all poses first.

        Candidates are 26 directions, the axes of the first body and the ways to the surface.
        """
        ways = [np.array(way, dtype=np.float64) for way in product((-1, 0, 1), repeat=3)]
        for points, (mine, theirs) in zip(self.poses, self.inside, strict=True):
            body = points[self.first.vertices]
            axes = np.linalg.svd(body - body.mean(axis=0), full_matrices=False)[2]
            ways += [*axes, *-axes]
            for found, other, sign in ((mine, self.second, 1.0), (theirs, self.first, -1.0)):
                if len(found.vertices):
                    tree = cKDTree(points[other.vertices])
                    place = tree.query(points[found.vertices])[1]
                    offsets = points[other.vertices[place]] - points[found.vertices]
                    ways += [sign * offsets.mean(axis=0)]
        units = [way / np.linalg.norm(way) for way in ways if np.linalg.norm(way) > 1e-12]
        deepest = [max(mine.depth, theirs.depth) for mine, theirs in self.inside]
        worst = int(np.argmax(deepest))
        units.sort(key=lambda way: self.length(worst, way, FEW))
        ranked = sorted((self._cost(way), index) for index, way in enumerate(units[:BEST]))
        cost, best = ranked[0][0], units[ranked[0][1]]
        for nudge in NUDGES:
            for side in frame_along(best).T[1:]:
                for trial in (best + nudge * side, best - nudge * side):
                    trial /= np.linalg.norm(trial)
                    value = self._cost(trial)
                    if value < cost:
                        cost, best = value, trial
        return [best, *(units[index] for _, index in ranked)]

    def length(self, index: int, way: FloatArray, count: int = SOME) -> float:
        """How far the first body has to go along a way in a pose until nothing known is inside."""
        points, (mine, theirs) = self.poses[index], self.inside[index]
        farthest = 0.0
        for found, other, sign in ((mine, self.second, 1.0), (theirs, self.first, -1.0)):
            if len(found.vertices):
                probes = points[picked(found.vertices, count)]
                exits = exits_along(sign * way, probes, points[other.faces])
                farthest = max(farthest, float(exits.max()))
        return farthest

    def _cost(self, way: FloatArray) -> float:
        """Sum of squared lengths over the poses, by a few vertices."""
        return sum(self.length(index, way, FEW) ** 2 for index in range(len(self.poses)))


def picked(vertices: Vertices, count: int) -> Vertices:
    """At most `count` vertices spread evenly over the given ones."""
    if len(vertices) <= count:
        return vertices
    return vertices[np.linspace(0, len(vertices) - 1, count).round().astype(np.int64)]
