"""Warp kernels for queries on a mesh: folds, areas, ring distances, links."""

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


@wp.func
def flood(
    f: wp.vec3i,
    indptr: wp.array(dtype=wp.int32),
    indices: wp.array(dtype=wp.int32),
    rings_at_most: int,
    tag: int,
    stamp: wp.array2d(dtype=wp.int32),
    rings: wp.array2d(dtype=wp.int32),
    queue: wp.array(dtype=wp.int32),
):
    """Rings of the vertices around a triangle, in the first rows; stamps them with `tag`."""
    tail = int(0)
    for corner in range(3):
        v = f[corner]
        stamp[0, v] = tag
        rings[0, v] = 0
        queue[tail] = v
        tail += 1
    head = int(0)
    while head < tail:
        v = queue[head]
        head += 1
        if rings[0, v] < rings_at_most:
            for k in range(indptr[v], indptr[v + 1]):
                w = indices[k]
                if stamp[0, w] != tag:
                    stamp[0, w] = tag
                    rings[0, w] = rings[0, v] + 1
                    queue[tail] = w
                    tail += 1


@wp.kernel
def ring_distances(
    faces: wp.array(dtype=wp.vec3i),
    indptr: wp.array(dtype=wp.int32),
    indices: wp.array(dtype=wp.int32),
    pairs: wp.array(dtype=wp.vec2i),
    near_half: int,
    far_half: int,
    stamp: wp.array2d(dtype=wp.int32),
    rings: wp.array2d(dtype=wp.int32),
    queue: wp.array(dtype=wp.int32),
    distance: wp.array(dtype=wp.int32),
):
    """Edge rings between the triangles of each pair, capped at near_half + far_half + 1.

    Two breadth-first searches that meet; the first is kept for a run of pairs with the same first
    triangle, so pairs come sorted. One thread does all: the searches share their scratch arrays.
    """
    last = int(-1)
    tag = int(0)
    for p in range(pairs.shape[0]):
        first = pairs[p][0]
        if first != last:
            last = first
            tag = p + 1
            flood(faces[first], indptr, indices, near_half, tag, stamp, rings, queue)
        best = near_half + far_half + 1
        tail = int(0)
        g = faces[pairs[p][1]]
        for corner in range(3):
            v = g[corner]
            stamp[1, v] = p + 1
            rings[1, v] = 0
            queue[tail] = v
            tail += 1
            if stamp[0, v] == tag:
                best = wp.min(best, rings[0, v])
        head = int(0)
        while head < tail:
            v = queue[head]
            head += 1
            reach = rings[1, v] + 1
            if reach <= far_half and reach < best:
                for k in range(indptr[v], indptr[v + 1]):
                    w = indices[k]
                    if stamp[1, w] != p + 1:
                        stamp[1, w] = p + 1
                        rings[1, w] = reach
                        queue[tail] = w
                        tail += 1
                        if stamp[0, w] == tag:
                            best = wp.min(best, reach + rings[0, w])
        distance[p] = best


@wp.kernel
def link_roots(links: wp.array(dtype=wp.vec2i), root: wp.array(dtype=wp.int32)):
    """The least item that each item is linked to, from each item itself; one thread does all."""
    for k in range(links.shape[0]):
        i = links[k][0]
        j = links[k][1]
        while root[i] != i:
            root[i] = root[root[i]]
            i = root[i]
        while root[j] != j:
            root[j] = root[root[j]]
            j = root[j]
        root[wp.max(i, j)] = wp.min(i, j)
    # A root comes before what hangs on it.
    for item in range(root.shape[0]):
        root[item] = root[root[item]]
