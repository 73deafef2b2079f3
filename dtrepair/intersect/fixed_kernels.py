"""Warp kernels of detection into buffers of fixed size, without a word from the host."""

from __future__ import annotations

from dtrepair.device import start_warp
from dtrepair.intersect.kernels import classified
from dtrepair.intersect.predicates import APART, INTERSECTING

wp = start_warp()
wp.set_module_options({"enable_backward": False, "fast_math": False})


@wp.func
def is_listed(
    listed: wp.array(dtype=wp.int64), first: wp.int32, second: wp.int32, triangles: wp.int32
) -> bool:
    """Whether a sorted list of numbers first * triangles + second holds a pair."""
    wanted = wp.int64(first) * wp.int64(triangles) + wp.int64(second)
    low = int(0)
    high = listed.shape[0]
    while low < high:
        middle = (low + high) / 2
        if listed[middle] < wanted:
            low = middle + 1
        else:
            high = middle
    return low < listed.shape[0] and listed[low] == wanted


@wp.kernel
def keep_intersecting(
    candidates: wp.array(dtype=wp.vec3i),
    candidate_count: wp.array(dtype=wp.int32),
    points: wp.array2d(dtype=wp.vec3f),
    faces: wp.array(dtype=wp.vec3i),
    order: wp.array(dtype=wp.int32),
    group: wp.array(dtype=wp.int32),
    counted: wp.array2d(dtype=wp.uint8),
    listed: wp.array(dtype=wp.int64),
    doubts: wp.array(dtype=wp.vec3i),
    doubt_count: wp.array(dtype=wp.int32),
    pairs: wp.array(dtype=wp.vec3i),
    count: wp.array(dtype=wp.int32),
):
    """Pairs (frame, smaller, larger) of the candidates that intersect and are counted.

    A pair counts if `counted` says so for the groups of its triangles and it is not `listed`. What
    floating point leaves open is copied to `doubts`, as a candidate.
    """
    slot = wp.tid()
    if slot >= candidate_count[0]:
        return
    candidate = candidates[slot]
    frame = candidate[0]
    i = candidate[1]
    j = candidate[2]
    t = wp.min(order[i], order[j])
    u = wp.max(order[i], order[j])
    if counted[group[t], group[u]] == wp.uint8(0):
        return
    found = classified(points, frame, faces[i], faces[j])
    if found == APART or is_listed(listed, t, u, order.shape[0]):
        return
    if found != INTERSECTING:
        doubt = wp.atomic_add(doubt_count, 0, 1)
        if doubt < doubts.shape[0]:
            doubts[doubt] = candidate
        return
    place = wp.atomic_add(count, 0, 1)
    if place < pairs.shape[0]:
        pairs[place] = wp.vec3i(frame, t, u)


@wp.kernel
def add_settled(
    doubts: wp.array(dtype=wp.vec3i),
    doubt_count: wp.array(dtype=wp.int32),
    meet: wp.array(dtype=wp.bool),
    order: wp.array(dtype=wp.int32),
    pairs: wp.array(dtype=wp.vec3i),
    count: wp.array(dtype=wp.int32),
):
    """Adds those candidates to the pairs that were in doubt and turned out to meet."""
    slot = wp.tid()
    if slot < wp.min(doubt_count[0], doubts.shape[0]) and meet[slot]:
        doubt = doubts[slot]
        t = order[doubt[1]]
        u = order[doubt[2]]
        place = wp.atomic_add(count, 0, 1)
        if place < pairs.shape[0]:
            pairs[place] = wp.vec3i(doubt[0], wp.min(t, u), wp.max(t, u))


@wp.kernel
def mark_triangles(
    pairs: wp.array(dtype=wp.vec3i),
    count: wp.array(dtype=wp.int32),
    marks: wp.array2d(dtype=wp.int32),
):
    """Set the marks (B, F) of the triangles of all pairs; those are few, so no sums are needed."""
    slot = wp.tid()
    if slot < count[0]:
        pair = pairs[slot]
        marks[pair[0], pair[1]] = 1
        marks[pair[0], pair[2]] = 1
