"""Push directions of one frame of an animation: every contact region at its own step length."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.full.push import (
    DEEPEST,
    VOLUME_WEIGHT,
    _volume_gradient,
    tangent_point_gradient,
)
from dtrepair.repair.surface.defects import contact_regions
from dtrepair.repair.surface.layers import covering_sides
from dtrepair.repair.surface.surface import BoolArray, Surface
from dtrepair.repair.surface.winding import winding_numbers

# A region of K pairs moves at most SHARE x mean edge x sqrt(K) a sweep, and at least SMALLEST.
SHARE = 0.5
SMALLEST = 5e-4
# The overlap volume counts in full at this many rings from the nearest crease.
OPEN_RINGS = 6
# A push below this part of the frame's largest is left out, up to twice this it fades in: what is
# far from every contact stays where it is.
FAINT = 0.04


def regional_push(
    surface: Surface,
    points: FloatArray,
    pairs: IntArray,
    pushed: BoolArray,
    *,
    step: float,
) -> FloatArray:
    """Displacement (V, 3) that separates the `pushed` (K,) of the pairs (K, 2) of a pose.

    The sum of the tangent-point direction and of the gradient of the overlap volume, as in `push`;
    but no region moves farther than its share, so that a new small contact starts gently.
    """
    winding = winding_numbers(surface, points, pairs)
    count, regions = contact_regions(surface, pairs, winding != 0)
    far = pairs[pushed]
    of_pair = regions[surface.faces[far[:, 0], 0]]
    sizes = np.bincount(of_pair, minlength=count)
    limits = np.clip(SHARE * surface.edge_length * np.sqrt(sizes), SMALLEST, step)
    gradient = tangent_point_gradient(
        points,
        surface.faces,
        far,
        1.0 / sizes[of_pair],
        direction=surface.face_direction,
        sides=covering_sides(surface, far),
    )
    fields = [gradient]
    buried = _buried(surface, pairs[~pushed], winding)
    buried *= (sizes > 0)[regions]
    if buried.any():
        fields.append(_volume_gradient(surface, points, buried, count, regions))
    smooth = surface.diffuse(np.concatenate(fields, axis=1), points)
    owner = np.flatnonzero(regions >= 0)
    total = np.zeros_like(points)
    for index, weight in zip(range(len(fields)), (1.0, VOLUME_WEIGHT), strict=False):
        largest = _largest(smooth[:, 3 * index : 3 * index + 3], owner, regions, count)
        floor = 1e-3 * largest.max(initial=0.0) + 1e-30
        scale = weight * limits / np.maximum(largest, floor)
        # A triangle across two regions does not exist: its vertices are in one or outside.
        own = np.where(regions >= 0, scale[regions], 0.0)
        total += own[:, None] * fields[index]
    moved = surface.diffuse(total, points) * surface.mobility[:, None]
    largest = _largest(moved, owner, regions, count)
    excess = float((largest / limits)[sizes > 0].max(initial=0.0))
    if not (excess > 0 and np.isfinite(excess)):
        return np.zeros_like(points)
    length = np.linalg.norm(moved, axis=1)
    kept = np.clip(length / (FAINT * length.max()) - 1.0, 0.0, 1.0)
    toward: FloatArray = -kept[:, None] * moved / excess
    return toward


def _buried(surface: Surface, creased: IntArray, winding: IntArray) -> FloatArray:
    """How deep vertices (V,) are, fading towards creases."""
    depth = np.clip(winding, -DEEPEST, DEEPEST).astype(np.float64)
    if len(creased) and depth.any():
        rings = surface.rings_from(surface.vertices_of(creased), OPEN_RINGS + 1)
        depth *= np.minimum(rings / OPEN_RINGS, 1.0)
    return depth


def _largest(
    field: FloatArray, owner: NDArray[np.integer], regions: IntArray, count: int
) -> FloatArray:
    """Largest length (count,) of a field (V, 3) over the vertices of each region."""
    largest = np.zeros(count)
    np.maximum.at(largest, regions[owner], np.linalg.norm(field[owner], axis=1))
    return largest
