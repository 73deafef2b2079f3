"""Cuts: where the frames of a clip jump, so that what lies before and after is solved apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtrepair.numerics.geometry import FloatArray


@dataclass(frozen=True, kw_only=True)
class CutOptions:
    """What counts as a cut.

    Args:
        ratio: A jump between frames this many times faster than those before and after it is a cut
            ...
        least: ... unless the root mean square motion is below this, sizes of the mesh: a start from
            rest is no cut.
        always: Motion above which it always is one, sizes of the mesh: nothing is smooth over that.
    """

    ratio: float = 5.0
    least: float = 0.05
    always: float = 0.5


def is_cut(
    before: float,
    jump: float,
    after: float,
    motion: float,
    *,
    options: CutOptions = CutOptions(),
) -> bool:
    """Return whether a jump between two frames starts a new shot.

    before, jump, after: speeds (size / time) across the gap before, this gap and the one after: a
    cut stands out from both, however fast the shots are. motion: the jump itself, in sizes.
    """
    alone = motion > options.least and jump > options.ratio * max(before, after)
    return alone or motion > options.always


def motion_between(first: FloatArray, second: FloatArray, size: float) -> float:
    """Return the root mean square motion of vertices (V, 3) between two poses, in sizes."""
    return float(np.sqrt(((second - first) ** 2).sum(axis=1).mean())) / size
