"""What is far from every contact goes back to where it was, if the way there is gentle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.geometry import FloatArray, IntArray, lengths
from dtrepair.repair.full.acceptance import (
    acceptable,
    changed_defects,
    roll_back,
)
from dtrepair.repair.full.biharmonic_fill import Filled
from dtrepair.repair.surface.defects import Defects
from dtrepair.repair.surface.surface import BoolArray, Surface


@dataclass(frozen=True, kw_only=True)
class SettleOptions:
    """Numbers of the settling of what touches nothing.

    Args:
        bands: Distances along the surface from what crossed, fractions of the diagonal, between
            which displacements fade out.
        quantile: Of the displacements beyond the near end of a band that counts, there and in the
            band alone: a few vertices may move farther.
        rings: What moves fades in over so many rings beside what is still.
    """

    bands: tuple[tuple[float, float], ...] = ((0.04, 0.15), (0.08, 0.25))
    quantile: float = 0.9
    rings: int = 6


class Settling:
    """What of an original pose may stay where it is, by its distance from crossing pairs."""

    def __init__(
        self,
        surface: Surface,
        original: FloatArray,
        triangles: IntArray,
        *,
        options: SettleOptions = SettleOptions(),
    ) -> None:
        """Take a pose (V, 3) and its triangles that cross others, at least one."""
        self.surface, self.original, self.options = surface, original, options
        size = surface.scale.diagonal(original)
        self._bands = [(near * size, far * size) for near, far in options.bands]
        # Ties are as good as edges: what is attached goes with its host.
        links = surface.neighbours.tocoo()
        length = lengths(original[links.row] - original[links.col])
        # Edges of no length would be none to the graph search.
        length = np.maximum(length, np.finfo(np.float64).tiny)
        self._graph = sparse.csr_matrix((length, (links.row, links.col)), shape=links.shape)
        sources = np.flatnonzero(surface.vertices_of(triangles))
        self.distance = csgraph.dijkstra(self._graph, indices=sources, min_only=True)

    def __call__(
        self, points: FloatArray, known: Defects, *, folds: int, strain: float
    ) -> tuple[Filled, BoolArray]:
        """Return a clean pose (V, 3) with what is far back in its place, and what is still (V,).

        A connected part beyond a band goes back if that strains the band by at most `strain`; else
        it is a limb that is carried. What collides is rolled back around it. known: the defects of
        `points`; folds: so many are allowed.
        """
        surface, original = self.surface, self.original
        still = np.zeros(surface.count, dtype=bool)
        for near, far in self._bands:
            kept = self._kept(points, near, far, strain)[:, None]
            pose = np.where(kept > 0.0, original + kept * (points - original), original)
            pose = np.where(kept < 1.0, pose, points)
            defects = changed_defects(surface, known, points, pose)
            if not acceptable(defects, folds):
                found = roll_back(surface, points, pose, defects, folds=folds)
                if found is None:
                    continue
                pose, defects = found
            points, known = pose, defects
            still |= (kept[:, 0] == 0.0) & (points == original).all(axis=1)
        return Filled(points, known), still

    def reach(self, still: BoolArray) -> FloatArray:
        """Return how freely vertices (V,) may move on: 0 where they are still, fading in beside."""
        rings = self.options.rings
        fading = self.surface.rings_from(still, rings) / rings
        return np.where(self.surface.stiff, 0.0, fading)

    def kept(self, points: FloatArray, strain: float) -> FloatArray:
        """Return the fraction (V,) of the displacements of a pose (V, 3) that is kept."""
        kept = np.ones(self.surface.count)
        for near, far in self._bands:
            kept = np.minimum(kept, self._kept(points, near, far, strain))
        return kept

    def _kept(self, points: FloatArray, near: float, far: float, strain: float) -> FloatArray:
        """Return the fraction (V,) of the displacements that is kept with one band."""
        moved, distance = lengths(points - self.original), self.distance
        share = np.clip((distance - near) / (far - near), 0.0, 1.0)
        fading = 1.0 - share * share * (3.0 - 2.0 * share)
        beyond = np.flatnonzero((distance > near) & ~self.surface.stiff)
        count, part_of = csgraph.connected_components(
            self._graph[beyond][:, beyond], directed=False
        )
        gone = np.zeros(count)
        for some in (np.ones(len(beyond), dtype=bool), distance[beyond] < far):
            quantile = _quantiles(moved[beyond[some]], part_of[some], self.options.quantile)
            gone[: len(quantile)] = np.maximum(gone[: len(quantile)], quantile)
        kept = np.ones(self.surface.count)
        back = beyond[(gone <= strain * (far - near))[part_of]]
        kept[back] = fading[back]
        return kept


def _quantiles(values: FloatArray, group: IntArray, quantile: float) -> FloatArray:
    """Return a quantile of the values (K,) of each group, given by number; 0 of an empty one."""
    sizes = np.bincount(group)
    ordered = values[np.lexsort((values, group))]
    rank = np.cumsum(sizes) - sizes + (quantile * np.maximum(sizes - 1, 0)).astype(np.int64)
    return np.where(sizes > 0, np.append(ordered, 0.0)[rank], 0.0)
