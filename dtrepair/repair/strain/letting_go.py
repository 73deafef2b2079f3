"""Which modelled contacts a clip leads apart: they rested on each other, and hold nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.attachments import Attachments, Reference
from dtrepair.repair.strain.meter import StrainMeter
from dtrepair.repair.strain.parts import ConnectedParts


@dataclass(frozen=True, kw_only=True)
class LettingGoOptions:
    """When a patch of ties is taken as one that the clip lets go.

    Args:
        bound: A tie is let go where it is farther off its place at rest, in diagonals: attached
            parts may not be led so far off each other.
        patch: And a patch of them where this share is: a ball that turns in its socket slides as
            far, but not near its axis.
        poses: In more than this share of the poses.
        least: Of fewer poses nothing is let go: a single one may be the rest, or just odd.
    """

    bound: float = 0.02
    patch: float = 0.9
    poses: float = 0.5
    least: int = 2


def ties_that_hold(
    meter: StrainMeter,
    attachments: Attachments,
    poses: Sequence[Reference],
    *,
    options: LettingGoOptions = LettingGoOptions(),
) -> NDArray[np.bool_]:
    """Return which ties (N,) hold parts together in poses of the whole clip, with all their pairs.

    Hair that lies on a shoulder at rest leaves it when the head turns, and is held by its roots:
    tied to the shoulder it would drag it along. Two parts of which no patch holds keep all ties
    where they still meet as they were modelled: a rod slides far in its cylinder.
    """
    parts = meter.parts
    if len(poses) < options.least:
        return np.ones(len(parts.joint), dtype=bool)
    patch = parts.tie_patches
    least = options.patch * np.bincount(patch)
    gone = [np.bincount(patch, meter.let_go(pose.points, options.bound)) >= least for pose in poses]
    kept = np.asarray(np.mean(gone, axis=0) <= options.poses)[patch]
    meeting = [np.isin(parts.joint, _modelled_joints(parts, attachments, pose)) for pose in poses]
    met = np.mean(meeting, axis=0) >= 1.0 - options.poses
    return np.asarray(kept | (met & ~np.isin(parts.joint, parts.joint[kept])))


def _modelled_joints(
    parts: ConnectedParts, attachments: Attachments, pose: Reference
) -> NDArray[np.int64]:
    """Return the joints of which a pose has modelled pairs."""
    pairs = pose.pairs[attachments.modelled(pose.pairs)]
    sides = np.sort(parts.of_vertex[parts.corners[pairs, 0]], axis=1)
    return np.unique(sides @ [parts.count, 1])
