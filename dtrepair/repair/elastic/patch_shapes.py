"""The shapes of patches that go all round something: those that they have at rest.

The smoothest continuation of what is around a patch is a film: good for a crease, but of what goes
round a finger, a tail or a ribbon it makes a thread. Such patches keep the differential coordinates
of the rest (Lipman et al. 2004), turned and stretched as their rims are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray, lengths, triangle_areas, vector_areas
from dtrepair.numerics.operators import patch_factor
from dtrepair.repair.elastic.arap import ArapSystem
from dtrepair.repair.surface.surface import BoolArray, Surface


@dataclass(frozen=True, kw_only=True)
class PatchShapeOptions:
    """Which patches keep their shapes.

    Args:
        flat: Those whose vector area at rest is below this fraction of their area: a flat one has
            1, half of a tube .64, all of it 0; ...
        shrunk: ... and whose area a film has shrunk below this fraction.
    """

    flat: float = 0.3
    shrunk: float = 0.5


def patch_shapes(
    surface: Surface,
    points: FloatArray,
    film: FloatArray,
    mask: BoolArray,
    *,
    options: PatchShapeOptions = PatchShapeOptions(),
) -> FloatArray | None:
    """Return differential coordinates (V, 3) that patches (V,) of a pose (V, 3) are to have.

    They are 0 but for patches that go round something and are threads in `film` (V, 3), their
    smoothest continuation; None where none is. How these are turned and stretched is taken from the
    second ring around them, whose neighbours no patch replaces, and interpolated between.
    """
    threads = mask & _threads(surface, points, film, mask, options)
    if not threads.any():
        return None
    beside = abs(surface.uniform)
    own = beside @ threads > 0.0
    rim = (beside @ own > 0.0) & ~own & ~(beside @ mask > 0.0)
    if not rim.any():
        return None
    inner, outer = np.flatnonzero(own), np.flatnonzero(rim)
    rotations = ArapSystem(surface, surface.rest, region=rim).rotations(points)[outer]
    known = np.column_stack([rotations.reshape(-1, 9), _stretches(surface, points, rim)[outer]])
    rows = surface.uniform[inner]
    solve = patch_factor(rows[:, inner])
    between = solve(-(rows[:, outer] @ known))
    u, _, v = np.linalg.svd(between[:, :9].reshape(-1, 3, 3))
    u[:, :, 2] *= np.sign(np.linalg.det(u @ v))[:, None]
    result = np.zeros_like(points)
    result[inner] = between[:, 9:] * np.einsum("nij,njk,nk->ni", u, v, rows @ surface.rest)
    return result


def _threads(
    surface: Surface,
    points: FloatArray,
    film: FloatArray,
    mask: BoolArray,
    options: PatchShapeOptions,
) -> BoolArray:
    """Return which vertices (V,) are of patches that go round something, and shrank in a film."""
    label = surface.components(mask)
    corners: IntArray = surface.faces[surface.triangles_at(mask)]
    first = mask[corners].argmax(axis=1)
    patch = label[corners[np.arange(len(corners)), first]]
    areas = vector_areas(surface.rest, corners)
    total = np.bincount(patch, lengths(areas), surface.count)
    summed = [np.bincount(patch, areas[:, k], surface.count) for k in range(3)]
    around = lengths(np.stack(summed, axis=1)) < options.flat * total
    if not around.any():
        return around
    filled = np.bincount(patch, lengths(vector_areas(film, corners)), surface.count)
    # A pose of another size has areas of another one.
    now, rest = (triangle_areas(pose, surface.faces).sum() for pose in (points, surface.rest))
    threads: BoolArray = around & (filled < options.shrunk * total * now / rest)
    return threads[label]


def _stretches(surface: Surface, points: FloatArray, mask: BoolArray) -> FloatArray:
    """Return how much longer the edges at masked vertices (V,) are in a pose than at rest."""
    first, second = surface.edges.T
    edges = surface.edges[mask[first] | mask[second]]
    ends, sums = edges.ravel(), []
    for pose in (points, surface.rest):
        length = lengths(pose[edges[:, 0]] - pose[edges[:, 1]])
        sums.append(np.bincount(ends, np.repeat(length, 2), surface.count))
    return np.asarray(sums[0] / np.maximum(sums[1], 1e-30))
