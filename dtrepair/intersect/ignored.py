"""Which pairs of triangles count, and pairs of bodies that may intersect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import IntArray


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
