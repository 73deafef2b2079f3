"""Whether triangles intersect, in Python's integers: slow, and by another way than the product.

Float32 coordinates are integers times a power of two. The integers are Python's, of any size, in
numpy object arrays: one expression serves all pairs and no sign can be wrong.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.object_]


def as_integers(points: NDArray[np.float32]) -> Integers:
    """Return float32 coordinates (..., 3), finite, times one power of two, as Python integers."""
    mantissa, exponent = np.frexp(points.astype(np.float64))
    whole = (mantissa * 2.0**24).astype(np.int64)
    used = whole != 0
    shift = exponent - (int(exponent[used].min()) if used.any() else 0)
    integers: Integers = np.left_shift(
        whole.astype(object), np.where(used, shift, 0).astype(object)
    )
    return integers


def cross(u: Integers, v: Integers) -> Integers:
    """Return the cross product (..., 3) of integer vectors."""
    return np.stack(
        [
            u[..., 1] * v[..., 2] - u[..., 2] * v[..., 1],
            u[..., 2] * v[..., 0] - u[..., 0] * v[..., 2],
            u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0],
        ],
        axis=-1,
    )


def dot(u: Integers, v: Integers) -> Integers:
    """Return the inner product (...,) of integer vectors."""
    products: Integers = u[..., 0] * v[..., 0] + u[..., 1] * v[..., 1] + u[..., 2] * v[..., 2]
    return products


def sign(values: Integers) -> NDArray[np.int8]:
    """Return the signs of integers as -1, 0, 1."""
    return (values > 0).astype(np.int8) - (values < 0).astype(np.int8)


def integer_intersect(first: NDArray[np.float32], second: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return whether the closed triangles first[k] and second[k] (K, 3, 3) meet, exactly (K,).

    Without area a triangle is a segment or a point.
    """
    if len(first) == 0:
        return np.zeros(0, dtype=bool)
    both = as_integers(np.stack([first, second], axis=1))
    a, b = both[:, 0], both[:, 1]
    normal_a = cross(a[:, 1] - a[:, 0], a[:, 2] - a[:, 0])
    normal_b = cross(b[:, 1] - b[:, 0], b[:, 2] - b[:, 0])
    solid_a, solid_b = (normal_a != 0).any(axis=1), (normal_b != 0).any(axis=1)
    side_b = sign(dot(normal_a[:, None], b - a[:, :1]))
    side_a = sign(dot(normal_b[:, None], a - b[:, :1]))
    apart = (np.abs(side_b.sum(axis=1)) == 3) | (np.abs(side_a.sum(axis=1)) == 3)
    coplanar = (side_b == 0).all(axis=1) & (side_a == 0).all(axis=1) & (solid_a | solid_b)
    result = np.zeros(len(a), dtype=bool)
    flat = np.flatnonzero(coplanar)
    if len(flat):
        normal = np.where(solid_a[flat, None], normal_a[flat], normal_b[flat])
        result[flat] = _coplanar_intersect(a[flat], b[flat], normal)
    crossing = np.flatnonzero((solid_a | solid_b) & ~coplanar & ~apart)
    if len(crossing):
        one, two = a[crossing], b[crossing]
        hit = _edges_hit(one, side_a[crossing], two) & solid_b[crossing]
        hit |= _edges_hit(two, side_b[crossing], one) & solid_a[crossing]
        result[crossing] = hit
    thin = np.flatnonzero(~solid_a & ~solid_b)
    if len(thin):
        result[thin] = _segments_intersect(a[thin], b[thin])
    return result


def _segments_intersect(a: Integers, b: Integers) -> NDArray[np.bool_]:
    """Return whether triangles without area (K, 3, 3) intersect (K,): segments or points."""
    along_a, along_b = (
        np.where((t[:, 1] != t[:, 0]).any(axis=1)[:, None], t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
        for t in (a, b)
    )
    across = b[:, 0] - a[:, 0]
    normal = cross(along_a, along_b)
    result = np.zeros(len(a), dtype=bool)
    aslant = (normal != 0).any(axis=1)
    flat = np.flatnonzero(aslant & (dot(normal, across) == 0))
    if len(flat):
        result[flat] = _coplanar_intersect(a[flat], b[flat], normal[flat])
    along = np.where((along_a != 0).any(axis=1)[:, None], along_a, along_b)
    in_line = ~aslant & (cross(along, across) == 0).all(axis=1)
    boxes = (a.min(axis=1) <= b.max(axis=1)) & (b.min(axis=1) <= a.max(axis=1))
    result |= in_line & boxes.all(axis=1)
    return result


def _edges_hit(edges: Integers, sides: NDArray[np.int8], triangle: Integers) -> NDArray[np.bool_]:
    """Return whether an edge that does not lie in the triangle's plane meets the triangle (K,).

    Triangles that are not coplanar intersect in a segment; its ends lie on such edges.
    """
    hit = np.zeros(len(edges), dtype=bool)
    for k in range(3):
        p, q = edges[:, k], edges[:, (k + 1) % 3]
        s, t = sides[:, k], sides[:, (k + 1) % 3]
        meets_plane = (s * t <= 0) & ((s != 0) | (t != 0))
        turns = [
            sign(dot(cross(q - p, triangle[:, i] - p), triangle[:, (i + 1) % 3] - p))
            for i in range(3)
        ]
        turn = np.stack(turns, axis=1)
        hit |= meets_plane & ((turn >= 0).all(axis=1) | (turn <= 0).all(axis=1))
    return hit


def _coplanar_intersect(a: Integers, b: Integers, normal: Integers) -> NDArray[np.bool_]:
    """Return whether closed coplanar triangles (K, 3, 3) intersect (K,).

    They are apart if and only if a line along an edge separates them; beside the edge of a
    triangle without area it may be on either side.
    """
    apart = np.zeros(len(a), dtype=bool)
    for one, other in ((a, b), (b, a)):
        for k in range(3):
            p, q, third = one[:, k], one[:, (k + 1) % 3], one[:, (k + 2) % 3]
            inward = cross(normal, q - p)
            inner_side = sign(dot(inward, third - p))
            other_sides = sign(dot(inward[:, None], other - p[:, None]))
            beside = np.abs(other_sides.sum(axis=1)) == 3
            opposite = (other_sides == -inner_side[:, None]).all(axis=1)
            apart |= np.where(inner_side == 0, beside, opposite)
    return ~apart
