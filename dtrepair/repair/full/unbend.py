"""Creases that relaxing has zipped up: opened until no more edges are bent than in the input."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.repair.elastic.dihedral_angles import Hinges
from dtrepair.repair.full.pull_back import acceptable, changed_defects
from dtrepair.repair.full.relax import STEP, relax
from dtrepair.repair.surface.defects import find_defects
from dtrepair.repair.surface.surface import Surface

# Rings around bent edges that move with them, from few to many; so many clusters are tried alone.
RINGS, MANY = (2, 4), 64
# Rounds; contacts make room within so many rings of bent edges, fading from FULL_RINGS on.
ROUNDS, FULL_RINGS, FADED_RINGS = 6, 4, 12
# A bent edge less may cost so much: the sum of squared logarithms of the edges' length ratios.
DEAREST = 3.0


def unbend(
    surface: Surface,
    original: FloatArray,
    points: FloatArray,
    *,
    folds: int,
    step: float = STEP,
) -> tuple[FloatArray, int]:
    """A clean pose with no more bent edges than its original where that can be, and the changes.

    Where surfaces close a crease, its bottom folds flat. Bent edges that meet are opened by the
    smallest motion of their surroundings that does it, where that stays clean. If too many are
    left, one as-rigid-as-possible step with contacts leads towards all of them opened: both sides
    make room.
    """
    hinges = Hinges(surface, original)
    done, failures = 0, 0
    for number in range(ROUNDS):
        if failures == 0:
            points, opened = _opened_alone(hinges, original, points, folds)
            done += opened
        sharpness = hinges.sharpness(points)
        clusters = hinges.clusters(points)
        if sharpness[0] <= hinges.allowed or not clusters or failures == len(RINGS):
            break
        chosen, rings = np.concatenate(clusters), RINGS[number % len(RINGS)]
        target = hinges.opened(points, chosen, rings)
        reach = _reach(surface, chosen)
        trial, _ = relax(surface, target, points, cycles=1, folds=folds, reach=reach, step=step)
        if hinges.sharpness(trial) < sharpness:
            points, done, failures = trial, done + 1, 0
        else:
            failures += 1
    return points, done


def _opened_alone(
    hinges: Hinges, original: FloatArray, points: FloatArray, folds: int
) -> tuple[FloatArray, int]:
    """The pose with one cluster after the other opened where that needs no room, and how many."""
    surface, done = hinges.surface, 0
    sharpness = hinges.sharpness(points)
    if sharpness[0] <= hinges.allowed:
        return points, 0
    known = find_defects(surface, points)
    for rings in RINGS:
        for cluster in hinges.clusters(points)[:MANY]:
            trial = hinges.opened(points, cluster, rings)
            found = hinges.sharpness(trial)
            price = DEAREST * (sharpness[0] - found[0])
            if found >= sharpness or _cost(surface, original, points, trial) > price:
                continue
            defects = changed_defects(surface, known, points, trial)
            if acceptable(defects, folds):
                points, known, sharpness, done = trial, defects, found, done + 1
            if sharpness[0] <= hinges.allowed:
                return points, done
    return points, done


def _reach(surface: Surface, chosen: NDArray[np.integer]) -> FloatArray:
    """Weight (V,) of what makes room for the chosen hinges: 1 near them, 0 far and where stiff."""
    rings = surface.rings_from(surface.vertices_of(surface.hinges[chosen]), FADED_RINGS)
    fade = np.clip((FADED_RINGS - rings) / (FADED_RINGS - FULL_RINGS), 0.0, 1.0)
    return np.where(surface.stiff, 0.0, fade)


def _cost(surface: Surface, original: FloatArray, points: FloatArray, trial: FloatArray) -> float:
    """By how much the sum of squared logarithms of the edges' length ratios grows."""
    moved = (trial != points).any(axis=1)
    first, second = surface.edges[moved[surface.edges].any(axis=1)].T
    old, *new = (
        np.maximum(lengths(pose[first] - pose[second]), 1e-12) for pose in (original, points, trial)
    )
    before, after = (float((np.log(length / old) ** 2).sum()) for length in new)
    return after - before
