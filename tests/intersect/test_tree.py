"""The topology of the hierarchy: every triangle once, depth-first links, balanced halves."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from dtrepair.intersect.tree import Tree, build_tree


def random_tree(count: int, leaf_size: int = 4) -> Tree:
    return build_tree(np.random.default_rng(count).random((count, 3)), leaf_size=leaf_size)


def depth_first(tree: Tree) -> list[int]:
    """Heap indices in depth-first order, by recursion."""
    nodes: list[int] = []
    pending = [0]
    while pending:
        node = pending.pop()
        nodes.append(node)
        if node < tree.leaf_count - 1:
            pending += [2 * node + 2, 2 * node + 1]
    return nodes


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 7, 8, 9, 64, 65, 1000])
def test_every_triangle_is_in_one_leaf(count: int) -> None:
    tree = random_tree(count)
    assert sorted(tree.order.tolist()) == list(range(count))
    sizes = np.diff(tree.leaf_start)
    assert tree.leaf_start[0] == 0 and tree.leaf_start[-1] == count
    assert len(sizes) == tree.leaf_count == 2**tree.depth
    assert sizes.min() >= 1 and sizes.max() <= 4 and np.ptp(sizes) <= 1


@pytest.mark.parametrize("count", [1, 5, 33, 130])
def test_skip_links_follow_depth_first_order(count: int) -> None:
    tree = random_tree(count)
    assert len(tree.skip) == tree.node_count
    order = depth_first(tree)
    position = {node: place for place, node in enumerate(order)}
    position[tree.node_count] = len(order)
    for node in range(tree.node_count):
        level = (node + 1).bit_length() - 1
        subtree = 2 ** (tree.depth - level + 1) - 1
        assert position[int(tree.skip[node])] == position[node] + subtree


def test_leaves_come_in_depth_first_order() -> None:
    tree = random_tree(100)
    leaves = [node for node in depth_first(tree) if node >= tree.leaf_count - 1]
    assert all(b == a + 1 for a, b in pairwise(leaves))


def test_the_first_split_is_along_the_longest_axis() -> None:
    centroids = np.random.default_rng(0).random((64, 3)) * (1, 10, 1)
    tree = build_tree(centroids)
    half = tree.leaf_start[tree.leaf_count // 2]
    first, second = centroids[tree.order[:half], 1], centroids[tree.order[half:], 1]
    assert first.max() <= second.min()


def test_equal_centroids_still_split() -> None:
    tree = build_tree(np.zeros((37, 3)))
    assert sorted(tree.order.tolist()) == list(range(37))


def test_the_tree_is_the_same_each_time() -> None:
    assert np.array_equal(random_tree(500).order, random_tree(500).order)
