"""Warp kernels that walk the tree: for triangles closer than a distance, and for rays."""

from __future__ import annotations

from dtrepair.device import start_warp

wp = start_warp()
wp.set_module_options({"enable_backward": False, "fast_math": False})


@wp.func
def double(v: wp.vec3f) -> wp.vec3d:
    """The same vector in float64."""
    return wp.vec3d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))


@wp.func
def unit_clamp(x: wp.float64) -> wp.float64:
    """The nearest number between 0 and 1."""
    return wp.min(wp.max(x, wp.float64(0.0)), wp.float64(1.0))


@wp.func
def segment_distance(p: wp.vec3d, q: wp.vec3d, a: wp.vec3d, b: wp.vec3d) -> wp.float64:
    """Squared distance of the segments pq and ab (Ericson 2005, section 5.1.9)."""
    u = q - p
    v = b - a
    w = p - a
    uu = wp.dot(u, u)
    vv = wp.dot(v, v)
    uv = wp.dot(u, v)
    uw = wp.dot(u, w)
    vw = wp.dot(v, w)
    zero = wp.float64(0.0)
    s = zero
    t = zero
    if uu > zero:
        determinant = uu * vv - uv * uv
        if determinant > zero:
            s = unit_clamp((uv * vw - vv * uw) / determinant)
        if vv > zero:
            t = unit_clamp((uv * s + vw) / vv)
        s = unit_clamp((uv * t - uw) / uu)
    elif vv > zero:
        t = unit_clamp(vw / vv)
    gap = w + s * u - t * v
    return wp.dot(gap, gap)


@wp.func
def above_triangle(p: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> wp.float64:
    """Squared height of a point whose foot lies inside a triangle; otherwise huge."""
    normal = wp.cross(b - a, c - a)
    squared = wp.dot(normal, normal)
    zero = wp.float64(0.0)
    if (
        squared > zero
        and wp.dot(normal, wp.cross(b - a, p - a)) >= zero
        and wp.dot(normal, wp.cross(c - b, p - b)) >= zero
        and wp.dot(normal, wp.cross(a - c, p - c)) >= zero
    ):
        height = wp.dot(normal, p - a)
        return height * height / squared
    return wp.float64(1.0e300)


@wp.func
def triangle_distance(
    a0: wp.vec3d, a1: wp.vec3d, a2: wp.vec3d, b0: wp.vec3d, b1: wp.vec3d, b2: wp.vec3d
) -> wp.float64:
    """Squared distance of two triangles that do not intersect."""
    best = segment_distance(a0, a1, b0, b1)
    best = wp.min(best, segment_distance(a0, a1, b1, b2))
    best = wp.min(best, segment_distance(a0, a1, b2, b0))
    best = wp.min(best, segment_distance(a1, a2, b0, b1))
    best = wp.min(best, segment_distance(a1, a2, b1, b2))
    best = wp.min(best, segment_distance(a1, a2, b2, b0))
    best = wp.min(best, segment_distance(a2, a0, b0, b1))
    best = wp.min(best, segment_distance(a2, a0, b1, b2))
    best = wp.min(best, segment_distance(a2, a0, b2, b0))
    best = wp.min(best, above_triangle(a0, b0, b1, b2))
    best = wp.min(best, above_triangle(a1, b0, b1, b2))
    best = wp.min(best, above_triangle(a2, b0, b1, b2))
    best = wp.min(best, above_triangle(b0, a0, a1, a2))
    best = wp.min(best, above_triangle(b1, a0, a1, a2))
    return wp.min(best, above_triangle(b2, a0, a1, a2))


@wp.func
def box_gap(low_a: wp.vec3f, high_a: wp.vec3f, low_b: wp.vec3f, high_b: wp.vec3f) -> float:
    """Squared distance of two boxes."""
    gap = wp.max(wp.max(low_a - high_b, low_b - high_a), wp.vec3f())
    return wp.dot(gap, gap)


@wp.kernel
def find_close_pairs(
    points: wp.array(dtype=wp.vec3f),
    faces: wp.array(dtype=wp.vec3i),
    order: wp.array(dtype=wp.int32),
    leaf_start: wp.array(dtype=wp.int32),
    skip: wp.array(dtype=wp.int32),
    low: wp.array2d(dtype=wp.vec3f),
    high: wp.array2d(dtype=wp.vec3f),
    node_low: wp.array2d(dtype=wp.vec3f),
    node_high: wp.array2d(dtype=wp.vec3f),
    queries: wp.array(dtype=wp.int32),
    active: wp.array(dtype=wp.uint8),
    distance: wp.float64,
    most: int,
    pairs: wp.array(dtype=wp.vec2i),
    count: wp.array(dtype=wp.int32),
):
    """Pairs without a common vertex closer than `distance`; one thread an active triangle.

    The search ends with more than `most` pairs.
    """
    i = queries[wp.tid()]
    squared = distance * distance
    # Float32 boxes get a margin: the triangles themselves are measured in float64.
    reach = wp.float32(squared) * 1.001
    f = faces[i]
    a0 = double(points[f[0]])
    a1 = double(points[f[1]])
    a2 = double(points[f[2]])
    leaves = leaf_start.shape[0] - 1
    node = int(0)
    while node < skip.shape[0]:
        if box_gap(low[0, i], high[0, i], node_low[0, node], node_high[0, node]) > reach:
            node = skip[node]
            continue
        if node < leaves - 1:
            node = 2 * node + 1
            continue
        if count[0] > most:
            return
        leaf = node - leaves + 1
        for j in range(leaf_start[leaf], leaf_start[leaf + 1]):
            # A pair of two active triangles is found from its first one only.
            if j == i or (j < i and active[j] != wp.uint8(0)):
                continue
            g = faces[j]
            shared = bool(False)
            for m in range(3):
                for n in range(3):
                    if f[m] == g[n]:
                        shared = True
            if shared or box_gap(low[0, i], high[0, i], low[0, j], high[0, j]) > reach:
                continue
            gap = triangle_distance(
                a0, a1, a2, double(points[g[0]]), double(points[g[1]]), double(points[g[2]])
            )
            if gap < squared:
                slot = wp.atomic_add(count, 0, 1)
                if slot < pairs.shape[0]:
                    pairs[slot] = wp.vec2i(wp.min(order[i], order[j]), wp.max(order[i], order[j]))
        node = skip[node]


@wp.func
def ray_crosses(
    origin: wp.vec3d, direction: wp.vec3d, a: wp.vec3f, b: wp.vec3f, c: wp.vec3f
) -> int:
    """1 if a ray leaves through a triangle, -1 if it enters through it, else 0."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    corner = wp.vec3d(wp.float64(a[0]), wp.float64(a[1]), wp.float64(a[2]))
    u = wp.vec3d(wp.float64(b[0]), wp.float64(b[1]), wp.float64(b[2])) - corner
    v = wp.vec3d(wp.float64(c[0]), wp.float64(c[1]), wp.float64(c[2])) - corner
    across = wp.cross(direction, v)
    determinant = wp.dot(u, across)
    if determinant == zero:
        return 0
    offset = origin - corner
    s = wp.dot(offset, across) / determinant
    if s < zero or s > one:
        return 0
    turned = wp.cross(offset, u)
    t = wp.dot(direction, turned) / determinant
    if t < zero or s + t > one:
        return 0
    if not (wp.dot(v, turned) / determinant > zero):
        return 0
    # The determinant is minus the direction times the normal.
    if determinant < zero:
        return 1
    return -1


@wp.kernel
def cast_rays(
    points: wp.array2d(dtype=wp.vec3f),
    faces: wp.array(dtype=wp.vec3i),
    leaf_start: wp.array(dtype=wp.int32),
    skip: wp.array(dtype=wp.int32),
    node_low: wp.array2d(dtype=wp.vec3f),
    node_high: wp.array2d(dtype=wp.vec3f),
    origins: wp.array(dtype=wp.int32),
    directions: wp.array(dtype=wp.vec3d),
    part: wp.array(dtype=wp.int32),
    over: wp.array2d(dtype=wp.uint8),
    crossings: wp.array(dtype=wp.int32),
):
    """Signed crossings of rays that start at vertices: +1 leaving the surface, -1 entering it.

    Triangles that have the vertex are left out, and those of parts that lie over that of the
    vertex: `over` (upper, lower) of the numbers in `part`. One thread a ray.
    """
    ray = wp.tid()
    vertex = origins[ray]
    start = points[0, vertex]
    origin = wp.vec3d(wp.float64(start[0]), wp.float64(start[1]), wp.float64(start[2]))
    direction = directions[ray]
    inverse = wp.vec3f()
    for axis in range(3):
        component = wp.float32(direction[axis])
        if wp.abs(component) < 1.0e-12:
            component = 1.0e-12
        inverse[axis] = 1.0 / component
    leaves = leaf_start.shape[0] - 1
    total = int(0)
    node = int(0)
    while node < skip.shape[0]:
        low = wp.cw_mul(node_low[0, node] - start, inverse)
        high = wp.cw_mul(node_high[0, node] - start, inverse)
        entry = wp.max(wp.min(low, high))
        leave = wp.min(wp.max(low, high))
        # Float32 boxes get a margin: the triangles themselves are tested in float64.
        if leave * 1.0001 < 0.0 or entry * 0.9999 > leave * 1.0001:
            node = skip[node]
            continue
        if node < leaves - 1:
            node = 2 * node + 1
            continue
        leaf = node - leaves + 1
        for i in range(leaf_start[leaf], leaf_start[leaf + 1]):
            f = faces[i]
            if f[0] == vertex or f[1] == vertex or f[2] == vertex:
                continue
            if over[part[f[0]], part[vertex]] != wp.uint8(0):
                continue
            total += ray_crosses(
                origin, direction, points[0, f[0]], points[0, f[1]], points[0, f[2]]
            )
        node = skip[node]
    crossings[ray] = total
