"""Which meshes lie to each other as their rests say: caches at one origin meet there by chance."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.pipeline.modelled.meetings import meetings

BoolArray = NDArray[np.bool_]


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
    mesh_of = np.searchsorted(starts, faces[:, 0], side="right") - 1
    sides, passing = meetings(rest, poses, faces, pairs, mesh_of)
    parted = np.zeros((count, count), dtype=bool)
    first, second = sides[passing].T
    parted[first, second] = parted[second, first] = True
    return Together(parted, _numbers(sides[~passing], parted))


def _numbers(near: IntArray, parted: BoolArray) -> NDArray[np.int64]:
    """Return a number (M,) for each group of what is near, 0 where nothing of it is parted."""
    count = len(parted)
    ones = np.ones(len(near))
    graph = sparse.csr_matrix((ones, (near[:, 0], near[:, 1])), shape=(count, count))
    label = csgraph.connected_components(graph, directed=False)[1]
    groups = np.unique(label[parted.any(axis=1)])
    return np.where(np.isin(label, groups), np.searchsorted(groups, label) + 1, 0)
