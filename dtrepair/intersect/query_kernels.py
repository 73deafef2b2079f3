"""Warp kernels for queries on a mesh: folds and areas."""

from __future__ import annotations

from dtrepair.device import start_warp

wp = start_warp()
wp.set_module_options({"enable_backward": False, "fast_math": False})


@wp.func
def point(points: wp.array(dtype=wp.vec3f), k: int) -> wp.vec3d:
    """Point k in float64."""
    p = points[k]
    return wp.vec3d(wp.float64(p[0]), wp.float64(p[1]), wp.float64(p[2]))


@wp.func
def segment_meets(p: wp.vec3d, q: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> bool:
    """Whether a segment crosses the plane of a triangle inside the closed triangle (float64)."""
    normal = wp.cross(b - a, c - a)
    s = wp.dot(normal, p - a)
    t = wp.dot(normal, q - a)
    zero = wp.float64(0.0)
    if (s > zero) == (t > zero):
        return False
    hit = p + (s / (s - t)) * (q - p)
    return (
        wp.dot(normal, wp.cross(b - a, hit - a)) >= zero
        and wp.dot(normal, wp.cross(c - b, hit - b)) >= zero
        and wp.dot(normal, wp.cross(a - c, hit - c)) >= zero
    )


@wp.kernel
def find_bent(
    points: wp.array(dtype=wp.vec3f),
    indptr: wp.array(dtype=wp.int32),
    ring: wp.array(dtype=wp.vec2i),
    closed: wp.array(dtype=wp.uint8),
    active: wp.array(dtype=wp.uint8),
    bent: wp.array(dtype=wp.uint8),
):
    """Marks the active vertices around which triangles could fold; one thread a vertex.

    Where every triangle of a closed ring faces within 80 degrees of their mean normal, and goes
    around it once, they lie over a plane side by side and cannot fold. It goes around more often
    if another triangle lies over the first edge; seen along the normal, that edge has the start of
    such a triangle to its right and the end to its left.
    """
    v = wp.tid()
    bent[v] = wp.uint8(0)
    first = indptr[v]
    last = indptr[v + 1]
    if active[v] == wp.uint8(0) or first == last:
        return
    mean = wp.vec3f()
    longest = float(0.0)
    for k in range(first, last):
        u = points[ring[k][0]] - points[v]
        mean += wp.cross(u, points[ring[k][1]] - points[v])
        longest = wp.max(longest, wp.dot(u, u))
    folded = closed[v] == wp.uint8(0)
    if not folded:
        start = ring[first][0]
        right = wp.cross(points[start] - points[v], mean)
        margin = 1.0e-5 * wp.sqrt(wp.dot(right, right) * longest)
        least = 0.03 * wp.dot(mean, mean)
        for k in range(first, last):
            u = points[ring[k][0]] - points[v]
            w = points[ring[k][1]] - points[v]
            normal = wp.cross(u, w)
            facing = wp.dot(normal, mean)
            if not (facing > 0.0 and facing * facing > least * wp.dot(normal, normal)):
                folded = True
            if k > first and ring[k][1] != start:
                if wp.dot(u, right) > -margin and wp.dot(w, right) < margin:
                    folded = True
    if folded:
        bent[v] = wp.uint8(1)


@wp.kernel
def vertex_areas(
    points: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.vec3i),
    indptr: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=wp.int32),
    areas: wp.array(dtype=wp.vec3d),
):
    """Vector area of each vertex, a third of that of its triangles; one thread a vertex."""
    v = wp.tid()
    total = wp.vec3d()
    for k in range(indptr[v], indptr[v + 1]):
        f = faces[corners[k] / 3]
        total += wp.cross(points[f[1]] - points[f[0]], points[f[2]] - points[f[0]])
    areas[v] = total / wp.float64(6.0)


@wp.kernel
def find_folds(
    points: wp.array(dtype=wp.vec3f),
    faces: wp.array(dtype=wp.vec3i),
    fans: wp.array(dtype=wp.vec4i),
    rows: wp.array(dtype=wp.int32),
    folded: wp.array(dtype=wp.uint8),
):
    """Marks those of some rows (triangle, corner, triangle, corner) of `fans` that fold.

    Two triangles that share exactly one vertex fold if the edge opposite it of one crosses the
    other; one thread a row.
    """
    row = wp.tid()
    folded[row] = wp.uint8(0)
    fan = fans[rows[row]]
    f = faces[fan[0]]
    g = faces[fan[2]]
    a = point(points, f[fan[1]])
    b = point(points, f[(fan[1] + 1) % 3])
    c = point(points, f[(fan[1] + 2) % 3])
    d = point(points, g[(fan[3] + 1) % 3])
    e = point(points, g[(fan[3] + 2) % 3])
    if segment_meets(b, c, a, d, e) or segment_meets(d, e, a, b, c):
        folded[row] = wp.uint8(1)
