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

from dtrepair.numerics.closest_point import nearest_triangles
from dtrepair.numerics.geometry import FloatArray, IntArray, diagonal, lengths

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class TogetherOptions:
    """When the rests of two meshes say nothing of how they lie to each other.

    Args:
        samples: Frames of the whole clip that are looked at, at most.
        far: What meets at rest is farther apart than this in all of them, by half of the pairs, in
            diagonals of the smaller mesh; ...
        touch: ... and in less than half of them half of what meets the other mesh at rest, of one
            of the two, is no more than this farther from it, in the same unit: a rod that is drawn
            out of its sleeve, or a wheel, is elsewhere but touches what it did.
        places: So many places are asked for that, at most.
    """

    samples: int = 33
    far: float = 0.1
    touch: float = 0.02
    places: int = 200


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
    faces: IntArray,
    pairs: IntArray,
    starts: NDArray[np.integer],
    *,
    options: TogetherOptions = TogetherOptions(),
) -> Together:
    """Return which meshes lie to each other as at rest.

    Of two that meet at rest, come near what they meet there in no pose, and seldom touch each
    other with it, the rests say nothing.

    Args:
        rest: Points (V, 3) of all meshes at rest.
        poses: The same in frames; no more are looked at than it takes.
        faces: Their triangles (F, 3).
        pairs: The triangles (K, 2) of two meshes each that meet at rest.
        starts: The first vertex of each mesh, and V (M + 1,); each has some.
    """
    count = len(starts) - 1
    met = _Met(rest, faces, pairs, starts, options)
    sides = met.sides
    far = np.ones(len(sides), dtype=bool)
    looks, touching = np.zeros((2, len(sides)), dtype=int)
    for pose in poses if len(sides) else ():
        near, shown = met.near(pose)
        far &= ~(near & shown)
        if not far.any():
            break
        looks += shown
        touching[far & shown] += met.touch(pose, np.flatnonzero(far & shown).tolist())
    parted = np.zeros((count, count), dtype=bool)
    far &= 2 * touching < looks
    first, second = sides[far].T
    parted[first, second] = parted[second, first] = True
    return Together(parted, _numbers(sides[~far], parted))


class _Met:
    """What meets of each two meshes at rest.

    Args:
        rest: All meshes at rest (V, 3).
        faces: Their triangles (F, 3).
        pairs: The triangles (K, 2) that meet, of two meshes each.
        starts: The first vertex of each mesh, and V (M + 1,).
        options: Numbers.
    """

    def __init__(
        self,
        rest: FloatArray,
        faces: IntArray,
        pairs: IntArray,
        starts: NDArray[np.integer],
        options: TogetherOptions,
    ) -> None:
        self.faces, self.starts, self.options = faces, starts, options
        self.mesh_of = np.searchsorted(starts, faces[:, 0], side="right") - 1
        pairs = np.sort(pairs, axis=1)  # triangles are in the order of the meshes
        # The two meshes (N, 2), and which (K,) two each pair is of.
        sides, place = np.unique(self.mesh_of[pairs], axis=0, return_inverse=True)
        self.sides = sides.astype(np.int32)
        order = np.argsort(place.reshape(-1), kind="stable")
        self.pairs, self.place = pairs[order], place.reshape(-1)[order]
        ends = np.cumsum([0, *np.bincount(self.place, minlength=len(self.sides))])
        self.middles = (ends[:-1] + ends[1:] - 1) // 2
        self.sizes, self.apart = self._sizes(rest), self._apart(rest)
        # The smaller mesh of each two.
        smaller = self.sizes[self.sides].argmin(axis=1)
        self.smaller = np.take_along_axis(self.sides, smaller[:, None], axis=1)[:, 0]
        self._places = [
            [self._some(rest, index, side) for side in (0, 1)] for index in range(len(self.sides))
        ]

    def near(self, pose: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Return of which two meshes (N,) half of what meets at rest is near in a pose.

        And which two are shown there: what is scaled to nothing is not.
        """
        posed = self._sizes(pose)
        shown = (posed > 1e-6 * self.sizes)[self.sides].all(axis=1)
        sizes, before = posed[self.smaller], self.sizes[self.smaller]
        scale = np.where(before > 0.0, sizes / np.maximum(before, 1e-300), 1.0)
        beyond = self._apart(pose) - scale[self.place] * self.apart
        ordered = beyond[np.lexsort((beyond, self.place))]
        return np.asarray(ordered[self.middles] <= self.options.far * sizes), np.asarray(shown)

    def touch(self, pose: FloatArray, chosen: Sequence[int]) -> BoolArray:
        """Return of which of some two meshes (C,) one touches the other half as much as at rest."""
        found = np.zeros(len(chosen), dtype=bool)
        for row, index in enumerate(chosen):
            start = self.smaller[index]
            size = diagonal(pose[self.starts[start] : self.starts[start + 1]])
            for side, (own, reach) in enumerate(self._places[index]):
                away = self._distances(pose, index, side, own)
                found[row] |= np.median(away - reach) <= self.options.touch * size
        return found

    def _some(
        self, rest: FloatArray, index: int, side: int
    ) -> tuple[NDArray[np.integer], FloatArray]:
        """Return a few triangles (N,) of one of two meshes that meet, and their distances (N,)."""
        own = np.unique(self.pairs[self.place == index, side])
        own = own[:: -(-len(own) // self.options.places)]
        return own, self._distances(rest, index, side, own)

    def _distances(
        self, points: FloatArray, index: int, side: int, triangles: NDArray[np.integer]
    ) -> FloatArray:
        """Return how far the middles of a mesh's triangles (N,) are from the other one of two."""
        other = self.faces[self.mesh_of == self.sides[index, 1 - side]]
        middles = points[self.faces[triangles]].mean(axis=1)
        return lengths(nearest_triangles(middles, points[other])[1] - middles)

    def _sizes(self, points: FloatArray) -> FloatArray:
        """Return the diagonal (M,) of each mesh in points (V, 3)."""
        return np.array([diagonal(points[a:b]) for a, b in pairwise(self.starts)])

    def _apart(self, points: FloatArray) -> FloatArray:
        """Return how far (K,) the middles of two triangles are from each other."""
        first, second = points[self.faces[self.pairs]].mean(axis=2).swapaxes(0, 1)
        return lengths(first - second)


def _numbers(near: IntArray, parted: BoolArray) -> NDArray[np.int64]:
    """Return a number (M,) for each group of what is near, 0 where nothing of it is parted."""
    count = len(parted)
    ones = np.ones(len(near))
    graph = sparse.csr_matrix((ones, (near[:, 0], near[:, 1])), shape=(count, count))
    label = csgraph.connected_components(graph, directed=False)[1]
    groups = np.unique(label[parted.any(axis=1)])
    return np.where(np.isin(label, groups), np.searchsorted(groups, label) + 1, 0)
