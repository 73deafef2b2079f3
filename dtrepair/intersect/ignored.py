"""Pairs of bodies that may intersect: their contacts do not count."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def of_ignored_bodies(
    owner: NDArray[np.integer], ignored: Sequence[tuple[int, int]]
) -> NDArray[np.bool_]:
    """Which pairs of triangles, given by their bodies (K, 2), are of an ignored pair of bodies."""
    mask = np.zeros(len(owner), dtype=bool)
    if ignored:
        count = int(owner.max(initial=0)) + 1
        known = np.array([i * count + j for i, j in ignored if j < count])
        mask = np.isin(owner.min(axis=1) * np.int64(count) + owner.max(axis=1), known)
    return mask
