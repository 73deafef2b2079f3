"""What poses show of parts that slid or turned in each other since they were modelled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dtrepair.numerics.attachments import KeyArray, Reference
from dtrepair.numerics.geometry import IntArray


def shown_by_slides(
    references: Sequence[Reference],
    part_of: IntArray,
    still: KeyArray,
    *,
    share: float,
) -> list[list[tuple[int, int]]]:
    """Return for each reference that slid the pairs of parts, A < B, whose zones it shows.

    One of the two meets the other where it did at rest; of those that turned, more than a `share`
    of their contact is elsewhere in some pose. part_of: the part (F,) of each triangle; still:
    zone keys of poses in which nothing has moved on.
    """
    count = int(part_of.max(initial=-1)) + 1
    result: list[list[tuple[int, int]]] = []
    left: dict[tuple[int, int], float] = {}
    for reference in references:
        sides = part_of[reference.pairs].astype(np.int64)
        both = np.sort(sides, axis=1)
        inside = np.isin(reference.pairs.astype(np.int64) * count + sides[:, ::-1], still)
        found = []
        for first, second in np.unique(both, axis=0).tolist():
            if first == second:
                continue
            own = (both == (first, second)).all(axis=1)
            known, of_first = inside[own], sides[own] == first
            gone = float(1.0 - known.all(axis=1).mean())
            left[first, second] = max(left.get((first, second), 0.0), gone)
            if known[of_first].all() or known[~of_first].all():
                found.append((first, second))
        result.append(found)
    return [
        [own for own in found if not reference.turned or left[own] > share]
        for reference, found in zip(references, result, strict=True)
    ]
