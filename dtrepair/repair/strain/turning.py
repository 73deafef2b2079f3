"""Triangles that turned over against the rotation of what is around them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray, dots, lengths, vector_areas
from dtrepair.repair.strain.parts import ConnectedParts

Places = NDArray[np.integer]
# Rings around a patch that tell how its surroundings turned: the first may be drawn in with it.
SURROUNDINGS = 3


def turned_patches(
    parts: ConnectedParts,
    before: FloatArray,
    after: FloatArray,
    old: FloatArray,
    new: FloatArray,
    bounds: FloatArray,
    *,
    few: int,
    rest: FloatArray | None = None,
    crossed: IntArray | None = None,
    rolls: float = 1.0,
) -> list[Places]:
    """Return the patches of triangles (N,) that turned over, and are beyond what parts may have.

    before, after: poses (V, 3); old, new: vector areas (F, 3); bounds: area that a patch of each
    part (P,) may have; few: so many triangles are a crease; rest: the pose (V, 3) of the model;
    crossed: its triangles (N,) that meet their own part, where it does not tell how they lie;
    rolls: patches of a larger share of their part may have rolled as wholes: no rest tells of them.
    """
    had, has = lengths(old), lengths(new)
    area = np.minimum(had, has)
    # Only what turned by 60 degrees can have turned over against its surroundings.
    turned: Places = np.flatnonzero(dots(old, new) < 0.5 * had * has)
    over = [
        own[facing(parts.faces[own], parts.edges, before, after, old[own], new[own]) < 0.0]
        for own in _patches(parts, turned, area, bounds, few)
    ]
    turned = np.concatenate([turned[:0], *over])
    found = _patches(parts, turned, area, bounds, few)

    whole = np.bincount(parts.of_face, had, parts.count)

    def off_the_model(own: Places) -> bool:
        """Return whether a small patch faces away from where the model does, more than it did."""
        if rest is None or np.isin(own, () if crossed is None else crossed).any():
            return False
        if had[own].sum() > rolls * whole[parts.of_face[own[0]]]:
            return False
        triangles, model = parts.faces[own], vector_areas(rest, parts.faces[own])
        was, became = (
            facing(triangles, parts.edges, rest, pose, model, areas[own]).sum()
            / max(lengths(areas[own]).sum(), 1e-300)
            for pose, areas in ((before, old), (after, new))
        )
        return bool(became < min(was, 0.0))

    # What lay folded over in the input, and does so no longer, is no fault; but a mouth that is
    # turned inside out is smoother than it was, too.
    return [own for own in found if folded_more(parts.rim(own), old, new) or off_the_model(own)]


def _patches(
    parts: ConnectedParts, chosen: Places, area: FloatArray, bounds: FloatArray, few: int
) -> list[Places]:
    """Return the patches of some triangles (N,) that are beyond the bounds of their parts (P,)."""
    part = parts.of_face[chosen]
    if not (np.bincount(part, area[chosen], parts.count) > bounds).any():
        return []
    label = parts.patches(chosen)
    sums, counts = np.bincount(label, area[chosen]), np.bincount(label)
    large = (sums[label] > bounds[part]) & (counts[label] > few)
    return [chosen[label == index] for index in np.unique(label[large])]


def facing(
    triangles: IntArray,
    edges: IntArray,
    before: FloatArray,
    after: FloatArray,
    old: FloatArray,
    new: FloatArray,
    *,
    rings: int = SURROUNDINGS,
) -> FloatArray:
    """Return the cosines (N,) to where triangles (N, 3) of a patch should face, times their areas.

    Where a triangle should face is its vector area `old` (N, 3) turned by the rotation that leads
    the edges around the patch best from the pose `before` (V, 3) to `after`; `new` (N, 3): where
    it does. A patch without surroundings is compared with its own rotation.
    """
    inner, (first, second) = np.zeros(len(before), dtype=bool), edges.T
    inner[triangles] = True
    near = inner.copy()
    for _ in range(rings):
        near[edges[near.take(first) | near.take(second)]] = True
    own = edges[near.take(first) & near.take(second)]
    around = own[~(inner[own[:, 0]] & inner[own[:, 1]])]
    rotation = best_rotation(before, after, around if len(around) else own)
    return np.asarray(dots(old @ rotation.T, new) / np.maximum(lengths(old), 1e-300))


def folded_more(rim: IntArray, old: FloatArray, new: FloatArray) -> bool:
    """Return whether a patch is folded more against what is around it than it was.

    rim: pairs (H, 2) of triangles, one of the patch, that share an edge; old, new: vector areas
    (F, 3). A patch without a rim has nothing to be compared with: it is.
    """
    if not len(rim):
        return True
    was, became = (
        dots(areas[rim[:, 0]], areas[rim[:, 1]])
        / np.maximum(lengths(areas[rim[:, 0]]) * lengths(areas[rim[:, 1]]), 1e-300)
        for areas in (old, new)
    )
    return bool(became.mean() < was.mean())


def best_rotation(before: FloatArray, after: FloatArray, edges: IntArray) -> FloatArray:
    """Return the rotation (3, 3) that leads edges best from one pose (V, 3) to another.

    The least sum of squares (Kabsch 1976).
    """
    was, became = (points[edges[:, 1]] - points[edges[:, 0]] for points in (before, after))
    left, _, right = np.linalg.svd(became.T @ was)
    left[:, 2] *= np.sign(np.linalg.det(left @ right))
    rotation: FloatArray = left @ right
    return rotation
