"""Edges between two triangles, how far they are bent, and the smallest motion that opens them."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray, cross, dots, lengths, triangle_normals
from dtrepair.repair.elastic.least_motion import LeastMotion
from dtrepair.repair.surface.surface import BoolArray, Surface


@dataclass(frozen=True, kw_only=True)
class DihedralOptions:
    """What counts as a bent edge, and the steps that open one.

    Args:
        sharp: Cosine of the angle between the normals of an edge's triangles, 120 degrees. Beyond
            it an edge counts as bent: it is seen as a crease, and the next motion folds it flat.
        open_angle: Angle to which bent edges are opened, radians: 90 degrees, well off the limit.
        steps: Most steps of opening; the angles are nonlinear.
        largest_turn: Of an edge in a step, radians, within which its gradient holds.
        largest_motion: Of a vertex in a step, mean edge lengths.
        most_edges: Edges opened in a step, the sharpest ones: the dense system is of their number.
        beyond: How much farther than needed a step aims, radians, so that the last one arrives.
    """

    sharp: float = -0.5
    open_angle: float = pi / 2
    steps: int = 8
    largest_turn: float = 0.35
    largest_motion: float = 0.5
    most_edges: int = 64
    beyond: float = 0.02


class DihedralAngles:
    """The inner edges of a surface and how far an original pose (V, 3) bends them."""

    def __init__(
        self,
        surface: Surface,
        original: FloatArray,
        *,
        options: DihedralOptions = DihedralOptions(),
    ) -> None:
        """Allow the edges that the original bends to stay bent, and as many as it has."""
        self.surface, self.options = surface, options
        self.corners = _corners(surface.faces, surface.edge_pairs)
        cosines = _cosines(surface, original)
        self.given = cosines < options.sharp
        self.allowed = int(self.given.sum())
        self._limits = np.maximum(options.open_angle, np.arccos(np.clip(cosines, -1.0, 1.0)))

    def excess(self, points: FloatArray) -> tuple[int, float]:
        """Return how many edges are bent, and by how much too far: smaller is better."""
        cosines = _cosines(self.surface, points)
        excess = self.options.sharp - cosines[cosines < self.options.sharp]
        return len(excess), float(excess.sum())

    def clusters(self, points: FloatArray) -> list[NDArray[np.intp]]:
        """Return the edges that are bent and were not in the original, those that meet together.

        Small clusters come first.
        """
        surface = self.surface
        new = np.flatnonzero(bent_edges(surface, points, sharp=self.options.sharp) & ~self.given)
        new = new[~surface.stiff[self.corners[new]].all(axis=1)]
        labels = surface.components(self.vertices(new))[self.corners[new, 0]]
        return sorted((new[labels == label] for label in np.unique(labels)), key=len)

    def vertices(self, chosen: NDArray[np.integer]) -> BoolArray:
        """Return the vertices (V,) of the triangles of some edges."""
        return self.surface.vertices_of(self.surface.edge_pairs[chosen])

    def cured(self, points: FloatArray, chosen: NDArray[np.integer], rings: int) -> FloatArray:
        """Return the pose (V, 3) with the `chosen` edges opened, contacts ignored.

        Only what is within so many rings of them moves. Each step is the motion x of least
        tr(x^T (L + anchor M) x) that turns all edges there to the open angle, or as far as the
        original has them, which are bent beyond that and were not bent edges: Gauss-Newton on
        their angles.
        """
        options = self.options
        region = LeastMotion(
            self.surface, self.vertices(chosen), rings, largest=options.largest_motion
        )
        nearby = region.meets(self.corners) & ~self.given
        limits, near = self._limits[nearby], self.corners[nearby]
        for _ in range(options.steps):
            angles, gradients = angles_and_gradients(points, near)
            excess = np.abs(angles) - limits
            bent = np.argsort(-excess, kind="stable")[: options.most_edges]
            bent = bent[excess[bent] > 0.0]
            if len(bent) == 0:
                break
            turns = np.sign(angles[bent]) * -np.minimum(
                excess[bent] + options.beyond, options.largest_turn
            )
            points = region.step(points, near[bent], gradients[bent], turns)
        return points


def bent_edges(
    surface: Surface, points: FloatArray, *, sharp: float = DihedralOptions.sharp
) -> BoolArray:
    """Return which hinges (H,) are bent farther than a cosine, by default that of 120 degrees."""
    return _cosines(surface, points) < sharp


def angles_and_gradients(points: FloatArray, corners: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the signed angle (H,) of the normals at each edge, radians, and gradient (H, 4, 3).

    corners: both ends of each edge and the third corners of its triangles (H, 4); the first
    triangle goes around from end to end to its corner (Wardetzky et al. 2007, section 4).
    """
    start, end, first, second = (points[corners[:, k]] for k in range(4))
    edge = end - start
    normals = cross(edge, first - start), cross(second - start, edge)
    length = np.maximum(lengths(edge), 1e-300)
    squares = [np.maximum(dots(normal, normal), 1e-300) for normal in normals]
    sine = dots(cross(*normals), edge) / length
    angles = np.arctan2(sine, dots(*normals))
    gradients = np.zeros((len(corners), 4, 3))
    for number, (normal, square, corner) in enumerate(
        zip(normals, squares, (first, second), strict=True)
    ):
        slope = normal / square[:, None]
        gradients[:, 0] -= (dots(corner - end, edge) / length)[:, None] * slope
        gradients[:, 1] += (dots(corner - start, edge) / length)[:, None] * slope
        gradients[:, 2 + number] = -length[:, None] * slope
    return angles, gradients


def _corners(faces: IntArray, hinges: NDArray[np.int64]) -> IntArray:
    """Return both ends of each hinge, as its first triangle goes, and third corners (H, 4)."""
    first, second = faces[hinges[:, 0]], faces[hinges[:, 1]]
    same = first[:, :, None] == second[:, None, :]
    own, other = (np.argmin(same.any(axis=axis), axis=1) for axis in (2, 1))
    row = np.arange(len(hinges))
    ends = [first[row, (own + step) % 3] for step in (1, 2)]
    return np.stack([*ends, first[row, own], second[row, other]], axis=1)


def _cosines(surface: Surface, points: FloatArray) -> FloatArray:
    """Return the cosine of the angle between the normals at each hinge (H,)."""
    normals = triangle_normals(points, surface.faces)
    first, second = surface.edge_pairs.T
    return dots(normals.take(first, axis=0), normals.take(second, axis=0))
