"""What a step towards the input has to keep to: clean, closer, and no more than it must move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtrepair.numerics.geometry import FloatArray, differing, lengths
from dtrepair.repair.full.biharmonic_fill import Filled
from dtrepair.repair.surface.defects import Defects, update_defects
from dtrepair.repair.surface.surface import Surface


@dataclass(frozen=True, kw_only=True)
class AcceptanceOptions:
    """Which motions of a step are left out or undone.

    Args:
        still: Motions shorter than this, units of the size, are left out, those up to twice this
            fade in: what does not move needs no new detection.
        rollback_rings: Rings over which a step is undone around what it would make collide: over
            fewer the surface tears.
        rollback_tries: Times that the region to be undone grows.
        reach_rings: Tightening reaches so many rings beyond what the repair has displaced, fading
            over half of them: room that the repair took from farther away is there.
    """

    still: float = 1e-5
    rollback_rings: int = 8
    rollback_tries: int = 4
    reach_rings: int = 10


def roll_back(
    surface: Surface,
    current: FloatArray,
    trial: FloatArray,
    defects: Defects,
    *,
    folds: int,
    crossings: int = 0,
    options: AcceptanceOptions = AcceptanceOptions(),
) -> Filled | None:
    """Return the step from `current` to `trial` undone around its `defects`, fading over rings.

    None where that does not lead to an acceptable pose (V, 3).
    """
    fade = options.rollback_rings
    bad = np.zeros(surface.count, dtype=bool)
    known = defects
    for attempt in range(options.rollback_tries):
        bad |= surface.vertices_of(defects.triangles)
        rings = surface.rings_from(bad, fade + 2)
        kept = np.clip((rings - 1 - attempt) / fade, 0.0, 1.0)
        pose = current + kept[:, None] * (trial - current)
        defects = changed_defects(surface, known, trial, pose)
        if acceptable(defects, folds, crossings):
            return Filled(pose, defects)
    return None


def reach_of(
    surface: Surface, displacement: FloatArray, *, rings: int = AcceptanceOptions.reach_rings
) -> FloatArray:
    """Return the weight (V,) of tightening: 1 near what was displaced, 0 beyond, 0 where stiff."""
    displaced = (displacement != 0).any(axis=1)
    away = surface.rings_from(displaced, rings)
    return np.where(surface.stiff, 0.0, np.clip(2.0 - 2.0 * away / rings, 0.0, 1.0))


def without_still(
    current: FloatArray, trial: FloatArray, *, still: float = AcceptanceOptions.still
) -> FloatArray:
    """Return the trial (V, 3) with its motion left out where that is shorter than `still`."""
    motion = trial - current
    length = lengths(motion)
    kept = np.clip(length / still - 1.0, 0.0, 1.0)
    return np.where(kept[:, None] > 0, current + kept[:, None] * motion, current)


def changed_defects(
    surface: Surface, known: Defects, current: FloatArray, trial: FloatArray
) -> Defects:
    """Return the defects of `trial`, given those of `current`."""
    return update_defects(surface, known, trial, differing(trial, current))


def acceptable(defects: Defects, folds: int, crossings: int = 0) -> bool:
    """Return whether a pose has no more crossings, by default none, and folds than allowed."""
    return len(defects.crossings) <= crossings and len(defects.folds) <= folds
