"""Which modelled contacts a clip leads apart: they rested on each other, and hold nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.strain.meter import StrainMeter


@dataclass(frozen=True, kw_only=True)
class LettingGoOptions:
    """When a patch of ties is taken as one that the clip lets go.

    Args:
        bound: A tie is let go where it is farther off its place at rest, in diagonals: attached
            parts may not be led so far off each other.
        patch: And a patch of them where this share is: a ball that turns in its socket slides as
            far, but not near its axis.
        poses: In more than this share of the poses.
    """

    bound: float = 0.02
    patch: float = 0.9
    poses: float = 0.5


def ties_that_hold(
    meter: StrainMeter,
    poses: Sequence[FloatArray],
    *,
    options: LettingGoOptions = LettingGoOptions(),
) -> NDArray[np.bool_]:
    """Return which ties (N,) hold parts together in poses (V, 3) of the whole clip.

    Hair that lies on a shoulder at rest leaves it when the head turns, and is held by its roots:
    tied to the shoulder it would drag it along. Two parts of which no patch holds keep all ties: a
    rod slides far in its cylinder.
    """
    parts = meter.parts
    if not poses:
        return np.ones(len(parts.joint), dtype=bool)
    patch = parts.tie_patches
    least = options.patch * np.bincount(patch)
    gone = [np.bincount(patch, meter.let_go(pose, options.bound)) >= least for pose in poses]
    kept = np.asarray(np.mean(gone, axis=0) <= options.poses)[patch]
    return np.asarray(kept | ~np.isin(parts.joint, parts.joint[kept]))
