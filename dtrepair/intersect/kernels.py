"""Warp kernels of the detector: refit, traversal and the filtered triangle-triangle test.

Coordinates are float32, arithmetic is float64 with an error bound on every sign (Shewchuk 1997):
a pair is certainly apart, certainly intersecting, or left to exact arithmetic. The bounds stay
valid under fused multiply-add, which only takes rounding errors away.
"""

from __future__ import annotations

from dtrepair.device import start_warp

wp = start_warp()
wp.set_module_options({"enable_backward": False, "fast_math": False})

APART = wp.constant(0)
INTERSECTING = wp.constant(1)
UNCERTAIN = wp.constant(2)

# (7 + 56 eps) eps of Shewchuk's orientation filter is 7.8e-16.
SIGN_BOUND = wp.constant(wp.float64(1.0e-15))
# Below this a product of three differences may have lost bits to underflow.
UNDERFLOW = wp.constant(wp.float64(1.0e-280))
ZERO = wp.constant(wp.float64(0.0))


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
def double(v: wp.vec3f) -> wp.vec3d:
    """The same vector in float64."""
    return wp.vec3d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))


@wp.func
def absolute(v: wp.vec3d) -> wp.vec3d:
    """Absolute values of the components."""
    return wp.vec3d(wp.abs(v[0]), wp.abs(v[1]), wp.abs(v[2]))


@wp.func
def cross_bound(u: wp.vec3d, v: wp.vec3d) -> wp.vec3d:
    """The cross product with every difference turned into a sum: bounds its rounding errors."""
    return wp.vec3d(
        wp.abs(u[1] * v[2]) + wp.abs(u[2] * v[1]),
        wp.abs(u[2] * v[0]) + wp.abs(u[0] * v[2]),
        wp.abs(u[0] * v[1]) + wp.abs(u[1] * v[0]),
    )


@wp.func
def filtered_sign(normal: wp.vec3d, bound: wp.vec3d, w: wp.vec3d) -> int:
    """Sign of normal . w if it is certain, else 0."""
    value = wp.dot(normal, w)
    error = SIGN_BOUND * wp.dot(bound, absolute(w)) + UNDERFLOW
    sign = int(0)
    if value > error:
        sign = int(1)
    if value < -error:
        sign = int(-1)
    return sign


@wp.func
def separated_along(
    axis: wp.vec3d, a1: wp.vec3d, a2: wp.vec3d, b0: wp.vec3d, b1: wp.vec3d, b2: wp.vec3d
) -> bool:
    """Whether the axis, taken as it is, certainly separates two triangles; a0 is the origin."""
    size = absolute(axis)
    pa1 = wp.dot(axis, a1)
    pa2 = wp.dot(axis, a2)
    pb0 = wp.dot(axis, b0)
    pb1 = wp.dot(axis, b1)
    pb2 = wp.dot(axis, b2)
    reach = wp.max(
        wp.max(wp.dot(size, absolute(a1)), wp.dot(size, absolute(a2))),
        wp.max(
            wp.dot(size, absolute(b0)),
            wp.max(wp.dot(size, absolute(b1)), wp.dot(size, absolute(b2))),
        ),
    )
    error = wp.float64(2.0) * (SIGN_BOUND * reach + UNDERFLOW)
    low_a = wp.min(ZERO, wp.min(pa1, pa2))
    high_a = wp.max(ZERO, wp.max(pa1, pa2))
    low_b = wp.min(pb0, wp.min(pb1, pb2))
    high_b = wp.max(pb0, wp.max(pb1, pb2))
    return low_b - high_a > error or low_a - high_b > error


@wp.func
def separated_in_plane(
    normal: wp.vec3d, a1: wp.vec3d, a2: wp.vec3d, b0: wp.vec3d, b1: wp.vec3d, b2: wp.vec3d
) -> bool:
    """Whether a line along an edge certainly separates two nearly coplanar triangles."""
    return (
        separated_along(wp.cross(normal, a1), a1, a2, b0, b1, b2)
        or separated_along(wp.cross(normal, a2), a1, a2, b0, b1, b2)
        or separated_along(wp.cross(normal, a2 - a1), a1, a2, b0, b1, b2)
        or separated_along(wp.cross(normal, b1 - b0), a1, a2, b0, b1, b2)
        or separated_along(wp.cross(normal, b2 - b0), a1, a2, b0, b1, b2)
        or separated_along(wp.cross(normal, b2 - b1), a1, a2, b0, b1, b2)
    )


@wp.func
def edge_side(p: wp.vec3d, q: wp.vec3d, c: wp.vec3d, d: wp.vec3d) -> int:
    """Certain sign of the volume of the tetrahedron over the edges pq and cd, else 0."""
    u = q - p
    v = c - p
    return filtered_sign(wp.cross(u, v), cross_bound(u, v), d - p)


@wp.func
def edge_hits(p: wp.vec3d, q: wp.vec3d, t0: wp.vec3d, t1: wp.vec3d, t2: wp.vec3d) -> int:
    """Whether the line pq, which certainly crosses the plane of the triangle, meets it."""
    s0 = edge_side(p, q, t0, t1)
    s1 = edge_side(p, q, t1, t2)
    if s0 * s1 < 0:
        return APART
    s2 = edge_side(p, q, t2, t0)
    if s0 * s2 < 0 or s1 * s2 < 0:
        return APART
    if s0 != 0 and s0 == s1 and s1 == s2:
        return INTERSECTING
    return UNCERTAIN


@wp.func
def classify(
    a0f: wp.vec3f, a1f: wp.vec3f, a2f: wp.vec3f, b0f: wp.vec3f, b1f: wp.vec3f, b2f: wp.vec3f
) -> int:
    """Whether two closed triangles have a common point: APART, INTERSECTING or UNCERTAIN."""
    a0 = double(a0f)
    a1 = double(a1f) - a0
    a2 = double(a2f) - a0
    b0 = double(b0f) - a0
    b1 = double(b1f) - a0
    b2 = double(b2f) - a0
    normal_a = wp.cross(a1, a2)
    bound_a = cross_bound(a1, a2)
    sb0 = filtered_sign(normal_a, bound_a, b0)
    sb1 = filtered_sign(normal_a, bound_a, b1)
    sb2 = filtered_sign(normal_a, bound_a, b2)
    if sb0 != 0 and sb0 == sb1 and sb1 == sb2:
        return APART
    normal_b = wp.cross(b1 - b0, b2 - b0)
    bound_b = cross_bound(b1 - b0, b2 - b0)
    sa0 = filtered_sign(normal_b, bound_b, -b0)
    sa1 = filtered_sign(normal_b, bound_b, a1 - b0)
    sa2 = filtered_sign(normal_b, bound_b, a2 - b0)
    if sa0 != 0 and sa0 == sa1 and sa1 == sa2:
        return APART
    if sb0 * sb1 * sb2 * sa0 * sa1 * sa2 == 0:
        if separated_in_plane(normal_a, a1, a2, b0, b1, b2):
            return APART
        if separated_in_plane(normal_b, a1, a2, b0, b1, b2):
            return APART
        return UNCERTAIN
    origin = wp.vec3d()
    result = APART
    for edge in range(6):
        p = origin
        q = a1
        crosses = sa0 * sa1 < 0
        if edge == 1:
            p = a1
            q = a2
            crosses = sa1 * sa2 < 0
        if edge == 2:
            p = a2
            q = origin
            crosses = sa2 * sa0 < 0
        if edge == 3:
            p = b0
            q = b1
            crosses = sb0 * sb1 < 0
        if edge == 4:
            p = b1
            q = b2
            crosses = sb1 * sb2 < 0
        if edge == 5:
            p = b2
            q = b0
            crosses = sb2 * sb0 < 0
        if crosses:
            hit = APART
            if edge < 3:
                hit = edge_hits(p, q, b0, b1, b2)
            else:
                hit = edge_hits(p, q, origin, a1, a2)
            if hit == INTERSECTING:
                return INTERSECTING
            result = wp.max(result, hit)
    return result


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
