"""The global phase: diffused directions push far contacts apart, in steps of a set length."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray, lengths
from dtrepair.repair.surface.defects import contact_regions, near_contacts
from dtrepair.repair.surface.layers import covering_sides, lift_covers
from dtrepair.repair.surface.surface import Surface
from dtrepair.repair.surface.winding import winding_numbers

# The volume direction counts this much more than the tangent-point direction.
VOLUME_WEIGHT = 2.0
# A vertex counts as at most this many layers deep.
DEEPEST = 3
# A new best must improve on the last one by this factor to renew the patience.
PROGRESS = 0.98
# So many moving bodies are a pile, whose steps follow this quantile of their motions; bodies that
# move less than this part of the largest motion stand.
PILE, SLOWEST, STANDING = 4, 0.25, 0.01

# Maps a pose (V, 3) to the nearest one that is allowed; None: every pose is.
Limit = Callable[[FloatArray], FloatArray] | None


class Pushed(NamedTuple):
    """The best pose (V, 3), how many pairs it has, and the iterations spent."""

    points: FloatArray
    pairs: IntArray
    iterations: int


def push(
    surface: Surface,
    points: FloatArray,
    *,
    near: int,
    step: float,
    iterations: int = 25,
    patience: int = 6,
    known_pairs: IntArray | None = None,
    limit: Limit = None,
    detect: Callable[[FloatArray], IntArray] | None = None,
    volume: bool = True,
) -> Pushed:
    """Separate the contacts of triangles more than `near` edge rings apart.

    Each iteration moves along the sum of the diffused tangent-point direction and the diffused
    gradient of the overlap volume, the largest displacement being `step` (units of the size).
    Contacts within `near` rings are creases, which so smooth a field cannot open: it stops when
    only those are left, when nothing improved for `patience` iterations, or when a direction is
    not finite. `limit` maps a pose to the nearest allowed one, `detect` finds the pairs of a pose
    (default: those that intersect); without `volume` only the tangent-point direction pushes. The
    pose with the fewest far pairs and the least buried weight is returned.
    """
    best: tuple[float, FloatArray, IntArray] | None = None
    start = points
    detect = detect or surface.pairs
    renewed, pairs = 0, known_pairs
    for iteration in range(iterations + 1):
        if pairs is None:
            pairs = detect(points)
        far, openness = _far_contacts(surface, pairs, near)
        winding = _beside_pairs(surface, pairs, winding_numbers(surface, points, pairs))
        buried = np.clip(winding, -DEEPEST, DEEPEST) * openness
        key = len(far) + float(np.abs(winding * openness).sum())
        if best is None or key < best[0]:
            if best is None or key < PROGRESS * best[0]:
                renewed = iteration
            best = (key, points, pairs)
        if len(far) == 0 or iteration == iterations or iteration - renewed >= patience:
            break
        direction = _direction(
            surface, points, pairs, far, winding, buried if volume else np.zeros_like(buried)
        )
        moved = _of_length(surface, direction, step)
        if moved is None:
            break
        points = surface.rigid.fitted(start, points - moved)
        if limit is not None:
            points = limit(points)
        pairs = None
    assert best is not None
    return Pushed(best[1], best[2], iteration)


def _of_length(surface: Surface, direction: FloatArray, step: float) -> FloatArray | None:
    """The direction (V, 3) with the largest displacement `step`; None where it is not finite.

    In a pile of many bodies one contact must not make all others wait: a quarter of the bodies may
    have their direction shortened to the step, each as a whole.
    """
    length = lengths(direction)
    largest = float(length.max())
    if not (largest > 0 and np.isfinite(largest)):
        return None
    starts = [body.start for body in surface.bodies]
    of_body = np.maximum.reduceat(length, starts)
    moving = of_body[of_body > STANDING * largest]
    if len(moving) < PILE:
        return (step / largest) * direction
    limit = step * np.maximum.reduceat(surface.mobility, starts)
    scale = np.minimum(step / np.quantile(moving, SLOWEST), limit / np.maximum(of_body, 1e-300))
    scaled: FloatArray = scale[surface.body_of_vertex][:, None] * direction
    return scaled


def _far_contacts(surface: Surface, pairs: IntArray, near: int) -> tuple[IntArray, FloatArray]:
    """The far pairs, and for each vertex (V,) how far it is from any crease, 0 to 1."""
    creased = near_contacts(surface, pairs, near)
    reach = 6 if near > 6 else max(1, near // 2)
    rings = surface.rings_from(surface.vertices_of(pairs[creased]), reach + 1)
    return pairs[~creased], np.minimum(rings / reach, 1.0)


def _beside_pairs(surface: Surface, pairs: IntArray, winding: IntArray) -> IntArray:
    """The winding numbers (V,) of regions with pairs, elsewhere 0.

    A part that is wholly inside another, like an eye in its head, would only shrink.
    """
    count, regions = contact_regions(surface, pairs, winding != 0)
    met = np.zeros(count + 1, dtype=bool)  # the last one: outside of all regions
    met[regions[surface.faces[pairs[:, 0], 0]]] = True
    return np.where(met[regions], winding, 0)


def _direction(
    surface: Surface,
    points: FloatArray,
    pairs: IntArray,
    far: IntArray,
    winding: IntArray,
    buried: FloatArray,
) -> FloatArray:
    """Sum of the two diffused directions (V, 3), each scaled to a largest displacement of 1."""
    count, regions = contact_regions(surface, pairs, winding != 0)
    of_pair = regions[surface.faces[far[:, 0], 0]]
    weights = 1.0 / np.bincount(of_pair, minlength=count)[of_pair]
    fields = [
        tangent_point_gradient(
            points,
            surface.faces,
            far,
            weights,
            direction=surface.face_direction,
            sides=covering_sides(surface, far),
        )
    ]
    if buried.any():
        fields.append(_volume_gradient(surface, points, buried, count, regions))
    smooth = surface.diffuse(np.concatenate(fields, axis=1), points) * surface.mobility[:, None]
    total = np.zeros_like(points)
    for k, weight in zip(range(0, smooth.shape[1], 3), (1.0, VOLUME_WEIGHT), strict=False):
        part = smooth[:, k : k + 3]
        total += weight * part / (lengths(part).max() + 1e-30)
    return total


def tangent_point_gradient(
    points: FloatArray,
    faces: IntArray,
    pairs: IntArray,
    weights: FloatArray,
    *,
    direction: FloatArray | None = None,
    sides: FloatArray | None = None,
) -> FloatArray:
    """Gradient (V, 3) of the signed tangent-point energy with the kernel <n, c - v> / |c - v|.

    Jang et al. 2025, eq. 3 and 4 with exponents (1, 1); each vertex of a triangle meets the plane
    and centroid of the other triangle of its pair; normals and areas are held fixed. Where a
    triangle has a preferred `direction` (F, 3), it takes the place of the other one's normal
    (section 7.4). `sides` (K, 2) turn the normals of triangles that cover the other one.
    """
    gradient = np.zeros_like(points)
    for source, target in ((0, 1), (1, 0)):
        plane, moved = faces[pairs[:, source]], faces[pairs[:, target]]
        corners = points[plane]
        vector = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(vector, axis=1, keepdims=True)
        normal = np.divide(vector, length, out=np.zeros_like(vector), where=length > 0)
        if sides is not None:
            normal *= sides[:, source, None]
        if direction is not None:
            wanted = direction[pairs[:, target]] - direction[pairs[:, source]]
            normal = np.where((wanted != 0).any(axis=1, keepdims=True), wanted, normal)
        area = (0.5 * weights[:, None] * length)[:, :, None]
        offset = corners.mean(axis=1)[:, None] - points[moved]
        squared = (offset**2).sum(axis=2, keepdims=True) + 1e-30
        height = (normal[:, None] * offset).sum(axis=2, keepdims=True)
        force = area * (normal[:, None] - offset * (height / squared)) / np.sqrt(squared)
        _accumulate(gradient, moved.ravel(), -force.reshape(-1, 3))
        _accumulate(gradient, plane.ravel(), np.repeat(force.sum(axis=1) / 3.0, 3, axis=0))
    return gradient


def _accumulate(field: FloatArray, vertices: IntArray, values: FloatArray) -> None:
    for axis in range(3):
        field[:, axis] += np.bincount(vertices, values[:, axis], minlength=len(field))


def _volume_gradient(
    surface: Surface, points: FloatArray, buried: FloatArray, count: int, regions: IntArray
) -> FloatArray:
    """Gradient (V, 3) of the overlap volume; every region weighs the same."""
    field = buried[:, None] * surface.vector_areas(points)
    if surface.face_direction is not None:
        wanted = surface.incidence @ surface.face_direction
        length = np.linalg.norm(wanted, axis=1, keepdims=True)
        size = np.linalg.norm(field, axis=1, keepdims=True)
        field = np.where(length > 0, -size * wanted / np.maximum(length, 1e-30), field)
    inside = np.flatnonzero(buried)
    totals = np.bincount(regions[inside], lengths(field[inside]), minlength=count)
    field[inside] /= np.maximum(totals[regions[inside]], 1e-30)[:, None]
    lift_covers(surface, points, buried, field)
    return field
