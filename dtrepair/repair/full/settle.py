"""What is far from every contact goes back to where it was, if the way there is gentle.

Before that goes back what a character moved by as a whole: contacts of its own parts do not ask for
it. Pushes of one contact seldom cancel each other to the last, and over many sweeps a light
character drifts along with them, farther than a gentle way is long.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.geometry import FloatArray, IntArray, lengths, triangle_normals
from dtrepair.repair.full.acceptance import (
    acceptable,
    changed_defects,
    roll_back,
)
from dtrepair.repair.full.biharmonic_fill import Filled
from dtrepair.repair.surface.defects import Defects
from dtrepair.repair.surface.surface import BoolArray, Surface

# Finds the pairs (K, 2) of some frames of poses (T, V, 3).
PairsOf = Callable[[FloatArray, list[int]], list[IntArray]]


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


@dataclass(frozen=True, kw_only=True)
class CommonShiftOptions:
    """Which shifts of all that moves are taken back, and how.

    Args:
        few: So much of the area may have moved by less than half of it, or up to twice as much if
            less of it goes back: else what stands still would be moved.
        faint: Those below this are left, units of the size; up to twice this they fade in.
        one_way: Along what stands still, as a floor, a shift goes back first, if at least this part
            of the squares of the normals that would be met there is along one axis.
        halvings: Where not all of one may go back, as much of it as may is found by so many.
        tries: Eased in time, it may have to come back in some frames: so many tries.
    """

    few: float = 0.1
    faint: float = 1e-3
    one_way: float = 0.8
    halvings: int = 4
    tries: int = 3


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


def leaning(surface: Surface, pairs: IntArray) -> frozenset[int]:
    """Return the clusters, apart from the set around, that meet others in pairs (K, 2)."""
    clusters = surface.cluster_of_body[surface.body_of[pairs]].reshape(-1, 2)
    counted = surface.scale.counted(surface.count)[surface.faces[pairs, 0]].reshape(-1, 2)
    apart = (clusters[:, 0] != clusters[:, 1]) & counted.all(axis=1)
    return frozenset(clusters[apart].ravel().tolist())


def carried_vertices(surface: Surface, pairs: Sequence[IntArray]) -> list[BoolArray]:
    """Return which vertices (V,) shifts of whole clusters of bodies carry, one mask for each.

    Not of those that meet others in pairs (K, 2), and lean on each other, nor where some vertices
    are held, or displacements have a direction.
    """
    if surface.direction is not None:
        return []
    leans = frozenset[int]().union(*(leaning(surface, found) for found in pairs))
    counted = surface.scale.counted(surface.count)
    cluster = surface.cluster_of_body[surface.body_of_vertex]
    masks = [counted & (cluster == own) for own in np.unique(cluster[counted]) if own not in leans]
    return [
        own
        for own in masks
        if (surface.mobility[own] == 1.0).all() and not surface.stiff[own].all()
    ]


def common_shifts(
    surface: Surface,
    moved: FloatArray,
    carried: BoolArray,
    *,
    options: CommonShiftOptions = CommonShiftOptions(),
) -> FloatArray:
    """Return by what (T, 3) half of the area of what is carried moved, axis by axis.

    moved: displacements (T, V, 3); carried: vertices (V,).
    """
    soft = np.flatnonzero(carried & ~surface.stiff)
    own = moved[:, soft]
    order = np.argsort(own, axis=1, kind="stable")
    weight = np.cumsum(surface.mass[soft][order], axis=1)
    middle = (weight < 0.5 * weight[:, -1:]).sum(axis=1, keepdims=True)
    shifts: FloatArray = np.take_along_axis(own, np.take_along_axis(order, middle, axis=1), axis=1)[
        :, 0
    ]
    length = lengths(shifts)
    stayed = np.linalg.norm(own, axis=2) < 0.5 * length[:, None]
    share = stayed @ surface.mass[soft] / surface.mass[soft].sum()
    faded = np.clip(length / options.faint - 1.0, 0.0, 1.0) * np.clip(
        2.0 - share / options.few, 0.0, 1.0
    )
    return np.asarray(faded[:, None] * shifts)


def along_and_across(
    surface: Surface,
    shifts: FloatArray,
    poses: FloatArray,
    pairs: Sequence[IntArray],
    *,
    options: CommonShiftOptions = CommonShiftOptions(),
) -> list[FloatArray]:
    """Return shifts (T, 3) split into those along what stands still and is met, and across it.

    As they are, where it faces several ways or nothing is met. poses: some (N, V, 3), and their
    pairs (K, 2), which tell what is met.
    """
    normals = [np.zeros((0, 3))]
    for pose, found in zip(poses, pairs, strict=True):
        met = np.unique(found)
        met = met[surface.fixed[surface.faces[met]].all(axis=1)]
        normals.append(triangle_normals(pose, surface.faces[met]))
    every = np.concatenate(normals)
    squares, axes = np.linalg.eigh(every.T @ every)
    if squares[-1] <= options.one_way * squares.sum():
        return [shifts]
    across = np.outer(shifts @ axes[:, -1], axes[:, -1])
    return [shifts - across, across]


def shifted_back(
    surface: Surface,
    original: FloatArray,
    poses: FloatArray,
    pairs: tuple[Sequence[IntArray], Sequence[IntArray]],
    pairs_of: PairsOf,
    *,
    eased: Callable[[FloatArray], FloatArray],
    options: CommonShiftOptions = CommonShiftOptions(),
) -> FloatArray:
    """Return poses (T, V, 3) without what whole clusters of bodies were shifted by, if they may.

    Contacts of what is shifted with itself are none the worse; where it would meet what stands
    still, as a floor, it first goes back along that, and then as far as it can.

    Args:
        surface: Its bodies.
        original: The poses (T, V, 3) of the input.
        poses: What was found for them.
        pairs: The pairs (K, 2) of each original pose, and of each pose: none gets more.
        pairs_of: Finds those of some frames of other poses.
        eased: Returns shares (T,) that are smooth in time, and no smaller.
        options: The numbers.
    """
    label = csgraph.connected_components(surface.neighbours, directed=False)[1]
    for mask in carried_vertices(surface, pairs[0]):
        shifts = common_shifts(surface, poses - original, mask, options=options)
        # What neither edges nor ties connect with anything that moved stays.
        moved = (poses != original).any(axis=2)
        carried = mask & np.stack([np.isin(label, label[own]) for own in moved])
        whole = _Shift(poses, shifts, carried, pairs[1], pairs_of)
        if not whole.frames:
            continue
        back, shifted = whole.without(np.zeros(len(poses))), poses
        met = pairs_of(back, whole.frames)
        for part in along_and_across(surface, shifts, back[whole.frames], met, options=options):
            shifted = _Shift(shifted, part, carried, pairs[1], pairs_of).back(eased, options)
        # A body may have moved as a whole against its limbs, which are finer: they would move more.
        if _motion(shifted, original) < _motion(poses, original):
            poses = shifted
    return poses


def _motion(poses: FloatArray, original: FloatArray) -> float:
    """Return how far the vertices of poses (T, V, 3) moved, in the mean."""
    return float(np.linalg.norm(poses - original, axis=2).mean())


class _Shift:
    """Poses (T, V, 3) that are shifted by (T, 3) where they are carried (T, V)."""

    def __init__(
        self,
        poses: FloatArray,
        shifts: FloatArray,
        carried: BoolArray,
        pairs: Sequence[IntArray],
        pairs_of: PairsOf,
    ) -> None:
        self.poses, self.shifts, self.carried = poses, shifts, carried
        self.pairs, self.pairs_of = pairs, pairs_of
        self.frames: list[int] = np.flatnonzero(shifts.any(axis=1)).tolist()

    def without(self, kept: FloatArray) -> FloatArray:
        """Return the poses with shares (T,) of the shifts."""
        back = ((1.0 - kept)[:, None] * self.shifts)[:, None]
        return np.where(self.carried[:, :, None], self.poses - back, self.poses)

    def closed(self, kept: FloatArray, frames: list[int]) -> list[int]:
        """Return which frames get more pairs by such shares."""
        found = self.pairs_of(self.without(kept), frames)
        return [k for k, own in zip(frames, found, strict=True) if len(own) > len(self.pairs[k])]

    def back(
        self, eased: Callable[[FloatArray], FloatArray], options: CommonShiftOptions
    ) -> FloatArray:
        """Return the poses with the least shares that give no frame more pairs."""
        low, needed = np.zeros((2, len(self.poses)))
        bad = self.closed(low, self.frames) if self.frames else []
        needed[bad] = 1.0
        for _ in range(options.halvings if bad else 0):
            middle = 0.5 * (low + needed)
            still = self.closed(middle, bad)
            low[still] = middle[still]
            opened = sorted(set(bad) - set(still))
            needed[opened] = middle[opened]
        for _ in range(options.tries if self.frames else 0):
            kept = eased(needed)
            if not (bad := self.closed(kept, self.frames)):
                return self.without(kept)
            needed[bad] = 1.0
        return self.poses


def _quantiles(values: FloatArray, group: IntArray, quantile: float) -> FloatArray:
    """Return a quantile of the values (K,) of each group, given by number; 0 of an empty one."""
    sizes = np.bincount(group)
    ordered = values[np.lexsort((values, group))]
    rank = np.cumsum(sizes) - sizes + (quantile * np.maximum(sizes - 1, 0)).astype(np.int64)
    return np.where(sizes > 0, np.append(ordered, 0.0)[rank], 0.0)
