"""Parts of one mesh that overlap, and touch besides: they are not one for that."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dtrepair.numerics.geometry import IntArray, border_edges, components, pair_keys


def without_touches(faces: IntArray, weld: IntArray, pairs_of: Callable[[], IntArray]) -> IntArray:
    """Return the vertex (V,) that stands for each; parts that overlap stay two where they touch.

    The legs of mirrored shorts overlap, and their hems may meet in a point; fingers overlap, and
    meet along a line. What touches and does not overlap stays joined there.

    Args:
        faces: Triangles (F, 3).
        weld: The vertex (V,) that stands for each of those at its position.
        pairs_of: Returns the pairs (K, 2) of triangles that intersect; not asked without touches.
    """
    part = _joined_by_edges(faces, weld)
    used = np.zeros(len(weld), dtype=bool)
    used[faces] = True
    touching = np.unique(weld[used & (part != part[weld])])
    if len(touching) == 0:
        return weld
    sides = np.sort(part[faces[pairs_of(), 0]].reshape(-1, 2), axis=1)
    overlaps: dict[int, list[int]] = {}
    for one, other in np.unique(sides[sides[:, 0] != sides[:, 1]], axis=0).tolist():
        overlaps.setdefault(one, []).append(other)
    result, order = weld.copy(), np.argsort(weld, kind="stable")
    ends = np.searchsorted(weld[order], [touching, touching + 1])
    for start, end in ends.T.tolist():
        own = order[start:end]
        first = {number: vertex for vertex, number in zip(own[::-1], part[own[::-1]], strict=True)}
        if any(other in first for one in first for other in overlaps.get(one, ())):
            result[own] = [first[number] for number in part[own]]
    return result


def _joined_by_edges(faces: IntArray, weld: IntArray) -> IntArray:
    """Return the part (V,) of each vertex: triangles are one by their vertices, and along seams.

    A seam is where edges of borders lie on each other; what lies on a whole skin only touches it.
    """
    edges = faces.ravel()[border_edges(faces, len(weld))]
    turned = weld[edges[:, 0]] > weld[edges[:, 1]]
    edges = np.where(turned[:, None], edges[:, ::-1], edges)
    edges = edges[np.argsort(pair_keys(weld[edges]), kind="stable")]
    keys = pair_keys(weld[edges])
    same = np.flatnonzero(keys[1:] == keys[:-1])
    ends = np.stack([edges[same], edges[same + 1]], axis=2).reshape(-1, 2)
    linked = np.concatenate([ends[:, [0, 1, 1]], faces]).astype(np.int32)
    return components(linked, len(weld))
