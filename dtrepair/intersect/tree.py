"""Topology of a bounding volume hierarchy, built once from a rest pose and refit to every pose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray

LEAF_SIZE = 8
# Bits 8 * i + j with j <= i.
LOWER = sum(1 << 8 * i + j for i in range(8) for j in range(i + 1))


@dataclass(frozen=True)
class Tree:
    """A complete binary tree in heap order: node k has the children 2k + 1 and 2k + 2.

    order (F,): triangles in leaf order; leaf_start (leaves + 1,): first triangle of each leaf in
    `order`; skip (nodes,): the node to go to when the subtree of a node is left out (depth-first
    order; `nodes` after the last one); depth: levels above the leaves.
    """

    order: IntArray
    leaf_start: IntArray
    skip: IntArray
    depth: int

    @property
    def leaf_count(self) -> int:
        """The number of leaves, 2 ** depth."""
        return 1 << self.depth

    @property
    def node_count(self) -> int:
        """The number of nodes, leaves included."""
        return 2 * self.leaf_count - 1

    def marks(self, active: NDArray[np.bool_]) -> NDArray[np.uint8]:
        """Return the bits (nodes,) of active triangles (F,).

        Bit k of a leaf is that of its triangle k in order; inner nodes unite their leaves.
        """
        marks = np.zeros(self.node_count, dtype=np.uint8)
        bits = self._bits * active[self.order]
        marks[self.leaf_count - 1 :] = np.bitwise_or.reduceat(bits, self.leaf_start[:-1])
        for level in reversed(range(self.depth)):
            first = (1 << level) - 1
            children = marks[2 * first + 1 : 4 * first + 3]
            marks[first : 2 * first + 1] = children[::2] | children[1::2]
        return marks

    @cached_property
    def _bits(self) -> NDArray[np.uint8]:
        """One bit (F,) for each triangle of a leaf, in leaf order."""
        place = np.arange(len(self.order)) - np.repeat(
            self.leaf_start[:-1], np.diff(self.leaf_start)
        )
        return (1 << place).astype(np.uint8)


def build_tree(centroids: FloatArray, *, leaf_size: int = LEAF_SIZE) -> Tree:
    """Split the centroids (F, 3) of each node at the median of its longest axis, level by level."""
    count = len(centroids)
    depth = 0
    while count > leaf_size << depth:
        depth += 1
    order = np.arange(count)
    for level in range(depth):
        starts = _segment_starts(count, level)
        segment = np.repeat(np.arange(1 << level), np.diff(starts))
        ordered = centroids[order]
        spread = np.maximum.reduceat(ordered, starts[:-1]) - np.minimum.reduceat(
            ordered, starts[:-1]
        )
        keys = ordered[np.arange(count), spread.argmax(axis=1)[segment]]
        order = order[np.lexsort((keys, segment))]
    leaf_start = _segment_starts(count, depth)
    return Tree(order.astype(np.int32), leaf_start.astype(np.int32), _skip_links(depth), depth)


def _segment_starts(count: int, level: int) -> NDArray[np.int64]:
    """Return the bounds of the 2 ** level nearly equal parts of `count` triangles.

    Halves of halves agree.
    """
    return (np.arange((1 << level) + 1, dtype=np.int64) * count) >> level


def _skip_links(depth: int) -> IntArray:
    """Return for each node in heap order the next node that is no descendant of it.

    Next is meant in depth-first order; (nodes,), the number of nodes after the last one.
    """
    nodes = (2 << depth) - 1
    skip = np.full(nodes, nodes, dtype=np.int32)
    for level in range(1, depth + 1):
        first = (1 << level) - 1
        left = np.arange(first, first + (1 << level), 2)
        skip[left] = left + 1
        skip[left + 1] = skip[(left - 1) // 2]
    return skip


@dataclass(frozen=True)
class Neighbors:
    """Which triangles of which leaves share a vertex, known before any pose is seen.

    Most triangles whose boxes overlap are neighbours on the surface, which never count: a bit
    leaves them out sooner than indices do. It is no more than that: the indices of the pairs that
    pass are still compared, so the pairs at a vertex of very many triangles may be missing here.

    For each leaf the leaves from itself on that share vertices with it, as compressed rows.

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
