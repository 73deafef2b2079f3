"""Which pairs of triangles count, pairs of bodies that may intersect, and how many pairs may be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import IntArray

# What a 32-bit counter holds for certain while the threads of a GPU still add to it.
MOST_COUNTED = 1 << 30


class CollapsedPoseError(ValueError):
    """A pose of which so many triangles lie at one place that their pairs cannot be kept."""

    exit_code = 3  # as of an input that cannot be used


@dataclass(frozen=True, kw_only=True)
class PairLimits:
    """How many pairs a pose may have; with more of them it has collapsed, and is refused.

    Args:
        candidates: Pairs for each triangle whose boxes overlap; ordinary meshes have a few.
        pairs: Pairs for each triangle that intersect, or may.
        least_candidates, least_pairs: What a small mesh may have in any case: the memory of a
            pose is 12 bytes a candidate, and about 100 a pair in all that is told of it.
        of_leaf: How many others the eight triangles of a leaf may meet by their boxes, neighbours
            too: 8,000 triangles about one vertex are no fault.
    """

    candidates: int = 64
    pairs: int = 16
    least_candidates: int = 1 << 23
    least_pairs: int = 1 << 22
    of_leaf: int = 1 << 16

    def of(self, triangles: int) -> tuple[int, int]:
        """Return the most candidates and pairs, of so many triangles of all poses together."""
        candidates = max(self.candidates * triangles, self.least_candidates)
        return min(candidates, MOST_COUNTED), max(self.pairs * triangles, self.least_pairs)


def collapsed(triangles: int) -> CollapsedPoseError:
    """Return the error for a pose with more pairs than can be kept."""
    return CollapsedPoseError(
        f"too many of its {triangles:,} triangles lie at one place to find what they intersect: "
        "the points have collapsed, or are scaled to nothing"
    )


@dataclass(frozen=True)
class CountedPairs:
    """Which pairs of triangles count.

    group: a number for each triangle (F,); counted: whether pairs of two groups count (G, G),
    symmetric; listed: pairs (K, 2), smaller triangle first, that do not, whatever their groups.
    """

    group: IntArray
    counted: NDArray[np.bool_]
    listed: IntArray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int32))


def counted_between(
    owner: NDArray[np.integer], *, mode: str, ignored: Sequence[tuple[int, int]]
) -> NDArray[np.bool_]:
    """Return which contacts (K,) count, given by the two bodies (K, 2) that they join.

    mode: "self" counts those within a body, "inter" those between two, "both" all.
    """
    counted = ~of_ignored_bodies(owner, ignored)
    if mode != "both":
        counted &= (owner[:, 0] != owner[:, 1]) == (mode == "inter")
    return counted


def of_ignored_bodies(
    owner: NDArray[np.integer], ignored: Sequence[tuple[int, int]]
) -> NDArray[np.bool_]:
    """Return which pairs of triangles, given by their bodies (K, 2), are of ignored bodies (K,)."""
    mask = np.zeros(len(owner), dtype=bool)
    if ignored:
        count = int(owner.max(initial=0)) + 1
        known = np.array([i * count + j for i, j in ignored if j < count])
        mask = np.isin(owner.min(axis=1) * np.int64(count) + owner.max(axis=1), known)
    return mask
