"""How deep surfaces run into each other where nobody wanted it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.measures.surfaces import (
    Floats,
    Ints,
    Mask,
    Surface,
    flooded,
    nearest_on_triangles,
    openings,
    volumes,
    winding_numbers,
)

# How far outside the surface a vertex is asked whether it lies in another sheet of its own part,
# in parts of the diagonal.
LIFT = 1e-4
# A part bounds a volume, as far as depth goes, if its openings are less than this of its area: a
# limb that ends open inside the body, not a sleeve or a skirt.
OPEN = 0.15


def deepest_penetration(
    surface: Surface,
    points: Floats,
    pairs: Ints,
    exempt: Callable[[int, int], Mask] | None = None,
) -> float:
    """Depth of the deepest contact among pairs (K, 2) of triangles, in length units.

    The larger of two figures, for welded points (W, 3):

    - of every pair, the shortest translation that separates its two triangles;
    - of every vertex that lies inside a part without large openings, and hangs together with the
      corners of a pair through such vertices, the distance to the surface that it came through: to
      the other part; within one part, to what faces the other way, which for a limb that is
      swallowed whole may be its own back.

    exempt: for two parts the vertices (W,) of the first that may lie in the second: they are not
    asked.
    """
    if not len(pairs):
        return 0.0
    corners = points[surface.faces]
    deepest = float(_separations(corners[pairs[:, 0]], corners[pairs[:, 1]]).max())
    both = np.concatenate([pairs, pairs[:, ::-1]])
    of = surface.part_of_face[both]
    solid = surface.closed | (openings(points, surface) < OPEN)
    for own, other in np.unique(of[solid[of[:, 1]]], axis=0).tolist():
        if own == other and not surface.closed[own]:
            continue
        mine = both[(of == (own, other)).all(axis=1)]
        free = None if exempt is None else ~exempt(own, other)
        deepest = max(deepest, _buried_depth(surface, points, mine, other, free))
    return deepest


def _buried_depth(
    surface: Surface, points: Floats, pairs: Ints, other: int, free: Mask | None
) -> float:
    """Largest distance of buried vertices around the first triangles of pairs to the other part."""
    itself = bool(surface.part_of_face[pairs[0, 0]] == other)
    of_other = surface.triangles(other)
    triangles = points[surface.faces[of_other]]
    outward = None
    if itself:
        sign = np.sign(volumes(points, surface)[other])
        outward = sign * LIFT * _diagonal(points) * surface.normals(points)
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))

    def inside(vertices: Ints) -> Mask:
        places = points[vertices] if outward is None else points[vertices] + outward[vertices]
        result = ((places >= low) & (places <= high)).all(axis=1)
        if free is not None:
            result &= free[vertices]
        result[result] = np.abs(winding_numbers(places[result], triangles)) > 0.5
        return np.asarray(result)

    buried = flooded(surface, surface.faces[pairs[:, 0]].reshape(-1), inside)
    if not len(buried):
        return 0.0
    if not itself:
        return float(nearest_on_triangles(points[buried], triangles)[2].max())
    return _own_depth(surface, points, buried, surface.normals(points))


def _own_depth(surface: Surface, points: Floats, buried: Ints, normals: Floats) -> float:
    """The same where a part runs into itself."""
    faces = surface.faces[surface.triangles(int(surface.part_of_vertex[buried[0]]))]
    corners = points[faces]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    centres = corners.mean(axis=1)
    radius = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    deepest = 0.0
    for vertex in buried:
        against = (facing @ normals[vertex] < 0) & (faces != vertex).all(axis=1)
        away = np.linalg.norm(centres - points[vertex], axis=1)
        # The nearest centre bounds the distance from above, a centre less its radius from below.
        near = against & (away - radius <= away[against].min(initial=np.inf))
        if near.any():
            distance = nearest_on_triangles(points[[vertex]], corners[near])[2]
            deepest = max(deepest, float(distance[0]))
    return deepest


def _separations(first: Floats, second: Floats) -> Floats:
    """Shortest translation (K,) that takes triangles (K, 3, 3) apart: 0 where they do not meet.

    Least overlap over the normals of both, the products of their edges, and the normals of their
    edges in their planes (the last for triangles of one plane).
    """
    edges = [np.roll(own, -1, axis=1) - own for own in (first, second)]
    normals = [np.cross(own[:, 0], own[:, 1]) for own in edges]
    axes = list(normals)
    axes += [np.cross(edges[0][:, i], edges[1][:, j]) for i in range(3) for j in range(3)]
    axes += [np.cross(normals[k], edges[k][:, i]) for k in range(2) for i in range(3)]
    least = np.full(len(first), np.inf)
    size = np.linalg.norm(edges[0], axis=2).max(axis=1) + np.linalg.norm(edges[1], axis=2).max(1)
    for number, axis in enumerate(axes):
        length = np.linalg.norm(axis, axis=1)
        # Parallel edges span no axis.
        usable = length > 1e-9 * size ** (3 if number >= 11 else 2)
        unit = axis / np.where(usable, length, 1.0)[:, None]
        one, two = (np.einsum("nkd,nd->nk", own, unit) for own in (first, second))
        overlap = np.minimum(one.max(1) - two.min(1), two.max(1) - one.min(1))
        least = np.where(usable, np.minimum(least, overlap), least)
    return np.where(np.isfinite(least), np.maximum(least, 0.0), 0.0)


def _diagonal(points: Floats) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0)))
