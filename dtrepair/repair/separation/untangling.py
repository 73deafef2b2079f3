"""Bodies that hook into each other, as a rod through a plate: which they are, and the way out.

Of a body that passes through a thin wall nearly nothing is inside, so that no depth tells the way:
what pushing leaves as it was is hooked, and ways and lengths are tried until the contact is gone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray

# A contact is hooked if pushing leaves this part of its pairs in half of the frames that have so
# many: a ring that is too narrow for a part of its way stays on its finger.
STUCK, SEVERAL = 0.5, 10
# Ways are tried in so many steps up to this part of the smaller body, then halved so many times.
STEPS, FARTHEST, HALVINGS = 12, 0.8, 3

# Whether a shift (3,) frees a contact.
Frees = Callable[[FloatArray], bool]


def hooked_contacts(
    before: Sequence[tuple[IntArray, IntArray]], left: Sequence[tuple[IntArray, IntArray]]
) -> frozenset[tuple[int, int]]:
    """Bodies (first < second) whose contact pushing left as it was in half of its frames or more.

    before, left: for each frame bodies of contacts (K, 2), first < second, and their numbers of
    pairs (K,), as of `contact_counts`.
    """
    met: dict[tuple[int, int], list[bool]] = {}
    for (old, old_counts), (new, new_counts) in zip(before, left, strict=True):
        now = dict(zip(map(tuple, new.tolist()), new_counts.tolist(), strict=True))
        for (first, second), count in zip(old.tolist(), old_counts.tolist(), strict=True):
            if count >= SEVERAL:
                stuck = now.get((first, second), 0) >= STUCK * count
                met.setdefault((first, second), []).append(stuck)
    return frozenset(pair for pair, stuck in met.items() if 2 * sum(stuck) >= len(stuck))


def contact_counts(body_of: NDArray[np.integer], pairs: IntArray) -> tuple[IntArray, IntArray]:
    """Contacts between bodies (K, 2), first < second, and their pairs (K,), of pairs (P, 2).

    body_of: the body of each triangle (F,).
    """
    bodies = np.sort(body_of[pairs], axis=1)
    found, counts = np.unique(bodies[bodies[:, 0] != bodies[:, 1]], axis=0, return_counts=True)
    return found.astype(np.int32), counts.astype(np.int32)


def ways_around(*bodies: FloatArray) -> list[FloatArray]:
    """Unit directions (3,): 26 around, and the axes of bodies (V, 3) both ways."""
    ways = [np.array(way, dtype=np.float64) for way in product((-1, 0, 1), repeat=3) if any(way)]
    for points in bodies:
        axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
        ways += [*axes, *-axes]
    return [way / np.linalg.norm(way) for way in ways]


def shortest_way(frees: Frees, ways: Sequence[FloatArray], farthest: float) -> FloatArray | None:
    """The way (3,) along which the shortest shift frees a contact; None where none does."""
    for step in range(1, STEPS + 1):
        for way in ways:
            if frees(step / STEPS * farthest * way):
                return way
    return None


def length_along(frees: Frees, way: FloatArray, farthest: float) -> float:
    """How far a body has to go until its contact is free; `farthest` where it never is."""
    for step in range(1, STEPS + 1):
        if frees(step / STEPS * farthest * way):
            high = step / STEPS * farthest
            low = high - farthest / STEPS
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                low, high = (low, middle) if frees(middle * way) else (middle, high)
            return high
    return farthest
