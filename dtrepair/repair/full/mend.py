"""A single frame that its window left dirty: pushed and filled from its state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.work import Repeats
from dtrepair.repair.elastic.parting import PartingOptions, parted
from dtrepair.repair.full.biharmonic_fill import Filled, FillOptions, biharmonic_fill
from dtrepair.repair.full.push import PushOptions, push
from dtrepair.repair.surface.defects import Defects
from dtrepair.repair.surface.surface import Surface


@dataclass(frozen=True, kw_only=True)
class MendOptions:
    """Numbers of the mending of one frame.

    Args:
        near: Rings within which contacts are left to the creases, from careful to pushing all of
            them; a frame that is nearly clean needs no 20 rings as a whole repair does.
        push: What separates contacts; few iterations, as most are apart.
        fill: What closes the creases.
        parting: What leads the last few pairs apart.
        mendable: More pairs than this small motions do not mend: they are what solving left, or
            what had to be given up with a share of the correction.
        hopeless, few: Where a pose is of no use with more than so many pairs, no turn follows one
            that left more than `hopeless` times as many and a `few`.
    """

    near: tuple[int, ...] = (12, 6, 0)
    push: PushOptions = field(default_factory=lambda: PushOptions(iterations=12, patience=5))
    fill: FillOptions = field(default_factory=FillOptions)
    parting: PartingOptions = field(default_factory=PartingOptions)
    mendable: int = 100
    hopeless: float = 2.0
    few: int = 20


def mend(
    surface: Surface,
    original: FloatArray,
    starts: Sequence[FloatArray],
    *,
    step: float,
    alone: Callable[[Surface, FloatArray], FloatArray] | None = None,
    most: int | None = None,
    options: MendOptions = MendOptions(),
) -> FloatArray:
    """Return a clean pose near one of some poses (V, 3), or the one with the fewest pairs.

    starts: tried in order until one leads to a clean pose, so the least change comes first. step:
    largest motion in an iteration of the push, units of the size. alone: the solver from the
    input's pose, the last resort; its pose may lie on another side of a contact than the
    neighbours'. most: a pose with more pairs is of no use to the caller; None: any may be.
    """
    limit = np.inf if most is None else options.hopeless * most + options.few
    best: Filled | None = None
    fills = Repeats[Filled]()
    for start in starts:
        pose = surface.rigid.fitted(original, start)
        known = surface.contacts.pairs(pose)
        apart = _parted(surface, original, pose, known, options.parting)
        if apart is not None:
            return apart[0]
        for near in options.near:
            pushed = push(
                surface, pose, near=near, step=step, known_pairs=known, options=options.push
            )
            pose, known = pushed.points, pushed.pairs
            fill = partial(biharmonic_fill, surface, pose, options=options.fill)
            filled = fills(fill, pose)  # a push in vain leaves the pose as it was
            if best is None or filled.defects.rank[0] < best.defects.rank[0]:
                best = filled
            if len(best.defects.crossings) == 0:
                return best.points
            if len(filled.defects.crossings) > limit:
                break
    assert best is not None
    pose, known = best.points, best.defects.crossings
    apart = _parted(surface, original, pose, known, options.parting, some=True)
    if apart is not None:
        pose, known = apart
    if alone is not None and len(known):
        cold = alone(surface, original)
        if len(surface.contacts.pairs(cold)) < len(known):
            return cold
    return pose


def _parted(
    surface: Surface,
    original: FloatArray,
    pose: FloatArray,
    pairs: IntArray,
    options: PartingOptions,
    *,
    some: bool = False,
) -> tuple[FloatArray, IntArray] | None:
    """Return a pose (V, 3) with (some of) few `pairs` (K, 2) led apart, and what is left of them.

    None where that fails.
    """
    if not 0 < len(pairs) <= (options.most_in_all if some else options.most):
        return None
    known = Defects(pairs, surface.contacts.folds(pose))
    # What only moves as a whole is not led apart by vertices.
    whole = partial(surface.rigid.fitted, original)
    found = parted(surface, pose, known, some=some, limited=whole, options=options)
    return None if found is None else (found[0], found[1].crossings)
