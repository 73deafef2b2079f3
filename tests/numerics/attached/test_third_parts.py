"""Which parts a third one tells of, by keys made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.attached.third_parts import keys_by_third
from dtrepair.numerics.attachments import KeyArray

# Part 0 has four triangles, the parts 1 and 2 one each.
PART_OF = np.array([0, 0, 0, 0, 1, 2], dtype=np.int32)
NONE = np.zeros(0, dtype=np.int64)
BOTH = [5]  # 1 x number of parts + 2


def keys(*zones: tuple[int, int]) -> KeyArray:
    """Sorted keys of triangles and the parts towards which they are."""
    return np.array(sorted(triangle * 3 + part for triangle, part in zones), dtype=np.int64)


ZONES = keys((0, 1), (3, 2), (4, 0), (5, 0))


@pytest.mark.parametrize(
    ("around", "expected"),
    [
        (ZONES, []),
        (keys((0, 1), (1, 1), (3, 2)), []),
        (keys((0, 1), (3, 1), (3, 2)), BOTH),
        (keys((0, 1), (0, 2), (3, 2)), BOTH),
    ],
)
def test_one_zone_is_around_the_other(around: KeyArray, expected: list[int]) -> None:
    """Whichever of the two it is."""
    assert keys_by_third(ZONES, around, PART_OF, []).tolist() == expected


def test_of_attached_and_silent_parts_nothing_is_told() -> None:
    around = keys(*((triangle, part) for triangle in range(4) for part in (1, 2)))
    assert keys_by_third(ZONES, around, PART_OF, []).tolist() == BOTH
    assert keys_by_third(ZONES, around, PART_OF, [np.array(BOTH)]).tolist() == []
    attached = np.union1d(ZONES, keys((4, 2), (5, 1)))
    assert keys_by_third(attached, around, PART_OF, []).tolist() == []


def test_without_zones_nothing_is_told() -> None:
    assert keys_by_third(NONE, NONE, PART_OF, [NONE]).tolist() == []
    assert keys_by_third(NONE, NONE, PART_OF[:0], []).tolist() == []
