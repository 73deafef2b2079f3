"""Which triangles of which leaves share a vertex, known before any pose is seen.

Most triangles whose boxes overlap are neighbours on the surface, which never count: a bit leaves
them out sooner than indices do. It is no more than that: the indices of the pairs that pass are
still compared, so the pairs at a vertex of very many triangles may be missing here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import IntArray

# Bits 8 * i + j with j <= i.
LOWER = sum(1 << 8 * i + j for i in range(8) for j in range(i + 1))


@dataclass(frozen=True)
class Neighbors:
    """For each leaf the leaves from itself on that share vertices with it, as compressed rows.

    start (leaves + 1,): first entry of each leaf; leaf (N,): the other leaf, ascending in a row,
    the leaf itself first; excluded (N,) uint64: bit 8 * i + j is set if triangle i of the leaf and
    triangle j of the other share a vertex (counted from the start of their leaves), and for the
    leaf itself also if j <= i, so that each pair is met once.
    """

    start: IntArray
    leaf: IntArray
    excluded: NDArray[np.uint64]


def leaf_neighbors(faces: IntArray, leaf_start: IntArray, *, most_leaves: int = 32) -> Neighbors:
    """Return the neighbours of the leaves.

    faces: (F, 3) in leaf order, at most 8 triangles in a leaf.
    """
    leaves = len(leaf_start) - 1
    sizes = np.diff(leaf_start)
    assert sizes.max() <= 8
    leaf_of = np.repeat(np.arange(leaves), sizes)
    bits = 1 << (np.arange(len(faces)) - leaf_start[leaf_of])
    keys = faces.ravel().astype(np.int64) * leaves + np.repeat(leaf_of, 3)
    keys, members = _merged(keys, np.repeat(bits, 3).astype(np.uint64))
    vertex, leaf = np.divmod(keys, leaves)
    # Triangle i contributes its bit at 8 * i, so that a product pairs all members of both leaves.
    spread = np.zeros_like(members)
    for k in range(8):
        spread |= (members >> np.uint64(k) & np.uint64(1)) << np.uint64(8 * k)
    rows, masks = [], []
    for step in range(min(most_leaves, len(keys))):
        same = np.flatnonzero(vertex[step:] == vertex[: len(vertex) - step])
        if len(same) == 0:
            break
        rows.append(leaf[same] * leaves + leaf[same + step])
        masks.append(spread[same] * members[same + step])
    rows.append(np.arange(leaves) * (leaves + 1))
    masks.append(np.full(leaves, LOWER, dtype=np.uint64))
    row, excluded = _merged(np.concatenate(rows), np.concatenate(masks))
    start = np.searchsorted(row, np.arange(leaves + 1, dtype=np.int64) * leaves)
    return Neighbors(start.astype(np.int32), (row % leaves).astype(np.int32), excluded)


def _merged(
    keys: NDArray[np.int64], bits: NDArray[np.uint64]
) -> tuple[NDArray[np.int64], NDArray[np.uint64]]:
    """Return each key once, ascending, with the union of its bits."""
    order = np.argsort(keys, kind="stable")
    keys, bits = keys[order], bits[order]
    first = np.flatnonzero(np.r_[True, keys[1:] != keys[:-1]])
    return keys[first], np.bitwise_or.reduceat(bits, first)
