"""How thick a shape is where it is thin: what a clearance should be small against."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    components,
    cross,
    dots,
    lengths,
    vector_areas,
)


@dataclass(frozen=True, kw_only=True)
class ThicknessOptions:
    """Numbers of the measure of thickness.

    Args:
        rays: Most rays of a mesh, some for each of the parts that count.
        share: This share of the area of a part may be thinner: rims and lids are.
        facing: Least cosine between a ray and the normal of what it leaves through: beside an edge
            the next side is no other side.
        aside: Rays start this far below their triangle, in lengths of its side, clear of it.
        block: Pairs of a ray and a triangle that are looked at in one step.
    """

    rays: int = 256
    share: float = 0.05
    facing: float = 0.5
    aside: float = 1e-3
    block: int = 2_000_000


def thinnest(
    points: FloatArray,
    faces: IntArray,
    limit: float,
    *,
    options: ThicknessOptions = ThicknessOptions(),
) -> float:
    """Return how thick the thinnest connected part of a mesh is; infinity from `limit` on.

    Rays go inwards from triangles to where they leave the same part; all but a small share of the
    area of the part is at least that thick. points (V, 3) and limit have the same length unit.
    """
    points = points - points.mean(axis=0)
    part = components(faces, len(points))[faces[:, 0]]
    areas = vector_areas(points, faces)
    sizes = lengths(areas)
    order = np.argsort(part, kind="stable")
    chosen = order[:: -(-len(order) // options.rays)]
    chosen = chosen[sizes[chosen] > 0.0]
    if not len(chosen):
        return np.inf
    # Of a part that is inside out the normals point inwards.
    outwards = np.where(np.bincount(part, dots(areas, points[faces].mean(axis=1))) < 0.0, -1.0, 1.0)
    normals = outwards[part][:, None] * areas / np.where(sizes > 0.0, sizes, 1.0)[:, None]
    inwards = -normals[chosen]
    aside = options.aside * np.sqrt(sizes[chosen])[:, None]
    starts = points[faces[chosen]].mean(axis=1) + aside * inwards
    found = np.full(len(chosen), np.inf)
    corners = points[faces]
    for rays, targets in _near(starts, inwards, limit, corners, options.block):
        slopes = dots(inwards[rays], normals[targets])
        other = (slopes > options.facing) & (part[chosen[rays]] == part[targets])
        rays, targets, slopes = rays[other], targets[other], slopes[other]
        ahead = dots(corners[targets, 0] - starts[rays], normals[targets]) / slopes
        places = starts[rays] + ahead[:, None] * inwards[rays]
        hit = (ahead > 0.0) & (ahead < limit) & _within(places, corners[targets], normals[targets])
        np.minimum.at(found, rays[hit], ahead[hit] + aside[rays[hit], 0])
    return _least_of_parts(found, sizes[chosen], part[chosen], options.share)


def _near(
    starts: FloatArray, directions: FloatArray, limit: float, corners: FloatArray, block: int
) -> Iterator[tuple[NDArray[np.integer], NDArray[np.integer]]]:
    """Yield rays (K,) and triangles (K,) whose surrounding ball they meet, in blocks.

    starts, directions: (R, 3), unit vectors; corners (F, 3, 3).
    """
    centres = corners.mean(axis=1)
    reach = lengths((corners - centres[:, None]).reshape(-1, 3)).reshape(-1, 3).max(axis=1)
    along_starts, squares = dots(starts, directions), dots(starts, starts)
    step = max(1, block // len(starts))
    for begin in range(0, len(corners), step):
        own, radius = centres[begin : begin + step], reach[begin : begin + step, None]
        along = own @ directions.T - along_starts
        apart = dots(own, own)[:, None] - 2.0 * (own @ starts.T) + squares - along**2
        near = (apart <= radius**2) & (along >= -radius) & (along <= limit + radius)
        triangles, rays = np.nonzero(near)
        yield rays, triangles + begin


def _within(places: FloatArray, corners: FloatArray, normals: FloatArray) -> NDArray[np.bool_]:
    """Return which places (K, 3) in the planes of triangles (K, 3, 3) lie within them."""
    sides = np.roll(corners, -1, axis=1) - corners
    turns = cross(sides, places[:, None] - corners)
    inner = (turns * normals[:, None]).sum(axis=2)
    inside: NDArray[np.bool_] = (inner >= 0.0).all(axis=1) | (inner <= 0.0).all(axis=1)
    return inside


def _least_of_parts(
    thickness: FloatArray, weights: FloatArray, part: IntArray, share: float
) -> float:
    """Return the least of the thicknesses of the parts, of each the quantile `share` by weight."""
    order = np.lexsort((thickness, part))
    thickness, weights, part = thickness[order], weights[order], part[order]
    totals = np.bincount(part, weights)
    before = np.concatenate([[0.0], np.cumsum(totals)])[part]
    beyond = np.cumsum(weights) - before > share * totals[part]
    first = np.unique(part[beyond], return_index=True)[1]
    return float(thickness[beyond][first].min())
