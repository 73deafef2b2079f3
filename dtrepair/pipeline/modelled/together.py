"""Which meshes lie to each other as their rests say: caches at one origin meet there by chance."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.geometry import FloatArray, IntArray, diagonal, lengths
from dtrepair.numerics.scale import boxes_of, gaps_between

Pairs = Sequence[tuple[int, int]]


@dataclass(frozen=True, kw_only=True)
class TogetherOptions:
    """When the rests of two meshes say nothing of how they lie to each other.

    Args:
        samples: Frames of the whole clip that are looked at, at most.
        far: What meets at rest is farther apart than this in all of them, by half of the pairs, in
            diagonals of the smaller mesh.
    """

    samples: int = 33
    far: float = 0.1


class _Meeting(NamedTuple):
    """Two meshes that meet at rest, the triangles (K, 2, 3) there, and how far apart (K,)."""

    both: tuple[int, int]
    triangles: IntArray
    apart: FloatArray


def together(
    rest: FloatArray,
    poses: Iterable[FloatArray],
    triangles: IntArray,
    meshes: IntArray,
    starts: NDArray[np.integer],
    *,
    options: TogetherOptions = TogetherOptions(),
) -> NDArray[np.int64]:
    """Return a number (M,) for each mesh: those of one number lie to each other as at rest.

    Of two meshes that meet at rest, and in no pose come near what they meet there, the rests say
    nothing.

    Args:
        rest: Points (V, 3) of all meshes at rest.
        poses: The same in frames; no more are looked at than it takes.
        triangles: Pairs of triangles (K, 2, 3) of two meshes that meet at rest.
        meshes: The two meshes (K, 2) of each pair.
        starts: The first vertex of each mesh, and V (M + 1,).
    """
    sides, place = np.unique(np.sort(meshes, axis=1), axis=0, return_inverse=True)
    own = [triangles[place.reshape(-1) == index] for index in range(len(sides))]
    met = [
        _Meeting((int(a), int(b)), each, _apart(rest, each))
        for (a, b), each in zip(sides, own, strict=True)
    ]
    parted, first = met, None
    for pose in poses if met else ():
        first = pose if first is None else first
        parted = [each for each in parted if not _near(each, rest, pose, starts, options.far)]
        if not parted:
            break
    if first is None or not parted:
        return np.zeros(len(starts) - 1, dtype=np.int64)
    gone = {each.both for each in parted}
    near = [each.both for each in met if each.both not in gone]
    return _numbered(np.diff(starts), near, sorted(gone), gaps_between(boxes_of(first, starts)))


def _apart(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Return how far (K,) the middles of two triangles (K, 2, 3) are from each other."""
    first, second = points[triangles].mean(axis=2).swapaxes(0, 1)
    return lengths(first - second)


def _near(
    met: _Meeting,
    rest: FloatArray,
    pose: FloatArray,
    starts: NDArray[np.integer],
    far: float,
) -> bool:
    """Return whether half of what two meshes meet with at rest is near in a pose, too."""
    vertices = [slice(*ends) for ends in pairwise(starts)]
    smaller = min((vertices[mesh] for mesh in met.both), key=lambda own: diagonal(rest[own]))
    size, before = diagonal(pose[smaller]), diagonal(rest[smaller])
    known = met.apart * (size / before if before > 0 else 1.0)
    return bool(np.median(_apart(pose, met.triangles) - known) <= far * size)


def _numbered(
    sizes: NDArray[np.integer], near: Pairs, parted: Pairs, gaps: FloatArray
) -> NDArray[np.int64]:
    """Return numbers (M,): one for what is near, two for what is parted, where both can be.

    The largest come first. What is neither goes with what its box lies deepest in, as eyes in
    their head do. gaps: between the boxes (M, M).
    """
    count = len(sizes)
    shape = (count, count)
    first, second = np.array([*near, *((0, 0),)], dtype=np.int64).T
    graph = sparse.csr_matrix((np.ones(len(first)), (first, second)), shape=shape)
    label = csgraph.connected_components(graph, directed=False)[1]
    never = np.zeros(shape, dtype=bool)
    for a, b in parted:
        never[a, b] = never[b, a] = True
    number = np.full(count, -1, dtype=np.int64)
    weight = np.bincount(label, sizes)
    for group in np.argsort(-weight, kind="stable").tolist():
        own = label == group
        open_ = [
            each
            for each in range(number.max() + 1)
            if not never[np.ix_(own, number == each)].any()
            and gaps[np.ix_(own, number == each)].min() <= 0.0
        ]
        deepest = [gaps[np.ix_(own, number == each)].min() for each in open_]
        number[own] = open_[int(np.argmin(deepest))] if open_ else number.max() + 1
    return number
