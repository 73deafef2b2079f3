"""Frames that pushing left dirty take the displacements of neighbours, turned with their limbs.

A contact that comes apart by one way in a frame comes apart by the same way in the next: from
there little is left to be pushed, and a shape that is whole stays whole.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from dtrepair.numerics.geometry import FloatArray, dots, lengths, vector_areas
from dtrepair.numerics.metrics import distortion
from dtrepair.repair.elastic.arap import ArapSystem
from dtrepair.repair.full.acceptance import reach_of
from dtrepair.repair.full.mend import MendOptions, mend
from dtrepair.repair.full.phases import PhaseOptions, Phases
from dtrepair.repair.full.relax import QUICK, RelaxOptions, relax
from dtrepair.repair.full.settle import SettleOptions, Settling
from dtrepair.repair.full.steering import Steering
from dtrepair.repair.surface.surface import Surface


@dataclass(frozen=True, kw_only=True)
class LendingOptions:
    """Numbers of the lending of displacements.

    Args:
        cycles: Of relaxing a frame.
        step: Largest motion in an iteration of the push that cleans a frame, units of the size.
        rough: A frame that costs more (see `cost`) is tried from its input as well.
        mend, phases: What cleans a frame; the second where the first leaves pairs.
        relax, settle: What takes it back towards its input.
    """

    cycles: int = 3
    step: float = 0.004
    rough: float = 0.12
    mend: MendOptions = field(default_factory=MendOptions)
    phases: PhaseOptions = field(default_factory=PhaseOptions)
    relax: RelaxOptions = field(default_factory=lambda: replace(QUICK, settle_after=1))
    settle: SettleOptions = field(default_factory=SettleOptions)


class Loan(NamedTuple):
    """A frame, the neighbour whose displacement it takes, and what its own pose costs."""

    frame: int
    lender: int
    cost: float


def cost(surface: Surface, original: FloatArray, points: FloatArray, steering: Steering) -> float:
    """Return what a pose (V, 3) costs: its distortion, and the width of what it turned over.

    Edges keep their lengths where skin is folded over. What strays from directions costs as much
    as in single poses. A pose that intersects costs more than any clean one.
    """
    if len(surface.contacts.pairs(points)):
        return np.inf
    old, new = (vector_areas(pose, surface.faces) for pose in (original, points))
    over = lengths(new)[dots(old, new) < 0.0].sum()
    astray = steering.options.weight * steering.astray(points - original)
    return distortion(original, points, surface.edges) + float(np.sqrt(over)) + astray


def relaxed(
    surface: Surface,
    original: FloatArray,
    points: FloatArray,
    steering: Steering,
    options: LendingOptions,
) -> FloatArray:
    """Return a clean pose (V, 3) taken back towards its input, as in single poses."""
    moved = points - original
    if not moved.any():
        return points
    folds = len(surface.contacts.folds(points))
    if steering:
        points = steering.led_back(original, points, folds=folds)
        moved = points - original
    pairs = surface.contacts.pairs(original)
    settles = len(pairs) > 0 and not steering
    settling = Settling(surface, original, pairs, options=options.settle) if settles else None
    return relax(
        surface,
        original,
        points,
        cycles=options.cycles,
        folds=folds,
        reach=reach_of(surface, moved, rings=options.relax.acceptance.reach_rings),
        steering=steering,
        settling=settling,
        options=options.relax,
    )[0]


def carried(
    surface: Surface, lent_from: FloatArray, lent_to: FloatArray, moved: FloatArray
) -> FloatArray:
    """Return the input `lent_to` (V, 3) with the displacements (V, 3) of another one.

    They turn as the surroundings of each vertex do from `lent_from` to `lent_to`.
    """
    turned = ArapSystem(surface, lent_from).rotations(lent_to)
    carried: FloatArray = lent_to + np.einsum("vij,vj->vi", turned, moved)
    return carried


def solved_from(
    surface: Surface,
    original: FloatArray,
    start: FloatArray,
    *,
    scale: float,
    alone: Callable[[Surface, FloatArray], FloatArray] | None,
    steering: Steering,
    insist: bool = True,
    effort: float = 1.0,
    options: LendingOptions,
) -> tuple[FloatArray, float]:
    """Return the pose (V, 3) that a start leads to, cleaned and relaxed, and what it costs.

    scale: factor of steps; alone: the solver from the input's pose, tried where that is rough;
    insist: whether it goes on where mending leaves pairs; effort: factor of the work after which it
    is left as it is.
    """
    pose = start
    if len(surface.contacts.pairs(start)):
        pose = mend(surface, original, [start], step=scale * options.step, options=options.mend)
    if insist and len(surface.contacts.pairs(pose)):
        phases = Phases(surface, original, effort=effort, options=options.phases)
        pose = phases.insist_from(pose).points
    found = _judged(surface, original, pose, steering, options)
    if alone is None or found[1] <= options.rough:
        return found
    cold = _judged(surface, original, alone(surface, original), steering, options)
    return min(found, cold, key=lambda judged: judged[1])


def _judged(
    surface: Surface,
    original: FloatArray,
    pose: FloatArray,
    steering: Steering,
    options: LendingOptions,
) -> tuple[FloatArray, float]:
    """Return a pose relaxed if it is clean, and what it costs."""
    if len(surface.contacts.pairs(pose)) == 0:
        pose = relaxed(surface, original, pose, steering, options)
    return pose, cost(surface, original, pose, steering)


def disagreement(first: FloatArray, second: FloatArray) -> float:
    """Return the root mean square difference of two displacements (V, 3)."""
    return float(np.sqrt((lengths(first - second) ** 2).mean()))
