"""Topology of a bounding volume hierarchy, built once from a rest pose and refit to every pose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray

LEAF_SIZE = 8


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
