"""Which meshes lie to each other as their rests say: caches at one origin meet there by chance."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.geometry import FloatArray, IntArray, diagonal, lengths
from dtrepair.numerics.scale import boxes_of, gaps_between

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class TogetherOptions:
    """When the rests of two meshes say nothing of how they lie to each other.

    Args:
        samples: Frames of the whole clip that are looked at, at most.
        far: What meets at rest is farther apart than this in all of them, by half of the pairs, in
            diagonals of the smaller mesh; ...
        beside: ... and their boxes overlap in at most this share of them: a rod that is drawn out
            of its sleeve is beside it all the time.
    """

    samples: int = 33
    far: float = 0.1
    beside: float = 0.5


class Together(NamedTuple):
    """Which of several meshes lie to each other as their rests say.

    parted: of which two (M, M) the rests say nothing. number: one (M,) for all that nothing was
    parted from, and one for each group of those that meet at rest and do so in frames.
    """

    parted: BoolArray
    number: NDArray[np.int64]


def together(
    rest: FloatArray,
    poses: Iterable[FloatArray],
    triangles: IntArray,
    meshes: IntArray,
    starts: NDArray[np.integer],
    *,
    options: TogetherOptions = TogetherOptions(),
) -> Together:
    """Return which meshes lie to each other as at rest.

    Of two that meet at rest, come near what they meet there in no pose, and are seldom beside each
    other at all, the rests say nothing.

    Args:
        rest: Points (V, 3) of all meshes at rest.
        poses: The same in frames; no more are looked at than it takes.
        triangles: Pairs of triangles (K, 2, 3) of two meshes that meet at rest.
        meshes: The two meshes (K, 2) of each pair.
        starts: The first vertex of each mesh, and V (M + 1,); each has some.
    """
    count = len(starts) - 1
    sides, place = np.unique(np.sort(meshes, axis=1), axis=0, return_inverse=True)
    order = np.argsort(place.reshape(-1), kind="stable")
    met = _Met(rest, triangles[order], np.sort(place.reshape(-1)), sides, starts)
    far = np.ones(len(sides), dtype=bool)
    looks, beside = np.zeros((2, len(sides)), dtype=np.int64)
    for pose in poses if len(sides) else ():
        near, shown = met.near(pose, options.far)
        far &= ~(near & shown)
        if not far.any():
            break
        gaps = gaps_between(boxes_of(pose, starts))
        looks += shown
        beside += shown & (gaps[sides[:, 0], sides[:, 1]] <= 0.0)
    parted = np.zeros((count, count), dtype=bool)
    far &= (looks > 0) & (beside <= options.beside * looks)
    first, second = sides[far].T
    parted[first, second] = parted[second, first] = True
    return Together(parted, _numbers(sides[~far], parted))


class _Met:
    """Triangles (K, 2, 3) of two meshes that meet at rest, in the order of these two.

    Args:
        rest: All meshes at rest (V, 3).
        triangles: The triangles.
        place: Which two meshes (K,) they are of, ascending.
        sides: The numbers of each two meshes (N, 2).
        starts: The first vertex of each mesh, and V (M + 1,).
    """

    def __init__(
        self,
        rest: FloatArray,
        triangles: IntArray,
        place: NDArray[np.integer],
        sides: IntArray,
        starts: NDArray[np.integer],
    ) -> None:
        self.triangles, self.place, self.sides, self.starts = triangles, place, sides, starts
        ends = np.cumsum([0, *np.bincount(place, minlength=len(sides))])
        self.middles = (ends[:-1] + ends[1:] - 1) // 2
        self.sizes, self.apart = self._sizes(rest), self._apart(rest)
        # The smaller mesh of each two.
        smaller = self.sizes[sides].argmin(axis=1)
        self.smaller = np.take_along_axis(sides, smaller[:, None], axis=1)[:, 0]

    def near(self, pose: FloatArray, far: float) -> tuple[BoolArray, BoolArray]:
        """Return of which two meshes (N,) half of what meets at rest is near in a pose.

        And which two are shown there: what is scaled to nothing is not.
        """
        posed = self._sizes(pose)
        shown = (posed > 1e-6 * self.sizes)[self.sides].all(axis=1)
        sizes, before = posed[self.smaller], self.sizes[self.smaller]
        scale = np.where(before > 0.0, sizes / np.maximum(before, 1e-300), 1.0)
        beyond = self._apart(pose) - scale[self.place] * self.apart
        ordered = beyond[np.lexsort((beyond, self.place))]
        return ordered[self.middles] <= far * sizes, shown

    def _sizes(self, points: FloatArray) -> FloatArray:
        """Return the diagonal (M,) of each mesh in points (V, 3)."""
        return np.array([diagonal(points[a:b]) for a, b in pairwise(self.starts)])

    def _apart(self, points: FloatArray) -> FloatArray:
        """Return how far (K,) the middles of two triangles are from each other."""
        first, second = points[self.triangles].mean(axis=2).swapaxes(0, 1)
        return lengths(first - second)


def _numbers(near: IntArray, parted: BoolArray) -> NDArray[np.int64]:
    """Return a number (M,) for each group of what is near, 0 where nothing of it is parted."""
    count = len(parted)
    ones = np.ones(len(near))
    graph = sparse.csr_matrix((ones, (near[:, 0], near[:, 1])), shape=(count, count))
    label = csgraph.connected_components(graph, directed=False)[1]
    groups = np.unique(label[parted.any(axis=1)])
    return np.where(np.isin(label, groups), np.searchsorted(groups, label) + 1, 0)
