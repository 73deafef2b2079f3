"""Warp kernels of contacts: nearest points of two triangles, and what a vertex faces."""

from __future__ import annotations

from dtrepair.device import start_warp
from dtrepair.intersect.kernels import overlap

wp = start_warp()
wp.set_module_options({"enable_backward": False, "fast_math": False})

Real = wp.float64


@wp.struct
class Nearest:
    """Squared distance of the nearest points so far, and their weights on either triangle."""

    squared: wp.float64
    first: wp.vec3d
    second: wp.vec3d


@wp.func
def unit_clamp(x: wp.float64) -> wp.float64:
    """The nearest number between 0 and 1."""
    return wp.min(wp.max(x, Real(0.0)), Real(1.0))


@wp.func
def on_edge(corner: int, part: wp.float64) -> wp.vec3d:
    """Weights of the point at a part of the way from a corner to the next."""
    weights = wp.vec3d()
    weights[corner] = Real(1.0) - part
    weights[(corner + 1) % 3] = part
    return weights


@wp.func
def of_edges(
    best: Nearest, i: int, j: int, p: wp.vec3d, q: wp.vec3d, a: wp.vec3d, b: wp.vec3d
) -> Nearest:
    """Nearest points of the edges pq and ab (Ericson 2005, section 5.1.9)."""
    u = q - p
    v = b - a
    w = p - a
    uu = wp.dot(u, u)
    vv = wp.dot(v, v)
    uv = wp.dot(u, v)
    uw = wp.dot(u, w)
    vw = wp.dot(v, w)
    zero = Real(0.0)
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
    squared = wp.dot(gap, gap)
    if squared < best.squared:
        best.squared = squared
        best.first = on_edge(i, s)
        best.second = on_edge(j, t)
    return best


@wp.func
def of_face(
    best: Nearest, corner: int, swapped: bool, p: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d
) -> Nearest:
    """Nearest points of a corner p and the inside of the triangle abc."""
    normal = wp.cross(b - a, c - a)
    squared = wp.dot(normal, normal)
    zero = Real(0.0)
    if squared > zero:
        weights = wp.vec3d(
            wp.dot(normal, wp.cross(c - b, p - b)),
            wp.dot(normal, wp.cross(a - c, p - c)),
            wp.dot(normal, wp.cross(b - a, p - a)),
        )
        height = wp.dot(normal, p - a)
        distance = height * height / squared
        if wp.min(weights) >= zero and distance < best.squared:
            best.squared = distance
            best.first = on_edge(corner, zero)
            best.second = weights / squared
            if swapped:
                best.first = weights / squared
                best.second = on_edge(corner, zero)
    return best


@wp.kernel
def nearest_points(
    points: wp.array(dtype=wp.vec3d),
    corners: wp.array2d(dtype=wp.int32),
    first: wp.array(dtype=wp.vec3d),
    second: wp.array(dtype=wp.vec3d),
    gaps: wp.array(dtype=wp.vec3d),
):
    """Weights of the nearest points of two triangles (six corners) and the vector between them.

    Triangles may be segments or points: a corner given twice.
    """
    t = wp.tid()
    f = wp.vec3i(corners[t, 0], corners[t, 1], corners[t, 2])
    g = wp.vec3i(corners[t, 3], corners[t, 4], corners[t, 5])
    best = Nearest()
    best.squared = Real(1.0e300)
    for i in range(3):
        for j in range(3):
            k = (i + 1) % 3
            n = (j + 1) % 3
            best = of_edges(best, i, j, points[f[i]], points[f[k]], points[g[j]], points[g[n]])
    for k in range(3):
        best = of_face(best, k, False, points[f[k]], points[g[0]], points[g[1]], points[g[2]])
        best = of_face(best, k, True, points[g[k]], points[f[0]], points[f[1]], points[f[2]])
    first[t] = best.first
    second[t] = best.second
    u = best.first
    v = best.second
    p = u[0] * points[f[0]] + u[1] * points[f[1]] + u[2] * points[f[2]]
    q = v[0] * points[g[0]] + v[1] * points[g[1]] + v[2] * points[g[2]]
    gaps[t] = p - q


@wp.func
def ray_meets(n: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> wp.float64:
    """Distance along n from the origin to the front of the triangle abc; negative: none."""
    u = wp.dot(n, wp.cross(b, c))
    v = wp.dot(n, wp.cross(c, a))
    w = wp.dot(n, wp.cross(a, b))
    total = u + v + w
    if wp.max(wp.max(u, v), w) <= Real(0.0) and total < Real(0.0):
        return wp.dot(a, wp.cross(b, c)) / total
    return Real(-1.0)


@wp.kernel
def front_areas(
    points: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.vec3i),
    order: wp.array(dtype=wp.int32),
    areas: wp.array(dtype=wp.vec3d),
):
    """Twice the vector areas of the triangles, in leaf order."""
    t = wp.tid()
    f = faces[order[t]]
    areas[t] = wp.cross(points[f[1]] - points[f[0]], points[f[2]] - points[f[0]])


@wp.kernel
def faced_triangles(
    points: wp.array(dtype=wp.vec3d),
    normals: wp.array(dtype=wp.vec3d),
    queries: wp.array(dtype=wp.int32),
    faces: wp.array(dtype=wp.vec3i),
    areas: wp.array(dtype=wp.vec3d),
    order: wp.array(dtype=wp.int32),
    leaf_start: wp.array(dtype=wp.int32),
    skip: wp.array(dtype=wp.int32),
    low: wp.array2d(dtype=wp.vec3f),
    high: wp.array2d(dtype=wp.vec3f),
    scale: wp.float64,
    radius: wp.float64,
    found: wp.array(dtype=wp.int32),
):
    """First triangle that the ray along each vertex normal meets from its front, or -1.

    Rays end after a radius; `areas` are those of `front_areas`.
    """
    t = wp.tid()
    v = queries[t]
    p = points[v]
    n = normals[v]
    best = radius
    winner = int(-1)
    # Boxes are those of the written coordinates: `scale` times the points, in float32. The ray is
    # short: its own box tells as much as where it enters another, for less.
    start = wp.vec3f(scale * p)
    end = wp.vec3f(scale * (p + radius * n))
    own_low = wp.min(start, end)
    own_high = wp.max(start, end)
    leaves = leaf_start.shape[0] - 1
    node = int(0)
    while node < skip.shape[0]:
        if not overlap(own_low, own_high, low[0, node], high[0, node]):
            node = skip[node]
            continue
        if node < leaves - 1:
            node = 2 * node + 1
            continue
        leaf = node - leaves + 1
        for j in range(leaf_start[leaf], leaf_start[leaf + 1]):
            # Most triangles nearby are neighbours that face the same way.
            if wp.dot(n, areas[j]) < Real(0.0):
                f = faces[order[j]]
                if f[0] != v and f[1] != v and f[2] != v:
                    distance = ray_meets(n, points[f[0]] - p, points[f[1]] - p, points[f[2]] - p)
                    if distance > Real(0.0) and distance < best:
                        best = distance
                        winner = order[j]
        node = skip[node]
    found[t] = winner
