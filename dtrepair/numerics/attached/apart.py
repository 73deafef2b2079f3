"""Parts that are known not to be attached, though poses show them in each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.attachments import NO_KEYS, KeyArray, Reference, Ties, distinct_keys
from dtrepair.numerics.geometry import IntArray


def keys_of_parts(parts: NDArray[np.integer], part_of: IntArray) -> KeyArray:
    """Return keys (N,), A x number of parts + B with A < B, of pairs (N, 2) of parts.

    part_of: the part (F,) of each triangle.
    """
    low, high = np.sort(parts.astype(np.int64), axis=1).T
    return np.asarray(low * (int(part_of.max(initial=-1)) + 1) + high)


def keys_apart(references: Sequence[Reference], part_of: IntArray) -> KeyArray:
    """Return the sorted keys of the parts that references tell not to be attached."""
    found = [keys_of_parts(part_of[own.pairs], part_of) for own in references if own.apart]
    return distinct_keys([NO_KEYS, *found])


def without_ties_of(
    ties: Ties, part_of_vertex: IntArray, part_of: IntArray, apart: KeyArray
) -> Ties:
    """Return ties but for those between parts of sorted keys (K,).

    part_of_vertex: the part (V,) of each vertex; part_of: that of each triangle (F,).
    """
    ends = np.stack([part_of_vertex[ties.vertices], part_of[ties.triangles]], axis=1)
    return ties.among(~np.isin(keys_of_parts(ends, part_of), apart))
