"""Warp kernels on the graph of a mesh: edge rings between triangles, connected components.

The rings come twice: in one thread, which does least work, and in as many as there are items.
"""

from __future__ import annotations

from dtrepair.device import start_warp

wp = start_warp()
wp.set_module_options({"enable_backward": False, "fast_math": False})


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


@wp.func
def root_of(root: wp.array(dtype=wp.int32), item: int) -> int:
    """The end of the chain from an item, which is shortened on the way.

    Chains only ever lead down, and what hangs on an item goes on doing so: what another thread
    writes meanwhile shortens them too.
    """
    i = item
    while root[i] != i:
        root[i] = root[root[i]]
        i = root[i]
    return i


@wp.kernel
def hook_roots(links: wp.array(dtype=wp.vec2i), root: wp.array(dtype=wp.int32)):
    """Hangs the greater root of each link on the lesser one; one thread a link.

    Where another thread was faster, the search goes on from what it found there.
    """
    k = wp.tid()
    i = root_of(root, links[k][0])
    j = root_of(root, links[k][1])
    while i != j:
        high = wp.max(i, j)
        low = wp.min(i, j)
        found = wp.atomic_cas(root, high, high, low)
        if found == high:
            i = low
            j = low
        else:
            i = root_of(root, found)
            j = root_of(root, low)


@wp.kernel
def flatten_roots(root: wp.array(dtype=wp.int32)):
    """Replaces what each item hangs on by the root; one thread an item."""
    item = wp.tid()
    root[item] = root_of(root, root[item])


@wp.kernel
def mark_sources(
    faces: wp.array(dtype=wp.vec3i),
    sources: wp.array(dtype=wp.int32),
    reached: wp.array2d(dtype=wp.uint64),
):
    """Sets bit s of the corners of source s, 64 sources a row of words; one thread a source."""
    s = wp.tid()
    f = faces[sources[s]]
    bit = wp.lshift(wp.uint64(1), wp.uint64(s % 64))
    for corner in range(3):
        wp.atomic_or(reached, s / 64, f[corner], bit)


@wp.kernel
def grow_frontiers(
    indptr: wp.array(dtype=wp.int32),
    indices: wp.array(dtype=wp.int32),
    reached: wp.array2d(dtype=wp.uint64),
    grown: wp.array2d(dtype=wp.uint64),
):
    """Grows what each source has reached by one ring of edges; one thread a word of a vertex."""
    row, v = wp.tid()
    word = reached[row, v]
    for k in range(indptr[v], indptr[v + 1]):
        word = word | reached[row, indices[k]]
    grown[row, v] = word


@wp.kernel
def read_frontiers(
    faces: wp.array(dtype=wp.vec3i),
    pairs: wp.array(dtype=wp.vec2i),
    reached: wp.array2d(dtype=wp.uint64),
    ring: int,
    distance: wp.array(dtype=wp.int32),
):
    """Lowers the distance of pairs (source, triangle) that have met by now; one thread a pair."""
    p = wp.tid()
    if distance[p] <= ring:
        return
    s = pairs[p][0]
    f = faces[pairs[p][1]]
    word = reached[s / 64, f[0]] | reached[s / 64, f[1]] | reached[s / 64, f[2]]
    if (wp.rshift(word, wp.uint64(s % 64)) & wp.uint64(1)) != wp.uint64(0):
        distance[p] = ring
