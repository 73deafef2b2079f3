"""Whether a worn thing is still worn: how often a limb's centreline passes through its loops."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tests.measures.surfaces import Floats, Mask


def crossing_number(core: Floats, loop: Floats) -> int:
    """How often an open line (N, 3) passes through a closed loop (M, 3), against it less often.

    Passages through a fan of triangles that spans the loop are counted, 1 along its normal (the
    loop counter-clockwise from there) and -1 against it. Ties are broken in one way for the two
    triangles of an edge, so that a passage through it counts once. The fan's centre is a little
    beside that of the loop, through which centrelines like to go.
    """
    middle, following = loop.mean(axis=0), np.roll(loop, -1, axis=0)
    centre = middle + 0.0113 * (loop[0] - middle) + 0.0071 * (loop[len(loop) // 3] - middle)
    total = 0
    for start, end in pairwise(core):
        first = _positive(start - centre, loop - centre, following - centre)
        last = _positive(end - centre, loop - centre, following - centre)
        to_corner = _positive(end - start, loop - start, centre - start)
        to_next = np.roll(to_corner, -1)
        rim = _positive(end - start, loop - start, following - start)
        # Sides of the line to the edges (a, b), (b, centre) and (centre, a), all the same.
        upward = rim & to_next & ~to_corner
        downward = ~rim & ~to_next & to_corner
        total += int((upward & ~first & last).sum()) - int((downward & first & ~last).sum())
    return total


def crossing_numbers(cores: list[Floats], loops: list[Floats]) -> list[list[int]]:
    """For each loop its crossing number with each core."""
    return [[crossing_number(core, loop) for core in cores] for loop in loops]


def _positive(along: Floats, first: Floats, second: Floats) -> Mask:
    """Sign of the volume (M,) that three vectors span; zero counts as positive."""
    return np.asarray(np.einsum("...d,...d->...", along, np.cross(first, second)) >= 0)
