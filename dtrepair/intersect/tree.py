"""Topology of a bounding volume hierarchy, built once from a rest pose and refit to every pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtrepair.geometry import FloatArray, IntArray

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
        """Number of leaves, 2 ** depth."""
        return 1 << self.depth

    @property
    def node_count(self) -> int:
        """Number of nodes, leaves included."""
        return 2 * self.leaf_count - 1


def build_tree(centroids: FloatArray, *, leaf_size: int = LEAF_SIZE) -> Tree:
    """Median splits along the longest axis of each node's centroids (F, 3), level by level."""
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


def _segment_starts(count: int, level: int) -> np.ndarray:
    """Bounds of the 2 ** level nearly equal parts of `count` triangles; halves of halves agree."""
    return (np.arange((1 << level) + 1, dtype=np.int64) * count) >> level


def _skip_links(depth: int) -> IntArray:
    """The next node in depth-first order that is no descendant, for each node in heap order."""
    nodes = (2 << depth) - 1
    skip = np.full(nodes, nodes, dtype=np.int32)
    for level in range(1, depth + 1):
        first = (1 << level) - 1
        left = np.arange(first, first + (1 << level), 2)
        skip[left] = left + 1
        skip[left + 1] = skip[(left - 1) // 2]
    return skip
