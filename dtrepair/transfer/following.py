"""What has no partner on the source follows the nearest part of the target that has one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.closest_point import nearest_triangles
from dtrepair.numerics.geometry import FloatArray, IntArray, components, diagonal


@dataclass(frozen=True, kw_only=True)
class FollowingOptions:
    """How accessories follow.

    Args:
        small: A connected part of at most this fraction of the target's diagonal goes as one, like
            an eye or a button: the skin around it bends more than it may.
        around: Of such a part so many triangles ask what is nearest, at most; it follows the mean.
    """

    small: float = 0.15
    around: int = 32


def following_pairs(
    pairs: IntArray,
    target: FloatArray,
    faces: IntArray,
    followers: NDArray[np.bool_],
    *,
    options: FollowingOptions = FollowingOptions(),
) -> IntArray:
    """Return the pairs (K, 2) with more of them, by which followers move like what is nearest.

    Every triangle of the target (V, 3), (F, 3) in the mask `followers` (F,) is paired with the
    source triangles of the nearest triangle that has some; small parts as wholes.

    Raises:
        ValueError: nothing has a partner.
    """
    matched = np.zeros(len(faces), dtype=bool)
    matched[pairs[:, 1]] = True
    matched &= ~followers
    if not matched.any():
        raise ValueError("pairs should hold a triangle that does not follow, got none")
    led = np.flatnonzero(followers)
    if not len(led):
        return pairs
    hosts = np.flatnonzero(matched)
    nearest = nearest_triangles(target[faces[led]].mean(axis=1), target[faces[hosts]])[0]
    links = [np.stack([led, hosts[nearest]], axis=1)]
    part = components(faces, len(target))[faces[led, 0]]
    size = options.small * diagonal(target)
    for label in np.unique(part):
        own = part == label
        if diagonal(target[np.unique(faces[led[own]])]) > size:
            continue
        links[0] = links[0][~np.isin(links[0][:, 0], led[own])]
        asked = np.linspace(0, own.sum() - 1, min(options.around, int(own.sum()))).astype(int)
        of_part = np.unique(hosts[nearest[own][asked]])
        links.append(np.stack([np.repeat(led[own], len(of_part)), np.tile(of_part, own.sum())], 1))
    return np.concatenate([pairs, _joined(np.concatenate(links), pairs)]).astype(np.int32)


def _joined(links: IntArray, pairs: IntArray) -> IntArray:
    """Return the pairs (K, 2) of followers with the partners of what they are linked to."""
    order = np.argsort(pairs[:, 1], kind="stable")
    known = pairs[order]
    first = np.searchsorted(known[:, 1], links[:, 1])
    counts = np.searchsorted(known[:, 1], links[:, 1], side="right") - first
    rows = np.repeat(first - np.concatenate([[0], np.cumsum(counts)[:-1]]), counts)
    source = known[rows + np.arange(counts.sum()), 0]
    found: IntArray = np.stack([source, np.repeat(links[:, 0], counts)], axis=1).astype(np.int32)
    return found
