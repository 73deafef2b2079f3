"""Push directions of one frame of an animation: every contact region at its own step length."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.full.directions import (
    DirectionOptions,
    tangent_point_gradient,
    volume_gradient,
    without_beside,
)
from dtrepair.repair.surface.defects import contact_regions
from dtrepair.repair.surface.surface import BoolArray, Surface
from dtrepair.repair.surface.winding import winding_numbers


@dataclass(frozen=True, kw_only=True)
class RegionalPushOptions:
    """Numbers of the push of one frame of a clip.

    Args:
        share: A region of K pairs moves at most share x mean edge length x sqrt(K) in a sweep: a
            new small contact starts gently, so that frames agree.
        least: A region may move so far at least, units of the size, or fine meshes take too long.
        open_rings: The overlap volume counts in full so many rings from the nearest crease.
        faint: Pushes below this fraction of the frame's largest are left out, up to twice this they
            fade in: what is far from every contact stays where it is.
        direction: Numbers of the directions.
    """

    share: float = 0.5
    least: float = 5e-4
    open_rings: int = 6
    faint: float = 0.04
    direction: DirectionOptions = field(default_factory=DirectionOptions)


def regional_push(
    surface: Surface,
    points: FloatArray,
    pairs: IntArray,
    pushed: BoolArray,
    *,
    step: float,
    options: RegionalPushOptions = RegionalPushOptions(),
) -> FloatArray:
    """Return the displacement (V, 3) that separates the `pushed` (K,) of pairs (K, 2) of a pose.

    The sum of the tangent-point direction and of the gradient of the overlap volume, as in `push`;
    but no region moves farther than its share, nor than `step` (units of the size).
    """
    winding = winding_numbers(surface, points, pairs)
    count, regions = contact_regions(surface, pairs, winding != 0)
    far = pairs[pushed]
    of_pair = regions[surface.faces[far[:, 0], 0]]
    sizes = np.bincount(of_pair, minlength=count)
    limits = np.clip(options.share * surface.edge_length * np.sqrt(sizes), options.least, step)
    sides = surface.covering_sides(far)
    gradient = tangent_point_gradient(
        points,
        surface.faces,
        far,
        1.0 / sizes[of_pair],
        direction=surface.face_direction,
        sides=sides,
    )
    fields = [gradient]
    buried = _buried(surface, pairs[~pushed], winding, options)
    buried *= (sizes > 0)[regions]
    if sides is not None:
        buried = without_beside(surface, buried, regions, far, sides)
    if buried.any():
        fields.append(volume_gradient(surface, points, buried, count, regions))
    smooth = surface.diffuse(np.concatenate(fields, axis=1), points)
    owner = np.flatnonzero(regions >= 0)
    total = np.zeros_like(points)
    weights = (1.0, options.direction.volume_weight)
    for index, weight in zip(range(len(fields)), weights, strict=False):
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
    kept = np.clip(length / (options.faint * length.max()) - 1.0, 0.0, 1.0)
    displacement: FloatArray = -kept[:, None] * moved / excess
    return displacement


def _buried(
    surface: Surface, creased: IntArray, winding: IntArray, options: RegionalPushOptions
) -> FloatArray:
    """Return how deep vertices (V,) are, fading towards creases."""
    deepest = options.direction.deepest
    depth = np.clip(winding, -deepest, deepest).astype(np.float64)
    if len(creased) and depth.any():
        rings = surface.rings_from(surface.vertices_of(creased), options.open_rings + 1)
        depth *= np.minimum(rings / options.open_rings, 1.0)
    return depth


def _largest(
    field: FloatArray, owner: NDArray[np.integer], regions: IntArray, count: int
) -> FloatArray:
    """Return the largest length (count,) of a field (V, 3) over the vertices of each region."""
    largest = np.zeros(count)
    np.maximum.at(largest, regions[owner], np.linalg.norm(field[owner], axis=1))
    return largest
