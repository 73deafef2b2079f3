"""Which side is out where one body covers another: a sleeve its arm, a cape its shirt.

Two solids in contact are each pushed along their own inward normals. That drives a thin layer the
wrong way where what it covers has come through: the far side of the layer would go deeper. The rest
pose tells which vertices cover what.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import FloatArray, IntArray, extent

if TYPE_CHECKING:
    from dtrepair.repair.surface.surface import Surface

# A vertex covers what is nearer than this part of the size of its body at rest.
NEAR = 0.1


def covered_vertices(surface: Surface) -> IntArray:
    """The vertex (V,) of another body that each vertex covers in the rest pose, -1 where none.

    That is the nearest one, if it is near, behind the vertex as seen from its normal, and the
    vertex lies outside as seen from the other normal. Of bodies that intersect each other at rest
    nobody knows which side is out: they cover nothing of each other.
    """
    result = np.full(surface.count, -1, dtype=np.int32)
    spacing = _spacing(surface)
    rest, normals = surface.rest, _unit(surface.vector_areas(surface.rest))
    for body in surface.bodies if len(surface.bodies) > 1 else ():
        own = np.arange(body.start, body.stop)
        near = NEAR * extent(rest[own])
        radius = near + spacing.max()
        low, high = rest[own].min(axis=0) - radius, rest[own].max(axis=0) + radius
        others = np.flatnonzero(((rest >= low) & (rest <= high)).all(axis=1))
        others = others[(others < body.start) | (others >= body.stop)]
        if len(others) == 0:
            continue
        distance, place = cKDTree(rest[others]).query(rest[own])
        beneath = others[place]
        # Between the vertices of a coarse mesh the surface is nearer than any of them.
        close = distance <= near + spacing[beneath]
        own, beneath = own[close], beneath[close]
        offset = rest[beneath] - rest[own]
        behind = np.einsum("ij,ij->i", normals[own], offset) < 0.0
        height = -np.einsum("ij,ij->i", normals[beneath], offset)
        outside = (height > 0.0) & (height < near)
        result[own[behind & outside]] = beneath[behind & outside]
    covers = np.flatnonzero(result >= 0)
    if len(covers):
        found = surface.body_of_vertex[np.stack([covers, result[covers]], axis=1)]
        crossing = surface.body_of[surface.detector(surface.written(rest), exact=False)]
        count = len(surface.bodies)
        unclear = np.isin(np.sort(found) @ [count, 1], np.sort(crossing) @ [count, 1])
        result[covers[unclear]] = -1
    return result


def covering_sides(surface: Surface, pairs: IntArray) -> FloatArray | None:
    """For both triangles of pairs (K, 2) -1 where it covers the body of the other one, else 1.

    None where nothing covers anything.
    """
    if len(surface.bodies) == 1 or not (surface.cover >= 0).any():
        return None
    sides = np.ones((len(pairs), 2))
    for mine, other in ((0, 1), (1, 0)):
        cover = surface.cover[surface.faces[pairs[:, mine]]]
        body = np.where(cover >= 0, surface.body_of_vertex[cover], -1)
        sides[(body == surface.body_of[pairs[:, other]][:, None]).all(axis=1), mine] = -1.0
    return sides


def lift_covers(
    surface: Surface, points: FloatArray, buried: FloatArray, field: FloatArray
) -> None:
    """Turn the overlap gradient (V, 3) of buried vertices that cover others, in place.

    They leave along the normal of what they cover, which gives way as much.
    """
    lifted = np.flatnonzero((buried > 0) & (surface.cover >= 0))
    if len(lifted) == 0:
        return
    beneath = surface.cover[lifted]
    ways = _unit(surface.vector_areas(points))[beneath]
    force = np.linalg.norm(field[lifted], axis=1, keepdims=True) * ways
    field[lifted] = -force
    np.add.at(field, beneath, force)


def _spacing(surface: Surface) -> FloatArray:
    """Length of the longest edge at each vertex (V,) at rest."""
    result = np.zeros(surface.count)
    ends = surface.rest[surface.edges]
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    for side in (0, 1):
        np.maximum.at(result, surface.edges[:, side], length)
    return result


def _unit(vectors: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    units: FloatArray = np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)
    return units
