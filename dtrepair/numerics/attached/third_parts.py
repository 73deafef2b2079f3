"""Which parts a third one tells of, that both are attached to: lids and lashes by a head."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dtrepair.numerics.attached.apart import keys_of_parts
from dtrepair.numerics.attachments import KeyArray, distinct_keys, zone_rows
from dtrepair.numerics.geometry import IntArray


def keys_by_third(
    zones: KeyArray, around: KeyArray, part_of: IntArray, silent: Sequence[KeyArray]
) -> KeyArray:
    """Return sorted keys, A x number of parts + B, A < B, of parts of which a third one tells.

    Of its zones towards the two, one is around the other, and the two are not attached. zones,
    around: sorted keys, triangle x number of parts + other part, of zones and what is around them;
    part_of: the part (F,) of each triangle; silent: keys of parts of which nothing is told.
    """
    count = int(part_of.max(initial=-1)) + 1
    both = zone_rows(zones, len(part_of), count).T @ zone_rows(around, len(part_of), count)
    ends = np.stack(both.nonzero(), axis=1)
    ends = ends[ends[:, 0] != ends[:, 1]]
    attached = np.stack([part_of[zones // max(count, 1)], zones % max(count, 1)], axis=1)
    known = distinct_keys([keys_of_parts(attached, part_of), *silent])
    return np.setdiff1d(keys_of_parts(ends, part_of), known)
