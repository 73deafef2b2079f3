"""Bodies that hook into each other, as a rod through a plate: which they are, and the way out.

Of a body that passes through a thin wall nearly nothing is inside, so that no depth tells the way:
what pushing leaves as it was is tangled, and directions and lengths are tried until the contact is
gone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.work import work_done


@dataclass(frozen=True, kw_only=True)
class UntanglingOptions:
    """When bodies are tangled, and which shifts are tried.

    Args:
        stuck: Fraction of the pairs of a contact that pushing leaves, in half of its frames, where
            it is tangled: a ring that is too narrow for a part of its way stays on its finger.
        several: Frames with fewer pairs do not vote.
        steps: Lengths that are tried.
        farthest: The longest of them, as a fraction of the smaller body's diagonal.
        halvings: How often the interval of the first length that frees a contact is halved.
        work: After so much of it no other direction is tried (units of `numerics.work`): of small
            bodies all are, of a dress on its wearer those of the shortest lengths.
    """

    stuck: float = 0.5
    several: int = 10
    steps: int = 12
    farthest: float = 0.8
    halvings: int = 3
    work: float = 2e6


# Whether a shift (3,) frees a contact.
Frees = Callable[[FloatArray], bool]


def tangled_contacts(
    before: Sequence[tuple[IntArray, IntArray]],
    left: Sequence[tuple[IntArray, IntArray]],
    *,
    options: UntanglingOptions = UntanglingOptions(),
) -> frozenset[tuple[int, int]]:
    """Return bodies (first < second) whose contact pushing left as it was in half of its frames.

    before, left: for each frame bodies of contacts (K, 2), first < second, and their numbers of
    pairs (K,), as of `contact_counts`.
    """
    votes: dict[tuple[int, int], list[bool]] = {}
    for (old, old_counts), (new, new_counts) in zip(before, left, strict=True):
        now = dict(zip(map(tuple, new.tolist()), new_counts.tolist(), strict=True))
        for (first, second), count in zip(old.tolist(), old_counts.tolist(), strict=True):
            if count >= options.several:
                stuck = now.get((first, second), 0) >= options.stuck * count
                votes.setdefault((first, second), []).append(stuck)
    return frozenset(pair for pair, stuck in votes.items() if 2 * sum(stuck) >= len(stuck))


def contact_counts(body_of: NDArray[np.integer], pairs: IntArray) -> tuple[IntArray, IntArray]:
    """Return contacts between bodies (K, 2), first < second, and their numbers of pairs (K,).

    body_of: the body of each triangle (F,); pairs (P, 2) of triangles.
    """
    bodies = np.sort(body_of[pairs], axis=1)
    found, counts = np.unique(bodies[bodies[:, 0] != bodies[:, 1]], axis=0, return_counts=True)
    return found.astype(np.int32), counts.astype(np.int32)


def directions_around(*bodies: FloatArray) -> list[FloatArray]:
    """Return unit directions (3,): 26 around, and the axes of bodies (V, 3) both ways."""
    found = [np.array(way, dtype=np.float64) for way in product((-1, 0, 1), repeat=3) if any(way)]
    for points in bodies:
        axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
        found += [*axes, *-axes]
    return [direction / np.linalg.norm(direction) for direction in found]


def shortest_direction(
    frees: Frees,
    directions: Sequence[FloatArray],
    farthest: float,
    *,
    options: UntanglingOptions = UntanglingOptions(),
) -> FloatArray | None:
    """Return the direction (3,) of the shortest shift that frees a contact; None if none does."""
    enough = work_done() + options.work
    for step in range(1, options.steps + 1):
        for direction in directions:
            if work_done() > enough:
                return None
            if frees(step / options.steps * farthest * direction):
                return direction
    return None


def length_along(
    frees: Frees,
    direction: FloatArray,
    farthest: float,
    *,
    options: UntanglingOptions = UntanglingOptions(),
) -> float | None:
    """Return how far a body has to go until its contact is free; None where it never is."""
    for step in range(1, options.steps + 1):
        if frees(step / options.steps * farthest * direction):
            high = step / options.steps * farthest
            low = high - farthest / options.steps
            for _ in range(options.halvings):
                middle = 0.5 * (low + high)
                low, high = (low, middle) if frees(middle * direction) else (middle, high)
            return high
    return None
