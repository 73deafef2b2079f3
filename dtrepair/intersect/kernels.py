"""Warp kernels of the detector: refit and traversal."""

from __future__ import annotations

from dtrepair.device import start_warp
from dtrepair.intersect.predicates import APART, classify

wp = start_warp()
wp.set_module_options({"enable_backward": False, "fast_math": False})


@wp.func
def overlap(low_a: wp.vec3f, high_a: wp.vec3f, low_b: wp.vec3f, high_b: wp.vec3f) -> bool:
    """Whether two closed boxes have a common point."""
    return (
        low_a[0] <= high_b[0]
        and high_a[0] >= low_b[0]
        and low_a[1] <= high_b[1]
        and high_a[1] >= low_b[1]
        and low_a[2] <= high_b[2]
        and high_a[2] >= low_b[2]
    )


@wp.func
def share_vertex(a: wp.vec3i, b: wp.vec3i) -> bool:
    """Whether two triangles have a (welded) vertex in common."""
    return (
        a[0] == b[0]
        or a[0] == b[1]
        or a[0] == b[2]
        or a[1] == b[0]
        or a[1] == b[1]
        or a[1] == b[2]
        or a[2] == b[0]
        or a[2] == b[1]
        or a[2] == b[2]
    )


@wp.func
def test_pair(
    frame: int,
    i: int,
    j: int,
    points: wp.array2d(dtype=wp.vec3f),
    faces: wp.array(dtype=wp.vec3i),
    welded: wp.array(dtype=wp.vec3i),
    order: wp.array(dtype=wp.int32),
    low: wp.array2d(dtype=wp.vec3f),
    high: wp.array2d(dtype=wp.vec3f),
    pairs: wp.array(dtype=wp.vec4i),
    count: wp.array(dtype=wp.int32),
):
    """Appends (frame, smaller, larger, certain) of an intersecting or uncertain pair."""
    if not overlap(low[frame, i], high[frame, i], low[frame, j], high[frame, j]):
        return
    if share_vertex(welded[i], welded[j]):
        return
    a = faces[i]
    b = faces[j]
    found = classify(
        points[frame, a[0]],
        points[frame, a[1]],
        points[frame, a[2]],
        points[frame, b[0]],
        points[frame, b[1]],
        points[frame, b[2]],
    )
    if found != APART:
        slot = wp.atomic_add(count, 0, 1)
        if slot < pairs.shape[0]:
            t = order[i]
            u = order[j]
            pairs[slot] = wp.vec4i(frame, wp.min(t, u), wp.max(t, u), found)


@wp.kernel
def fit_leaves(
    points: wp.array2d(dtype=wp.vec3f),
    faces: wp.array(dtype=wp.vec3i),
    leaf_start: wp.array(dtype=wp.int32),
    low: wp.array2d(dtype=wp.vec3f),
    high: wp.array2d(dtype=wp.vec3f),
    node_low: wp.array2d(dtype=wp.vec3f),
    node_high: wp.array2d(dtype=wp.vec3f),
):
    """Boxes of the triangles (in leaf order) and of the leaves; one thread a frame and leaf."""
    frame, leaf = wp.tid()
    first = leaf_start[leaf]
    last = leaf_start[leaf + 1]
    leaf_low = wp.vec3f(1.0e38, 1.0e38, 1.0e38)
    leaf_high = wp.vec3f(-1.0e38, -1.0e38, -1.0e38)
    for i in range(first, last):
        f = faces[i]
        a = points[frame, f[0]]
        b = points[frame, f[1]]
        c = points[frame, f[2]]
        triangle_low = wp.min(a, wp.min(b, c))
        triangle_high = wp.max(a, wp.max(b, c))
        low[frame, i] = triangle_low
        high[frame, i] = triangle_high
        leaf_low = wp.min(leaf_low, triangle_low)
        leaf_high = wp.max(leaf_high, triangle_high)
    node = leaf_start.shape[0] - 2 + leaf
    node_low[frame, node] = leaf_low
    node_high[frame, node] = leaf_high


@wp.kernel
def fit_level(
    first: int,
    node_low: wp.array2d(dtype=wp.vec3f),
    node_high: wp.array2d(dtype=wp.vec3f),
):
    """Boxes of one level of inner nodes from their children; one thread a frame and node."""
    frame, k = wp.tid()
    node = first + k
    left = 2 * node + 1
    node_low[frame, node] = wp.min(node_low[frame, left], node_low[frame, left + 1])
    node_high[frame, node] = wp.max(node_high[frame, left], node_high[frame, left + 1])


@wp.kernel
def find_pairs(
    points: wp.array2d(dtype=wp.vec3f),
    faces: wp.array(dtype=wp.vec3i),
    welded: wp.array(dtype=wp.vec3i),
    order: wp.array(dtype=wp.int32),
    leaf_start: wp.array(dtype=wp.int32),
    skip: wp.array(dtype=wp.int32),
    low: wp.array2d(dtype=wp.vec3f),
    high: wp.array2d(dtype=wp.vec3f),
    node_low: wp.array2d(dtype=wp.vec3f),
    node_high: wp.array2d(dtype=wp.vec3f),
    pairs: wp.array(dtype=wp.vec4i),
    count: wp.array(dtype=wp.int32),
):
    """Pairs of each leaf with itself and with the leaves behind it; one thread a frame and leaf."""
    frame, leaf = wp.tid()
    first = leaf_start[leaf]
    last = leaf_start[leaf + 1]
    for i in range(first, last):
        for j in range(i + 1, last):
            test_pair(frame, i, j, points, faces, welded, order, low, high, pairs, count)
    leaves = leaf_start.shape[0] - 1
    own_low = node_low[frame, leaves - 1 + leaf]
    own_high = node_high[frame, leaves - 1 + leaf]
    # What follows a leaf in depth-first order holds exactly the leaves behind it.
    node = skip[leaves - 1 + leaf]
    while node < skip.shape[0]:
        if overlap(own_low, own_high, node_low[frame, node], node_high[frame, node]):
            if node >= leaves - 1:
                other = node - leaves + 1
                for i in range(first, last):
                    if overlap(
                        low[frame, i], high[frame, i], node_low[frame, node], node_high[frame, node]
                    ):
                        for j in range(leaf_start[other], leaf_start[other + 1]):
                            test_pair(
                                frame, i, j, points, faces, welded, order, low, high, pairs, count
                            )
                node = skip[node]
            else:
                node = 2 * node + 1
        else:
            node = skip[node]


@wp.kernel
def find_active_pairs(
    points: wp.array2d(dtype=wp.vec3f),
    faces: wp.array(dtype=wp.vec3i),
    welded: wp.array(dtype=wp.vec3i),
    order: wp.array(dtype=wp.int32),
    leaf_start: wp.array(dtype=wp.int32),
    skip: wp.array(dtype=wp.int32),
    low: wp.array2d(dtype=wp.vec3f),
    high: wp.array2d(dtype=wp.vec3f),
    node_low: wp.array2d(dtype=wp.vec3f),
    node_high: wp.array2d(dtype=wp.vec3f),
    pairs: wp.array(dtype=wp.vec4i),
    count: wp.array(dtype=wp.int32),
    queries: wp.array(dtype=wp.int32),
    active: wp.array(dtype=wp.uint8),
):
    """Pairs with an active triangle; one thread a frame and active triangle (in leaf order)."""
    frame, query = wp.tid()
    i = queries[query]
    leaves = leaf_start.shape[0] - 1
    node = int(0)
    while node < skip.shape[0]:
        if overlap(low[frame, i], high[frame, i], node_low[frame, node], node_high[frame, node]):
            if node >= leaves - 1:
                leaf = node - leaves + 1
                for j in range(leaf_start[leaf], leaf_start[leaf + 1]):
                    # A pair of two active triangles is found from its first one only.
                    if i < j or active[j] == wp.uint8(0):
                        test_pair(
                            frame, i, j, points, faces, welded, order, low, high, pairs, count
                        )
                node = skip[node]
            else:
                node = 2 * node + 1
        else:
            node = skip[node]
