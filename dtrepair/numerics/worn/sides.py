"""Which of two connected parts lies outside the other: a sleeve over its arm, a belt round a waist.

The side on which one part lies of the other is read off poses in which the two do not meet. Of
each vertex the nearest vertex of the other part with a parallel normal is looked at; where most of
what is near lies on one side, that part is a layer over the other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import FloatArray, IntArray, dots, extent, lengths
from dtrepair.numerics.worn.parts import Parts

BoolArray = NDArray[np.bool_]
# The vertices of one part near where it is attached to another one, None where it is not.
Zone = Callable[[int, int], IntArray | None]


@dataclass(frozen=True, kw_only=True)
class LayerOptions:
    """What counts as lying over something.

    Args:
        near: A part lies over what is nearer than this fraction of the smaller part's extent.
        neighbours: Vertices of the other part that are looked at.
        parallel: Least cosine between the normals of a vertex and of what it lies over.
        share: Least fraction of the area of either part that has something parallel nearby.
        clear: Least mean side: +1 where all of it lies outside, 0 where the parts take turns.
        one_sided: An open sheet lies over what this share of its nearby area lies outside of, none
            of it turned the other way: an arm beside its body has two sides.
        worn: An open part is a layer over what it goes round by this share, see `worn_measure`; so
            is a closed one, as a skirt with a lining, ...
        around: ... or over what it surrounds by this share where it is beside it, see `surrounds`,
            and that has at least the share `small` of its area, as a leg, and not a wrist, ...
        thin: ... that is not thicker than this, units of its extent: a bracelet is.
        poses: How many poses tell at most.
        ball: An open part surrounds itself where its normals point away from its middle by this.
        hole: A part is solid if its border, as one round hole, is at most this share of its area.
        garments, beneath: So many open parts, the largest, are looked at for what they cover, and
            so many others of each: a pair takes some milliseconds.
    """

    near: float = 0.1
    neighbours: int = 12
    parallel: float = 0.3
    share: float = 0.3
    clear: float = 0.1
    one_sided: float = 0.9
    worn: float = 0.7
    around: float = 0.95
    small: float = 0.03
    thin: float = 0.02
    poses: int = 5
    ball: float = 0.5
    hole: float = 0.05
    garments: int = 48
    beneath: int = 6


class WornLayer(NamedTuple):
    """A part that lies outside another one.

    Args:
        top: The outer part.
        under: The inner one.
        vertices: Vertices (N,) of the outer part that are held outside the inner one.
        sides: Of each (N,) 1 if its normal points away from the inner part, -1 if towards it.
        heights: How far each (N,) is from the inner part, length units.
        covered: Vertices of the inner part that it lies over; None: all. Of what a sheet does not
            cover, as arms beside a cape, no side is known.
        around: Whether all that is known is that it surrounds the inner part, see `find_around`.
    """

    top: int
    under: int
    vertices: IntArray
    sides: FloatArray
    heights: FloatArray
    covered: IntArray | None = None
    around: bool = False


def find_layer(
    parts: Parts,
    first: int,
    second: int,
    poses: Sequence[int],
    *,
    options: LayerOptions = LayerOptions(),
) -> WornLayer | None:
    """Return which of two parts lies over the other by some of the poses; None where neither does.

    The first of the poses tells which vertices lie over what.
    """
    top = upper_part(parts, first, second, poses=poses, options=options)
    if top is None:
        top = _turned(parts, first, second, poses[0], options)
        if top is None:
            return None
        if upper_part(parts, first, second, top, poses=poses, options=options) != top:
            return None
    under = second if top == first else first
    found_layer = layer_over(parts, top, under, poses[0], options=options)
    return found_layer if len(found_layer.vertices) else None


def upper_part(
    parts: Parts,
    first: int,
    second: int,
    turned: int | None = None,
    *,
    poses: Sequence[int] = (0,),
    options: LayerOptions = LayerOptions(),
) -> int | None:
    """Return which of two parts lies over the other by some of the poses; None: neither does.

    turned: a part whose normals count reversed.
    """
    signed, covered, share = 0.0, 0.0, 0.0
    facing = 1.0 if turned is None else -1.0
    for pose in poses:
        for part, other, sign in ((first, second, 1.0), (second, first, -1.0)):
            found = look_beside(parts, part, other, pose, options)
            parallel = found.known & (facing * found.sides > 0)
            # By the share of each part's area: a small part is not outvoted by a large one.
            weights = parts.area_shares(part)
            own = float(weights[parallel].sum())
            # Heights are seen from the other part's normals.
            seen = -sign if other == turned else sign
            signed += seen * float((weights * np.sign(found.heights))[parallel].sum())
            covered = covered + own
            # An arm beside an open shirt, of which little is near, is not inside of it.
            share = max(share, own) if turned in (None, part) else share
    if share < options.share or abs(signed) <= options.clear * covered:
        return None
    return first if signed > 0 else second


def _turned(parts: Parts, first: int, second: int, pose: int, options: LayerOptions) -> int | None:
    """Return the one of two parts that is open if it is, mostly, turned against the other.

    Against a coat's lining all that it covers is turned: trousers are not worn over it.
    """
    if parts.closed[first] == parts.closed[second]:
        return None
    part, other = (second, first) if parts.closed[first] else (first, second)
    if parts.thickness(other, pose) <= options.thin:
        return None
    found = look_beside(parts, part, other, pose, options)
    weights = parts.area_shares(part) * found.known
    return part if float((weights * found.sides).sum()) < 0.0 else None


def layer_over(
    parts: Parts, top: int, under: int, pose: int, *, options: LayerOptions = LayerOptions()
) -> WornLayer:
    """Return a layer of which is known that it lies over another part, whatever a pose shows.

    All vertices of an open layer are held outside: what hangs free may meet it later. Of a closed
    one those that are near in the pose, and outside if any is.
    """
    found = look_beside(parts, top, under, pose, options)
    outside = found.known & (found.heights > 0)
    own = outside if outside.any() else found.known
    sides, heights = found.sides.copy(), np.where(outside, found.heights, np.inf)
    if not parts.closed[top] and own.any():
        weights = parts.area_shares(top)[own]
        sides[~own] = 1.0 if (weights * sides[own]).sum() >= 0.0 else -1.0
        own = np.ones(len(own), dtype=bool)
    return WornLayer(top, under, parts.vertices[top][own], sides[own], heights[own])


def find_sheet(
    parts: Parts,
    first: int,
    second: int,
    pose: int,
    *,
    zone: Zone,
    options: LayerOptions = LayerOptions(),
) -> WornLayer | None:
    """Return the layer that an open sheet is over what it is attached to; None where neither is.

    All of it that is near lies on one side, and is turned the same way: a cape behind a back.
    """
    for top, under in ((first, second), (second, first)):
        if parts.closed[top]:
            continue
        found = look_beside(parts, top, under, pose, options)
        near = zone(top, under)
        free = np.ones(len(found.known), dtype=bool)
        if near is not None:
            free = ~np.isin(parts.vertices[top], near)
        weights = parts.area_shares(top) * free
        known = weights * found.known
        turned = abs(float((known * found.sides).sum()))
        outside = float((known * np.sign(found.heights)).sum())
        if known.sum() < max(options.share * weights.sum(), np.finfo(float).tiny):
            continue
        if min(turned, outside) >= options.one_sided * known.sum():
            layer = layer_over(parts, top, under, pose, options=options)
            side = float(np.sign((known * found.sides).sum()))
            # Of coarse cards that overlap nothing may lie beneath any vertex.
            if len(covered := _covered(parts, top, under, pose, side, options)):
                return layer._replace(covered=covered)
    return None


def _covered(
    parts: Parts, top: int, under: int, pose: int, side: float, options: LayerOptions
) -> IntArray:
    """Return the vertices of a part that a sheet lies over: they face it, and it faces away."""
    points, own = parts.poses[pose], parts.vertices[under]
    nearest = cKDTree(points[parts.vertices[top]]).query(points[own])[1]
    way = points[parts.vertices[top]][nearest] - points[own]
    way /= np.maximum(lengths(way), np.finfo(float).tiny)[:, None]
    facing = dots(way, parts.normals(under, pose)) > options.parallel
    away = side * dots(way, parts.normals(top, pose)[nearest]) > options.parallel
    return np.asarray(own[facing & away])


class Beside(NamedTuple):
    """For vertices (n,) of a part: whether anything is beside them, on which side, how far away."""

    known: BoolArray
    sides: FloatArray
    heights: FloatArray


def look_beside(parts: Parts, part: int, other: int, pose: int, options: LayerOptions) -> Beside:
    """Return what of another part is beside each vertex of a part, with a parallel normal."""
    points = parts.poses[pose]
    own, others = points[parts.vertices[part]], points[parts.vertices[other]]
    near = options.near * min(extent(own), extent(others))
    spacing = parts.spacing[parts.vertices[other]]
    # Of a head few vertices are within reach of a lash.
    reach = near + spacing.max(initial=0.0)
    within = (own >= others.min(axis=0) - reach) & (own <= others.max(axis=0) + reach)
    chosen = np.flatnonzero(within.all(axis=1))
    result = Beside(np.zeros(len(own), dtype=bool), np.zeros(len(own)), np.zeros(len(own)))
    if len(chosen) == 0:
        return result
    own = own[chosen]
    count = min(options.neighbours, len(others))
    distance, place = cKDTree(others).query(own, np.arange(1, count + 1))
    normals, other_normals = parts.normals(part, pose)[chosen], parts.normals(other, pose)
    cosine = np.einsum("ij,ikj->ik", normals, other_normals[place])
    offset = own[:, None] - others[place]
    # Seen from the other part, whichever way the vertex itself faces.
    height = np.einsum("ikj,ikj->ik", other_normals[place], offset)
    good = np.abs(cosine) > options.parallel
    good &= (distance <= near + spacing[place]) & (np.abs(height) < near)
    rows, column = np.arange(len(own)), np.argmax(good, axis=1)
    result.known[chosen] = good[rows, column]
    result.sides[chosen] = np.sign(cosine[rows, column])
    result.heights[chosen] = height[rows, column]
    return result
