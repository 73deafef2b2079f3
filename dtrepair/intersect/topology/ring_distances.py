"""How many edge rings lie between triangles of a mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtrepair.device import start_warp
from dtrepair.intersect.topology.device_mesh import DeviceMesh
from dtrepair.numerics.geometry import IntArray, pair_keys

# Words of 64 bits that a search at once may keep of the vertices: 128 MiB, twice.
WORDS = 1 << 24
# Rings up to which distances are known, unless more are asked for.
MOST_RINGS = 20


class RingDistances:
    """Tells how many edge rings lie between triangles of one mesh, as `pairs -> rings`.

    Threads may share one: what is remembered is replaced as a whole, never changed, so that at
    worst they find the same answer twice.

    Args:
        mesh: The triangles, on the device that searches.
        limit: Rings up to which distances are known; what is farther counts as one ring more. A
            search grows with the square of it.
    """

    def __init__(self, mesh: DeviceMesh, *, limit: int = MOST_RINGS) -> None:
        self._mesh, self.limit = mesh, limit
        self._search = rings_in_turn if mesh.device.serial else rings_at_once
        self._known = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int32)

    def __call__(self, pairs: IntArray) -> IntArray:
        """Return the edge rings (K,) between triangles of pairs (K, 2), at most `limit` + 1."""
        wanted = pair_keys(pairs)
        keys, rings = self._known
        place = np.searchsorted(keys, wanted)
        new = place == len(keys)
        new[~new] = keys[place[~new]] != wanted[~new]
        if new.any():
            unknown = np.sort(wanted[new])
            unknown = unknown[np.diff(unknown, prepend=-1) > 0]
            rows = np.stack([unknown >> 32, unknown & 0xFFFFFFFF], axis=1).astype(np.int32)
            every = np.concatenate([keys, unknown])
            found = np.concatenate([rings, self._search(self._mesh, rows, self.limit)])
            order = np.argsort(every)
            self._known = keys, rings = every[order], found[order]
            place = np.searchsorted(keys, wanted)
        answer: IntArray = rings[place]
        return answer


def rings_in_turn(mesh: DeviceMesh, pairs: IntArray, limit: int) -> IntArray:
    """Return the ring distances (K,) of sorted pairs (K, 2), at most `limit` + 1: one thread.

    Searches from both sides that end where they meet: the least work, for a device that has one
    thread; see `rings_at_once`.
    """
    from dtrepair.intersect.topology.topology_kernels import ring_distances

    warp, device, count = start_warp(), mesh.device, mesh.vertex_count
    distance = device.empty(len(pairs), warp.int32)
    scratch = [device.zeros((2, count), warp.int32) for _ in range(2)]
    queue = device.empty(count, warp.int32)
    half = limit // 2
    inputs = [mesh.faces, *mesh.neighbours, device.array(pairs, warp.vec2i)]
    inputs += [half, limit - half, *scratch, queue, distance]
    device.launch(ring_distances, 1, inputs)
    found: IntArray = distance.numpy()
    return found


def rings_at_once(mesh: DeviceMesh, pairs: IntArray, limit: int, *, words: int = WORDS) -> IntArray:
    """Return the same by frontiers that all grow at once: a bit a triangle, a word a thread.

    Each ring is one launch over the vertices of the mesh, for 64 first triangles a word (Then et
    al. 2014, MS-BFS). words: how many to keep at a time, at least one a vertex.
    """
    result = np.full(len(pairs), limit + 1, dtype=np.int32)
    # Distances are the same from either side: few triangles meet many.
    sides = [np.unique(pairs[:, side], return_inverse=True) for side in (0, 1)]
    side = int(len(sides[1][0]) < len(sides[0][0]))
    sources, source = sides[side]
    others = pairs[:, 1 - side]
    many = 64 * max(1, words // max(1, mesh.vertex_count))
    for first in range(0, len(sources), many):
        own = np.flatnonzero((source >= first) & (source < first + many))
        rows = np.stack([source[own] - first, others[own]], axis=1).astype(np.int32)
        result[own] = _rings_from(mesh, sources[first : first + many], rows, limit)
    return result


def _rings_from(
    mesh: DeviceMesh, sources: NDArray[np.integer], rows: IntArray, limit: int
) -> IntArray:
    """Return the rings (K,) of rows (K, 2), the number of a source (S,) and a triangle."""
    from dtrepair.intersect.topology import topology_kernels as kernels

    warp, device = start_warp(), mesh.device
    shape = (-(-len(sources) // 64), mesh.vertex_count)
    reached, grown = device.zeros(shape, warp.uint64), device.empty(shape, warp.uint64)
    numbers = device.array(sources.astype(np.int32), warp.int32)
    device.launch(kernels.mark_sources, len(sources), [mesh.faces, numbers, reached])
    pairs = device.array(rows, warp.vec2i)
    distance = device.array(np.full(len(rows), limit + 1, dtype=np.int32), warp.int32)
    for ring in range(limit + 1):
        if ring:
            device.launch(kernels.grow_frontiers, shape, [*mesh.neighbours, reached, grown])
            reached, grown = grown, reached
        inputs = [mesh.faces, pairs, reached, ring, distance]
        device.launch(kernels.read_frontiers, len(rows), inputs)
    found: IntArray = distance.numpy()
    return found
