"""Creases that relaxing has zipped up: opened until no more edges are bent than in the input."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.repair.elastic.dihedral_angles import DihedralAngles, DihedralOptions
from dtrepair.repair.full.acceptance import acceptable, changed_defects
from dtrepair.repair.full.relax import RelaxOptions, relax
from dtrepair.repair.surface.defects import find_defects
from dtrepair.repair.surface.surface import Surface


@dataclass(frozen=True, kw_only=True)
class UnbendOptions:
    """Numbers of the opening of zipped creases.

    Args:
        rings: Rings around bent edges that move with them, from few to many: the smallest motion
            that stays clean is taken.
        most_clusters: Clusters of bent edges that are opened one by one, small ones first: each
            costs a factor and a detection.
        rounds: Of opening alone and making room.
        full_rings: Contacts make room within so many rings of bent edges, ...
        faded_rings: ... fading out up to so many.
        dearest: Largest cost of one bent edge less, as sum of the squared logarithms of the edges'
            length ratios: above it the cure looks worse than the crease.
        angles: What is bent, and how it is opened.
        relax: The step in which both sides make room.
    """

    rings: tuple[int, ...] = (2, 4)
    most_clusters: int = 64
    rounds: int = 6
    full_rings: int = 4
    faded_rings: int = 12
    dearest: float = 3.0
    angles: DihedralOptions = field(default_factory=DihedralOptions)
    relax: RelaxOptions = field(default_factory=RelaxOptions)


def unbend(
    surface: Surface,
    original: FloatArray,
    points: FloatArray,
    *,
    folds: int,
    scale: float = 1.0,
    options: UnbendOptions = UnbendOptions(),
) -> tuple[FloatArray, int]:
    """Return a clean pose, with no more bent edges than its original if possible, and the changes.

    Where surfaces close a crease, its bottom folds flat. Bent edges that meet are opened by the
    smallest motion of their surroundings that does it, where that stays clean. If too many are
    left, one as-rigid-as-possible step with contacts leads towards all of them opened: both sides
    make room. scale: as in `relax`.
    """
    angles = DihedralAngles(surface, original, options=options.angles)
    done, failures, all_rings = 0, 0, options.rings
    for number in range(options.rounds):
        if failures == 0:
            points, opened = _opened_alone(angles, original, points, folds, options)
            done += opened
        sharpness = angles.sharpness(points)
        clusters = angles.clusters(points)
        if sharpness[0] <= angles.allowed or not clusters or failures == len(all_rings):
            break
        chosen, rings = np.concatenate(clusters), all_rings[number % len(all_rings)]
        target = angles.opened(points, chosen, rings)
        reach = _reach(surface, chosen, options)
        trial, _ = relax(
            surface,
            target,
            points,
            cycles=1,
            folds=folds,
            reach=reach,
            scale=scale,
            options=options.relax,
        )
        if angles.sharpness(trial) < sharpness:
            points, done, failures = trial, done + 1, 0
        else:
            failures += 1
    return points, done


def _opened_alone(
    angles: DihedralAngles,
    original: FloatArray,
    points: FloatArray,
    folds: int,
    options: UnbendOptions,
) -> tuple[FloatArray, int]:
    """Return the pose with clusters opened one by one where that needs no room, and how many."""
    surface, done = angles.surface, 0
    sharpness = angles.sharpness(points)
    if sharpness[0] <= angles.allowed:
        return points, 0
    known = find_defects(surface, points)
    for rings in options.rings:
        for cluster in angles.clusters(points)[: options.most_clusters]:
            trial = angles.opened(points, cluster, rings)
            left = angles.sharpness(trial)
            price = options.dearest * (sharpness[0] - left[0])
            if left >= sharpness or _cost(surface, original, points, trial) > price:
                continue
            defects = changed_defects(surface, known, points, trial)
            if acceptable(defects, folds):
                points, known, sharpness, done = trial, defects, left, done + 1
            if sharpness[0] <= angles.allowed:
                return points, done
    return points, done


def _reach(surface: Surface, chosen: NDArray[np.integer], options: UnbendOptions) -> FloatArray:
    """Return how far vertices (V,) make room for chosen hinges: 1 near, 0 far and where stiff."""
    faded, full = options.faded_rings, options.full_rings
    rings = surface.rings_from(surface.vertices_of(surface.edge_pairs[chosen]), faded)
    fade = np.clip((faded - rings) / (faded - full), 0.0, 1.0)
    return np.where(surface.stiff, 0.0, fade)


def _cost(surface: Surface, original: FloatArray, points: FloatArray, trial: FloatArray) -> float:
    """Return by how much the sum of squared logarithms of the edges' length ratios grows."""
    moved = (trial != points).any(axis=1)
    first, second = surface.edges[moved[surface.edges].any(axis=1)].T
    old, *new = (
        np.maximum(lengths(pose[first] - pose[second]), 1e-12) for pose in (original, points, trial)
    )
    before, after = (float((np.log(length / old) ** 2).sum()) for length in new)
    return after - before
