"""Flaws of a clean pose, zipped creases and crushed edges, cured where it stays clean."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.repair.full.acceptance import acceptable, changed_defects
from dtrepair.repair.full.relax import RelaxOptions, relax
from dtrepair.repair.surface.defects import find_defects
from dtrepair.repair.surface.surface import BoolArray, Surface


@dataclass(frozen=True, kw_only=True)
class CureOptions:
    """Numbers of the cure of flaws.

    Args:
        rings: Rings around flaws that move with them, from few to many: the smallest motion that
            stays clean is taken.
        most_clusters: Clusters of flaws that are cured one by one, small ones first: each costs a
            factor and a detection.
        rounds: Of cures alone and making room.
        full_rings: Contacts make room within so many rings of flaws, ...
        faded_rings: ... fading out up to so many.
        dearest: Largest cost of one flaw less, as sum of the squared logarithms of the edges'
            length ratios: above it the cure looks worse than the flaw.
        relax: The step in which both sides make room.
    """

    rings: tuple[int, ...] = (2, 4)
    most_clusters: int = 64
    rounds: int = 6
    full_rings: int = 4
    faded_rings: int = 12
    dearest: float = 3.0
    relax: RelaxOptions = field(default_factory=lambda: RelaxOptions(first=1.0, longer=1.0))


class Flaws(Protocol):
    """Edges of a surface that are no longer as in an original pose, by some measure."""

    @property
    def surface(self) -> Surface:
        """The surface."""

    @property
    def allowed(self) -> int:
        """How many flaws may stay."""

    def excess(self, points: FloatArray) -> tuple[int, float]:
        """Return how many flaws a pose (V, 3) has, and how bad they are: smaller is better."""

    def clusters(self, points: FloatArray) -> list[NDArray[np.intp]]:
        """Return the edges to be cured, those that meet together; small clusters come first."""

    def vertices(self, chosen: NDArray[np.integer]) -> BoolArray:
        """Return the vertices (V,) of some edges."""

    def cured(self, points: FloatArray, chosen: NDArray[np.integer], rings: int) -> FloatArray:
        """Return the pose (V, 3) with some edges cured by what lies within so many rings."""


def cure(
    flaws: Flaws,
    original: FloatArray,
    points: FloatArray,
    *,
    folds: int,
    crossings: int = 0,
    scale: float = 1.0,
    options: CureOptions = CureOptions(),
) -> tuple[FloatArray, int]:
    """Return a clean pose, with no more flaws than allowed if possible, and the changes.

    Where surfaces close a crease, its bottom folds flat; where they press, edges are crushed. Flaws
    that meet are cured by the smallest motion of their surroundings that does it, where that stays
    clean. If too many are left, one as-rigid-as-possible step with contacts leads towards all of
    them cured: both sides make room. folds, crossings: so many are allowed; scale: as in `relax`.
    """
    done, failures, all_rings = 0, 0, options.rings
    for number in range(options.rounds):
        if failures == 0:
            points, alone = _cured_alone(flaws, original, points, folds, crossings, options)
            done += alone
        excess = flaws.excess(points)
        clusters = flaws.clusters(points)
        if excess[0] <= flaws.allowed or not clusters or failures == len(all_rings):
            break
        chosen, rings = np.concatenate(clusters), all_rings[number % len(all_rings)]
        target = flaws.cured(points, chosen, rings)
        reach = _reach(flaws, chosen, options)
        trial, _ = relax(
            flaws.surface,
            target,
            points,
            cycles=1,
            folds=folds,
            crossings=crossings,
            reach=reach,
            scale=scale,
            options=options.relax,
        )
        if flaws.excess(trial) < excess:
            points, done, failures = trial, done + 1, 0
        else:
            failures += 1
    return points, done


def _cured_alone(
    flaws: Flaws,
    original: FloatArray,
    points: FloatArray,
    folds: int,
    crossings: int,
    options: CureOptions,
) -> tuple[FloatArray, int]:
    """Return the pose with clusters cured one by one where that needs no room, and how many."""
    surface, done = flaws.surface, 0
    excess = flaws.excess(points)
    if excess[0] <= flaws.allowed:
        return points, 0
    known = find_defects(surface, points)
    for rings in options.rings:
        for cluster in flaws.clusters(points)[: options.most_clusters]:
            trial = flaws.cured(points, cluster, rings)
            left = flaws.excess(trial)
            price = options.dearest * (excess[0] - left[0])
            if left >= excess or _cost(surface, original, points, trial) > price:
                continue
            defects = changed_defects(surface, known, points, trial)
            if acceptable(defects, folds, crossings):
                points, known, excess, done = trial, defects, left, done + 1
            if excess[0] <= flaws.allowed:
                return points, done
    return points, done


def _reach(flaws: Flaws, chosen: NDArray[np.integer], options: CureOptions) -> FloatArray:
    """Return how far vertices (V,) make room for chosen edges: 1 near, 0 far and where stiff."""
    faded, full = options.faded_rings, options.full_rings
    rings = flaws.surface.rings_from(flaws.vertices(chosen), faded)
    fade = np.clip((faded - rings) / (faded - full), 0.0, 1.0)
    return np.where(flaws.surface.stiff, 0.0, fade)


def _cost(surface: Surface, original: FloatArray, points: FloatArray, trial: FloatArray) -> float:
    """Return by how much the sum of squared logarithms of the edges' length ratios grows."""
    moved = (trial != points).any(axis=1)
    first, second = surface.edges[moved[surface.edges].any(axis=1)].T
    old, *new = (
        np.maximum(lengths(pose[first] - pose[second]), 1e-12) for pose in (original, points, trial)
    )
    before, after = (float((np.log(length / old) ** 2).sum()) for length in new)
    return after - before
