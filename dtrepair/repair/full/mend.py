"""A single frame that the space-time scheme left dirty: pushed and filled from its state."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.full.biharmonic_fill import Filled, fill_creases
from dtrepair.repair.full.push import push
from dtrepair.repair.surface.surface import Surface

# Rings within which contacts are left to the creases, from careful to pushing all of them.
NEAR = (12, 6, 0)


def mend(
    surface: Surface,
    original: FloatArray,
    starts: Sequence[FloatArray],
    *,
    step: float,
    alone: Callable[[Surface, FloatArray], FloatArray] | None = None,
) -> FloatArray:
    """A clean pose near one of some poses (V, 3), or the one with the fewest pairs that was found.

    starts: tried in order until one leads to a clean pose, so the least change comes first. alone:
    the solver from the input's pose, the last resort; its pose may lie on another side of a
    contact than the neighbours'.
    """
    best: Filled | None = None
    for start in starts:
        pose = surface.rigid.fitted(original, start)
        for near in NEAR:
            pushed = push(surface, pose, near=near, step=step, iterations=12, patience=5)
            pose = pushed.points
            filled = fill_creases(surface, pose)
            if best is None or filled.defects.rank[0] < best.defects.rank[0]:
                best = filled
            if len(best.defects.crossings) == 0:
                return best.points
    assert best is not None
    if alone is not None:
        cold = alone(surface, original)
        if len(surface.pairs(cold)) < len(best.defects.crossings):
            return cold
    return best.points
