"""Edges that a repair crushed or drew out, and the smallest motion that gives them length again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.repair.elastic.least_motion import LeastMotion
from dtrepair.repair.surface.surface import BoolArray, Surface


@dataclass(frozen=True, kw_only=True)
class EdgeLengthOptions:
    """What counts as a spoilt edge, and the steps that cure one.

    Args:
        factor: Edges longer or shorter by more than this are spoilt.
        cured: Factor that they are brought to, well off the limit.
        least: Edges that are shorter than this before and after do not count, units of the size.
        steps: Most steps: the lengths are nonlinear.
        largest_change: Of an edge in a step, next to its length in the original.
        largest_motion: Of a vertex in a step, mean edge lengths.
        most_edges: Edges cured in a step, the worst ones: the dense system is of their number.
    """

    factor: float = 4.0
    cured: float = 3.0
    least: float = 1e-5
    steps: int = 8
    largest_change: float = 0.25
    largest_motion: float = 0.5
    most_edges: int = 64


class EdgeLengths:
    """The lengths of a surface's edges next to those of an original pose (V, 3)."""

    def __init__(
        self,
        surface: Surface,
        original: FloatArray,
        *,
        options: EdgeLengthOptions = EdgeLengthOptions(),
    ) -> None:
        self.surface, self.options, self.allowed = surface, options, 0
        self.given = np.maximum(self._lengths(original), 1e-12)

    def excess(self, points: FloatArray) -> tuple[int, float]:
        """Return how many edges are spoilt, and by how much too far: smaller is better."""
        change = self._changes(points)
        beyond = change[change > np.log(self.options.factor)]
        return len(beyond), float(beyond.sum())

    def clusters(self, points: FloatArray) -> list[NDArray[np.intp]]:
        """Return the spoilt edges, those that meet together; small clusters come first."""
        surface = self.surface
        spoilt = np.flatnonzero(self._changes(points) > np.log(self.options.factor))
        spoilt = spoilt[~surface.stiff[surface.edges[spoilt]].all(axis=1)]
        labels = surface.components(self.vertices(spoilt))[surface.edges[spoilt, 0]]
        return sorted((spoilt[labels == label] for label in np.unique(labels)), key=len)

    def vertices(self, chosen: NDArray[np.integer]) -> BoolArray:
        """Return the vertices (V,) of some edges."""
        mask = np.zeros(self.surface.count, dtype=bool)
        mask[self.surface.edges[chosen].ravel()] = True
        return mask

    def cured(self, points: FloatArray, chosen: NDArray[np.integer], rings: int) -> FloatArray:
        """Return the pose (V, 3) with the `chosen` edges cured, contacts ignored.

        Only what is within so many rings of them moves: by the least motion that brings all edges
        there within the factor, Gauss-Newton on their lengths.
        """
        options = self.options
        region = LeastMotion(
            self.surface, self.vertices(chosen), rings, largest=options.largest_motion
        )
        nearby = np.flatnonzero(region.meets(self.surface.edges))
        given, ends = self.given[nearby], self.surface.edges[nearby]
        for _ in range(options.steps):
            vectors = points[ends[:, 1]] - points[ends[:, 0]]
            now = np.maximum(lengths(vectors), 1e-12)
            lacking = np.clip(now, given / options.cured, given * options.cured) - now
            worst = np.argsort(-np.abs(np.log(now / given)), kind="stable")
            worst = worst[lacking[worst] != 0.0][: options.most_edges]
            if len(worst) == 0:
                break
            most = options.largest_change * given[worst]
            along = vectors[worst] / now[worst, None]
            gradients = np.stack([-along, along], axis=1)
            changes = np.clip(lacking[worst], -most, most)
            points = region.step(points, ends[worst], gradients, changes)
        return points

    def _changes(self, points: FloatArray) -> FloatArray:
        """Return the logarithm (E,) of the factor by which edges are longer or shorter."""
        now = self._lengths(points)
        change = np.abs(np.log(np.maximum(now, 1e-12) / self.given))
        small = np.maximum(now, self.given) < self.options.least
        return np.where(small, 0.0, change)

    def _lengths(self, points: FloatArray) -> FloatArray:
        first, second = self.surface.edges.T
        return lengths(points.take(first, axis=0) - points.take(second, axis=0))
