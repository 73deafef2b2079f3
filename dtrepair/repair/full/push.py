"""The global phase: diffused directions push far contacts apart, in steps of a set length."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray, lengths, vector_areas
from dtrepair.repair.full.directions import (
    DirectionOptions,
    facing_sides,
    tangent_point_gradient,
    volume_gradient,
    without_beside,
)
from dtrepair.repair.surface.defects import contact_regions, near_contacts
from dtrepair.repair.surface.surface import Surface
from dtrepair.repair.surface.winding import winding_numbers

# Maps a pose (V, 3) to the nearest one that is allowed; None: every pose is.
Limit = Callable[[FloatArray], FloatArray] | None


@dataclass(frozen=True, kw_only=True)
class PushOptions:
    """Numbers of the push.

    Args:
        iterations: At most so many.
        patience: It ends after so many iterations without progress.
        progress: A new best must lower the count to this fraction to renew the patience.
        wide_near: Up to so many rings a contact is a crease beside which the volume fades in over
            half the rings; from there on over `wide_rings`.
        wide_rings: See `wide_near`; creases of a few rings have no room for more.
        pile: So many moving bodies are a pile, whose steps follow the `slowest` of them.
        slowest: Quantile of the bodies' motions: the others may have theirs shortened.
        standing: Bodies that move less than this fraction of the largest motion do not move.
        part: No part moves farther in an iteration than this fraction of its size: a step that
            suits a head throws the teeth out of it.
        direction: Numbers of the directions.
    """

    iterations: int = 25
    patience: int = 6
    progress: float = 0.98
    wide_near: int = 6
    wide_rings: int = 6
    pile: int = 4
    slowest: float = 0.25
    standing: float = 0.01
    part: float = 0.05
    direction: DirectionOptions = field(default_factory=DirectionOptions)


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
    known_pairs: IntArray | None = None,
    limit: Limit = None,
    detect: Callable[[FloatArray], IntArray] | None = None,
    volume: bool = True,
    options: PushOptions = PushOptions(),
) -> Pushed:
    """Separate the contacts of triangles more than `near` edge rings apart.

    Each iteration moves along the sum of the diffused tangent-point direction and the diffused
    gradient of the overlap volume, the largest displacement being `step` (units of the size).
    Contacts within `near` rings are creases, which so smooth a field cannot open: it stops when
    only those are left, when nothing improved for some iterations, or when a direction is not
    finite. The pose with the fewest far pairs and the least buried weight is returned.

    known_pairs: those of `points`; limit: maps a pose to the nearest allowed one; detect: finds the
    pairs of a pose (default: those that intersect); volume: without it only the tangent-point
    direction pushes.
    """
    best: tuple[float, FloatArray, IntArray] | None = None
    start = points
    detect = detect or surface.contacts.pairs
    renewed, pairs = 0, known_pairs
    for iteration in range(options.iterations + 1):
        if pairs is None:
            pairs = detect(points)
        contacts = _far_contacts(surface, points, pairs, near, options)
        if best is None or contacts.cost < best[0]:
            if best is None or contacts.cost < options.progress * best[0]:
                renewed = iteration
            best = (contacts.cost, points, pairs)
        if len(contacts.far) == 0 or iteration == options.iterations:
            break
        if iteration - renewed >= options.patience:
            break
        direction = _direction(surface, points, contacts, options.direction, volume=volume)
        moved = _of_length(surface, direction, step, options)
        if moved is None:
            break
        moved = _of_parts(surface, moved, options.part)
        points = surface.rigid.fitted(start, points - moved)
        if limit is not None:
            points = limit(points)
        pairs = None
    assert best is not None
    return Pushed(best[1], best[2], iteration)


def _of_length(
    surface: Surface, direction: FloatArray, step: float, options: PushOptions
) -> FloatArray | None:
    """Return the direction (V, 3) at a largest displacement of `step`; None if not finite.

    In a pile of many bodies one contact must not make all others wait: a quarter of the bodies may
    have their direction shortened to the step, each as a whole.
    """
    length = lengths(direction)
    largest = float(length.max())
    if not (largest > 0 and np.isfinite(largest)):
        return None
    # What is tied together goes together.
    of_body = surface.cluster_maxima(length)
    first = np.unique(surface.cluster_of_body, return_index=True)[1]
    moving = of_body[first][of_body[first] > options.standing * largest]
    if len(moving) < options.pile:
        return (step / largest) * direction
    limit = step * surface.cluster_maxima(surface.mobility)
    scale = np.minimum(
        step / np.quantile(moving, options.slowest), limit / np.maximum(of_body, 1e-300)
    )
    shortened: FloatArray = scale[surface.body_of_vertex][:, None] * direction
    return shortened


def _of_parts(surface: Surface, motion: FloatArray, share: float) -> FloatArray:
    """Return a motion (V, 3) in which no part, as a whole, goes beyond a share of its size."""
    most = share * surface.part_sizes
    if most.min(initial=np.inf) >= lengths(motion).max(initial=0.0):
        return motion
    length = np.zeros(len(most))
    np.maximum.at(length, surface.part_of_vertex, lengths(motion))
    scale = np.minimum(most / np.maximum(length, 1e-300), 1.0)
    return np.asarray(scale[surface.part_of_vertex][:, None] * motion)


class _Contacts(NamedTuple):
    """The pairs (K, 2) of a pose, what of them a push can separate, and what it lowers.

    far: pairs that are no creases; winding: numbers (V,); buried: layers (V,) over a vertex, fewer
    near creases; cost: far pairs and buried weight.
    """

    pairs: IntArray
    far: IntArray
    winding: IntArray
    buried: FloatArray
    cost: float


def _far_contacts(
    surface: Surface, points: FloatArray, pairs: IntArray, near: int, options: PushOptions
) -> _Contacts:
    """Return the contacts of a pose (V, 3) beyond creases of `near` rings."""
    creased = near_contacts(surface, pairs, near)
    reach = options.wide_rings if near > options.wide_near else max(1, near // 2)
    rings = surface.rings_from(surface.vertices_of(pairs[creased]), reach + 1)
    # 0 in a crease, 1 far from any.
    openness: FloatArray = np.minimum(rings / reach, 1.0)
    far, deepest = pairs[~creased], options.direction.deepest
    winding = _beside_pairs(surface, pairs, winding_numbers(surface, points, pairs))
    buried: FloatArray = openness * np.clip(winding, -deepest, deepest)
    cost = len(far) + float(np.abs(winding * openness).sum())
    return _Contacts(pairs, far, winding, buried, cost)


def _beside_pairs(surface: Surface, pairs: IntArray, winding: IntArray) -> IntArray:
    """Return the winding numbers (V,) of regions with pairs, elsewhere 0.

    A component that is wholly inside another, like an eye in its head, would only shrink.
    """
    count, regions = contact_regions(surface, pairs, winding != 0)
    met = np.zeros(count + 1, dtype=bool)  # the last one: outside of all regions
    met[regions[surface.faces[pairs[:, 0], 0]]] = True
    return np.where(met[regions], winding, 0)


def _direction(
    surface: Surface,
    points: FloatArray,
    contacts: _Contacts,
    options: DirectionOptions,
    *,
    volume: bool,
) -> FloatArray:
    """Return the sum of both diffused directions (V, 3), each at a largest displacement of 1."""
    far = contacts.far
    count, regions = contact_regions(surface, contacts.pairs, contacts.winding != 0)
    of_pair = regions[surface.faces[far[:, 0], 0]]
    weights = 1.0 / np.bincount(of_pair, minlength=count)[of_pair]
    sides = surface.covering_sides(far)
    if options.facing:
        areas = vector_areas(points, surface.faces)
        sides = facing_sides(areas, far, of_pair, surface.sheets, sides)
    fields = [
        tangent_point_gradient(
            points, surface.faces, far, weights, direction=surface.face_direction, sides=sides
        )
    ]
    if volume and not options.facing:
        buried = contacts.buried
        if sides is not None:
            buried = without_beside(surface, buried, regions, far, sides)
        if buried.any():
            fields.append(volume_gradient(surface, points, buried, count, regions))
    smooth = surface.diffuse(np.concatenate(fields, axis=1), points) * surface.mobility[:, None]
    total = np.zeros_like(points)
    sizes = (1.0, options.volume_weight)
    for k, size in zip(range(0, smooth.shape[1], 3), sizes, strict=False):
        direction = smooth[:, k : k + 3]
        total += size * direction / (lengths(direction).max() + 1e-30)
    return total
