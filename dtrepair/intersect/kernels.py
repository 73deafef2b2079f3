"""Warp kernels of the detector: refit and traversal."""

from __future__ import annotations

from dtrepair.device import start_warp
from dtrepair.intersect.predicates import APART, Zones, classify, is_modelled

wp = start_warp()
wp.set_module_options({"enable_backward": False, "fast_math": False})


# The same bound of all (at most eight) triangles of a leaf, side by side for vector instructions.
vec8f = wp.types.vector(length=8, dtype=wp.float32)


@wp.func
def larger(a: float, b: float) -> float:
    """The larger of two finite numbers; `wp.max` also minds NaN, which costs vector code."""
    return wp.where(a > b, a, b)


@wp.func
def gap(
    low_a: wp.vec3f,
    high_a: wp.vec3f,
    low_x: float,
    low_y: float,
    low_z: float,
    high_x: float,
    high_y: float,
    high_z: float,
) -> float:
    """Positive if two closed boxes have no common point: the sign of a difference is exact."""
    return larger(
        larger(
            larger(low_a[0] - high_x, low_a[1] - high_y),
            larger(low_a[2] - high_z, low_x - high_a[0]),
        ),
        larger(low_y - high_a[1], low_z - high_a[2]),
    )


@wp.func
def overlap(low_a: wp.vec3f, high_a: wp.vec3f, low_b: wp.vec3f, high_b: wp.vec3f) -> bool:
    """Whether two closed boxes have a common point; one comparison, as branches are guesses."""
    return gap(low_a, high_a, low_b[0], low_b[1], low_b[2], high_b[0], high_b[1], high_b[2]) <= 0.0


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


@wp.kernel
def fit_leaves(
    points: wp.array2d(dtype=wp.vec3f),
    faces: wp.array(dtype=wp.vec3i),
    leaf_start: wp.array(dtype=wp.int32),
    low: wp.array2d(dtype=wp.vec3f),
    high: wp.array2d(dtype=wp.vec3f),
    node_low: wp.array2d(dtype=wp.vec3f),
    node_high: wp.array2d(dtype=wp.vec3f),
    blocks: wp.array3d(dtype=vec8f),
):
    """Boxes of triangles (in leaf order, and as blocks) and leaves; one thread a frame and leaf."""
    frame, leaf = wp.tid()
    first = leaf_start[leaf]
    count = leaf_start[leaf + 1] - first
    leaf_low = wp.vec3f(wp.inf, wp.inf, wp.inf)
    leaf_high = -leaf_low
    block_low = wp.matrix(shape=(3, 8), dtype=wp.float32)
    block_high = wp.matrix(shape=(3, 8), dtype=wp.float32)
    for k in range(8):
        triangle_low = wp.vec3f(wp.inf, wp.inf, wp.inf)
        triangle_high = -triangle_low
        if k < count:
            f = faces[first + k]
            a = points[frame, f[0]]
            b = points[frame, f[1]]
            c = points[frame, f[2]]
            triangle_low = wp.min(a, wp.min(b, c))
            triangle_high = wp.max(a, wp.max(b, c))
            low[frame, first + k] = triangle_low
            high[frame, first + k] = triangle_high
        for axis in range(3):
            block_low[axis, k] = triangle_low[axis]
            block_high[axis, k] = triangle_high[axis]
        leaf_low = wp.min(leaf_low, triangle_low)
        leaf_high = wp.max(leaf_high, triangle_high)
    for axis in range(3):
        blocks[frame, leaf, axis] = block_low[axis]
        blocks[frame, leaf, 3 + axis] = block_high[axis]
    node = leaf_start.shape[0] - 2 + leaf
    node_low[frame, node] = leaf_low
    node_high[frame, node] = leaf_high


@wp.kernel
def fit_levels(
    first: int,
    levels: int,
    node_low: wp.array2d(dtype=wp.vec3f),
    node_high: wp.array2d(dtype=wp.vec3f),
):
    """Boxes of some levels of inner nodes from those below; one thread a frame and upper node."""
    frame, k = wp.tid()
    for level in range(levels):
        below = levels - 1 - level
        start = ((first + k + 1) << below) - 1
        for node in range(start, start + (1 << below)):
            left = 2 * node + 1
            node_low[frame, node] = wp.min(node_low[frame, left], node_low[frame, left + 1])
            node_high[frame, node] = wp.max(node_high[frame, left], node_high[frame, left + 1])


@wp.func
def in_reach(
    low: wp.vec3f, high: wp.vec3f, blocks: wp.array3d(dtype=vec8f), frame: int, leaf: int
) -> int:
    """Bit k: the box of triangle k of a leaf overlaps a box: few do, of leaves that overlap.

    The sign bits of the gaps are put together: the same steps for all eight make vector code.
    """
    low_x = blocks[frame, leaf, 0]
    low_y = blocks[frame, leaf, 1]
    low_z = blocks[frame, leaf, 2]
    high_x = blocks[frame, leaf, 3]
    high_y = blocks[frame, leaf, 4]
    high_z = blocks[frame, leaf, 5]
    row = int(0)
    for k in range(8):
        apart = gap(low, high, low_x[k], low_y[k], low_z[k], high_x[k], high_y[k], high_z[k])
        row = row | (wp.int32(wp.cast(0.0 - apart, wp.uint32) >> wp.uint32(30 - k)) & (2 << k))
    return (row ^ 510) >> 1


@wp.func
def lowest_bit(bits: int) -> int:
    """Which is the lowest bit that is set of eight, by a product that tells all of them apart."""
    return (0x45263107 >> 4 * (((bits & (-bits)) * 23 >> 4) & 7)) & 7


@wp.func
def wanted(k: int, excluded: wp.uint64, own_active: int, other_active: int) -> int:
    """Triangles of another leaf, as bits, of which triangle k of a leaf is to be paired."""
    row = ~wp.int32((excluded >> wp.uint64(8 * k)) & wp.uint64(255))
    if (own_active >> k) & 1 == 0:
        row = row & other_active
    return row


@wp.func
def pairs_left_out(
    neighbor: wp.array(dtype=wp.int32),
    excluded: wp.array(dtype=wp.uint64),
    entry: int,
    last_entry: int,
    other: int,
) -> wp.uint64:
    """Pairs with a leaf, as bits, that share a vertex: those of an entry if it is of that leaf."""
    if entry < last_entry and neighbor[entry] == other:
        return excluded[entry]
    return wp.uint64(0)


@wp.func
def add_pairs(
    frame: int,
    i: int,
    first: int,
    others: int,
    welded: wp.array(dtype=wp.vec3i),
    zones: Zones,
    candidates: wp.array(dtype=wp.vec3i),
    count: wp.array(dtype=wp.int32),
) -> int:
    """Write the pairs of a triangle with others, bits from `first` on; how many others those are.

    Pairs that share a vertex are left out, and modelled ones.
    """
    own = welded[i]
    row = int(others)
    met = int(0)
    while row != 0:
        j = first + lowest_bit(row)
        row = row & (row - 1)
        met += 1
        if not share_vertex(own, welded[j]) and not is_modelled(i, j, zones):
            slot = wp.atomic_add(count, 0, 1)
            if slot < candidates.shape[0]:
                candidates[slot] = wp.vec3i(frame, i, j)
    return met


@wp.func
def enough(met: int, most: int, most_of_leaf: int, count: wp.array(dtype=wp.int32)) -> bool:
    """Whether there are too many pairs, which one leaf alone may tell: the pose has collapsed."""
    if met > most_of_leaf:
        wp.atomic_max(count, 0, most + 1)
    return count[0] > most


@wp.kernel
def find_candidates(
    leaf_start: wp.array(dtype=wp.int32),
    skip: wp.array(dtype=wp.int32),
    welded: wp.array(dtype=wp.vec3i),
    neighbor_start: wp.array(dtype=wp.int32),
    neighbor: wp.array(dtype=wp.int32),
    excluded: wp.array(dtype=wp.uint64),
    active: wp.array(dtype=wp.uint8),
    zones: Zones,
    low: wp.array2d(dtype=wp.vec3f),
    high: wp.array2d(dtype=wp.vec3f),
    node_low: wp.array2d(dtype=wp.vec3f),
    node_high: wp.array2d(dtype=wp.vec3f),
    blocks: wp.array3d(dtype=vec8f),
    most: int,
    most_of_leaf: int,
    candidates: wp.array(dtype=wp.vec3i),
    count: wp.array(dtype=wp.int32),
):
    """Pairs (frame, i, j), i < j in leaf order, that share no vertex and whose boxes overlap.

    One thread a frame and leaf: the leaf with itself and those behind it. Bit k of a leaf is set in
    `active` if its triangle k is; pairs of two that are not are left out, and modelled ones. With
    more than `most` pairs, or `most_of_leaf` triangles that a leaf has met, the search ends: of
    poses that collapsed the count is more than `most` in no time, and cannot wrap around.
    """
    frame, leaf = wp.tid()
    entry = neighbor_start[leaf]
    last_entry = neighbor_start[leaf + 1]
    leaves = leaf_start.shape[0] - 1
    # From a leaf on, depth-first order holds exactly the leaves behind it, and so do neighbours.
    node = leaves - 1 + leaf
    own_low = node_low[frame, node]
    own_high = node_high[frame, node]
    own_active = wp.int32(active[node])
    met = int(0)
    while node < skip.shape[0]:
        other_low = node_low[frame, node]
        other_high = node_high[frame, node]
        other_active = wp.int32(active[node])
        if own_active + other_active == 0 or not overlap(own_low, own_high, other_low, other_high):
            node = skip[node]
        elif node < leaves - 1:
            node = 2 * node + 1
        else:
            if enough(met, most, most_of_leaf, count):
                return
            other = node - leaves + 1
            node = skip[node]
            while entry < last_entry and neighbor[entry] < other:
                entry += 1
            out = pairs_left_out(neighbor, excluded, entry, last_entry, other)
            reaching = in_reach(other_low, other_high, blocks, frame, leaf)
            while reaching != 0:
                k = lowest_bit(reaching)
                reaching = reaching & (reaching - 1)
                i = leaf_start[leaf] + k
                row = in_reach(low[frame, i], high[frame, i], blocks, frame, other)
                row = row & wanted(k, out, own_active, other_active)
                met += add_pairs(frame, i, leaf_start[other], row, welded, zones, candidates, count)


@wp.func
def classified(
    points: wp.array2d(dtype=wp.vec3f), frame: wp.int32, a: wp.vec3i, b: wp.vec3i
) -> wp.int32:
    """What two triangles of a pose have in common."""
    return classify(
        points[frame, a[0]],
        points[frame, a[1]],
        points[frame, a[2]],
        points[frame, b[0]],
        points[frame, b[1]],
        points[frame, b[2]],
    )


@wp.kernel
def test_candidates(
    candidates: wp.array(dtype=wp.vec3i),
    points: wp.array2d(dtype=wp.vec3f),
    faces: wp.array(dtype=wp.vec3i),
    order: wp.array(dtype=wp.int32),
    pairs: wp.array(dtype=wp.vec4i),
    count: wp.array(dtype=wp.int32),
):
    """Rows (frame, smaller, larger, certain) of the candidates that intersect or may do so."""
    candidate = candidates[wp.tid()]
    frame = candidate[0]
    i = candidate[1]
    j = candidate[2]
    found = classified(points, frame, faces[i], faces[j])
    if found != APART:
        t = order[i]
        u = order[j]
        pairs[wp.atomic_add(count, 0, 1)] = wp.vec4i(frame, wp.min(t, u), wp.max(t, u), found)
