"""Garments that meet what they cover in their hems only: the rest of them hangs free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class HemOptions:
    """When a garment hangs free of what it covers.

    Args:
        beyond: Of what it covers, so many times as much lies beyond the reach of where the two meet
            as within.
        clear: What is farther from it than this fraction of its extent is clear of it: the thighs
            under a coat, not the arms in a tight suit.
    """

    beyond: float = 6.0
    clear: float = 0.015


def clear_of_hems(
    near: BoolArray,
    far: BoolArray,
    away: FloatArray,
    areas: FloatArray,
    size: float,
    *,
    options: HemOptions = HemOptions(),
) -> BoolArray:
    """Return which vertices (N,) behind an open part slide along it rather than hold on to it.

    Args:
        near: Which are within the reach of where the two parts meet.
        far: Which hang off it farther than any of these.
        away: Their distances from it.
        areas: The areas around them.
        size: Extent of the open part.
    """
    beyond = ~near & ~far
    if areas[beyond].sum() <= options.beyond * areas[near].sum():
        return np.zeros(len(near), dtype=bool)
    return np.asarray(beyond & (away > options.clear * size))
