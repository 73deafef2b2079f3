"""A clean pose opened until its contacts keep a distance."""

from __future__ import annotations

from dtrepair.geometry import FloatArray
from dtrepair.repair.contact import find_defects
from dtrepair.repair.push import Limit, push
from dtrepair.repair.surface import NEIGHBOUR_RINGS, Surface

# One iteration moves by this part of the clearance.
STEP = 0.25
ITERATIONS, PATIENCE = 40, 8
# Attempts, each with a step of half the length.
ATTEMPTS = 3


def open_contacts(
    surface: Surface, points: FloatArray, clearance: float, *, limit: Limit = None
) -> tuple[FloatArray, int]:
    """The pose with its contacts pushed `clearance` apart (units of the size), and what is left.

    Returns the number of pairs that are still closer. A pose that is not clean, or not better, is
    never taken: the input may not have the room.
    """
    folds = len(find_defects(surface, points).folds)
    left = len(surface.close_pairs(points, clearance))
    for attempt in range(ATTEMPTS):
        if left == 0:
            break
        opened = push(
            surface,
            points,
            near=NEIGHBOUR_RINGS,
            step=STEP * clearance * 0.5**attempt,
            iterations=ITERATIONS,
            patience=PATIENCE,
            limit=limit,
            detect=lambda pose: surface.close_pairs(pose, clearance),
        )
        defects = find_defects(surface, opened.points)
        if len(defects.crossings) == 0 and len(defects.folds) <= folds:
            if len(opened.pairs) < left:
                points, left = opened.points, len(opened.pairs)
    return points, left
