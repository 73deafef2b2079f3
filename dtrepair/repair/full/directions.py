"""Directions that separate contacts: down the tangent-point energy, and down the overlap volume."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray, cross, dots, lengths
from dtrepair.repair.surface.layers import pushed_off_covered
from dtrepair.repair.surface.surface import BoolArray, Surface

# Directions of two regions whose cosine is beyond this are one: they do not part the regions.
PARALLEL = 0.95


@dataclass(frozen=True, kw_only=True)
class DirectionOptions:
    """How the two directions are summed.

    Args:
        volume_weight: Of the volume direction, next to the tangent-point direction of weight 1:
            it leads out of deep overlaps, whose inner triangles have no contacts to push them.
        deepest: A vertex counts as at most so many layers deep, so that a tangle does not outweigh
            every other contact.
        facing: Sheets that meet a closed part where nobody knows which side of it they lie on face
            it, whatever way they are turned: the two then go apart. The volume direction is left
            out, as what is beside a sheet is not in it.
    """

    volume_weight: float = 2.0
    deepest: int = 3
    facing: bool = False


def tangent_point_gradient(
    points: FloatArray,
    faces: IntArray,
    pairs: IntArray,
    weights: FloatArray,
    *,
    direction: FloatArray | None = None,
    sides: FloatArray | None = None,
) -> FloatArray:
    """Return the gradient (V, 3) of the signed tangent-point energy <n, c - v> / |c - v|.

    Jang et al. 2025, eq. 3 and 4 with exponents (1, 1); each vertex of a triangle meets the plane
    and centroid of the other triangle of its pair; normals and areas are held fixed. Where a
    triangle has a preferred `direction` (F, 3), it takes the place of the other one's normal
    (section 7.4); of two that have one each moves along its own. `sides` (K, 2) turn the normals of
    triangles that cover the other one.
    """
    gradient = np.zeros_like(points)
    for source, target in ((0, 1), (1, 0)):
        plane, moved = faces[pairs[:, source]], faces[pairs[:, target]]
        corners = points[plane]
        vector = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(vector, axis=1, keepdims=True)
        normal = np.divide(vector, length, out=np.zeros_like(vector), where=length > 0)
        if sides is not None:
            normal *= sides[:, source, None]
        reacting = np.ones((len(pairs), 1))
        if direction is not None:
            normal, reacting = _steered(
                normal, direction[pairs[:, target]], direction[pairs[:, source]]
            )
        area = (0.5 * weights[:, None] * length)[:, :, None]
        offset = corners.mean(axis=1)[:, None] - points[moved]
        squared = (offset**2).sum(axis=2, keepdims=True) + 1e-30
        height = (normal[:, None] * offset).sum(axis=2, keepdims=True)
        force = area * (normal[:, None] - offset * (height / squared)) / np.sqrt(squared)
        _accumulate(gradient, moved.ravel(), -force.reshape(-1, 3))
        reaction = reacting * force.sum(axis=1) / 3.0
        _accumulate(gradient, plane.ravel(), np.repeat(reaction, 3, axis=0))
    return gradient


def facing_sides(
    areas: FloatArray, pairs: IntArray, region: IntArray, sheet: BoolArray, sides: FloatArray | None
) -> FloatArray:
    """Return `sides` (K, 2) with the normals of sheets turned towards the closed parts they meet.

    areas: vector areas (F, 3); region: the contact region (K,) of each pair, which is turned as one
    by the mean of its normals; sheet: which triangles (F,) are of open parts. Known sides stay.
    """
    result = np.ones((len(pairs), 2)) if sides is None else sides.copy()
    mixed = (sheet[pairs[:, 0]] != sheet[pairs[:, 1]]) & (result > 0.0).all(axis=1)
    agree = np.bincount(region[mixed], dots(*(areas[pairs[mixed, k]] for k in (0, 1))))
    turned = np.flatnonzero(mixed)[agree[region[mixed]] > 0.0]
    result[turned] = np.where(sheet[pairs[turned]], -1.0, 1.0)
    return result


def without_beside(
    surface: Surface, buried: FloatArray, regions: IntArray, pairs: IntArray, sides: FloatArray
) -> FloatArray:
    """Return how deep vertices (V,) are, those of covering sheets where they cover something.

    Of a skirt that a hand pokes through, the few vertices in the fingers would be led out as from
    the thigh that it covers; a sheet has no inside that tells another way. Contact regions count as
    wholes. regions: that of each vertex; pairs, sides (K, 2): see `covering_sides`.
    """
    covering = surface.vertices_of(np.flatnonzero(surface.sheets)) & (surface.cover >= 0)
    own = regions[surface.faces[pairs[:, 0], 0]]
    beside = np.zeros(int(regions.max(initial=-1)) + 2, dtype=bool)  # the last one: outside
    beside[own] = True
    beside[own[(sides < 0.0).any(axis=1)]] = False
    return np.where(covering & beside[regions], 0.0, buried)


def _steered(
    normal: FloatArray, own: FloatArray, other: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the normals (K, 3) by which corners are moved, and the weights (K, 1) of reactions.

    own, other: unit directions (K, 3) of the corners' triangle and of the plane's, zero where none.
    Where both have one each is moved along its own, unless that cannot part them.
    """
    first, second = ((way != 0).any(axis=1, keepdims=True) for way in (own, other))
    one = np.where(first, own, np.where(second, -other, normal))
    both = first & second
    parting = both & (dots(own, other)[:, None] < PARALLEL)
    return np.where(both & ~parting, normal, one), np.where(parting, 0.0, 1.0)


def _accumulate(field: FloatArray, vertices: IntArray, values: FloatArray) -> None:
    for axis in range(3):
        field[:, axis] += np.bincount(vertices, values[:, axis], minlength=len(field))


def volume_gradient(
    surface: Surface, points: FloatArray, buried: FloatArray, count: int, regions: IntArray
) -> FloatArray:
    """Return the gradient (V, 3) of the overlap volume; every region weighs the same."""
    areas = surface.vector_areas(points)
    field = buried[:, None] * areas
    if surface.face_direction is not None:
        wanted = surface.incidence @ surface.face_direction
        length = np.linalg.norm(wanted, axis=1, keepdims=True)
        size = np.linalg.norm(field, axis=1, keepdims=True)
        field = np.where(length > 0, -size * wanted / np.maximum(length, 1e-30), field)
    inside = np.flatnonzero(buried)
    totals = np.bincount(regions[inside], lengths(field[inside]), minlength=count)
    field[inside] /= np.maximum(totals[regions[inside]], 1e-30)[:, None]
    return pushed_off_covered(field, buried, surface.cover, areas)
