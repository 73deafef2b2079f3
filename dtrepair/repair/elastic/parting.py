"""Few triangles that cross are led apart by the least motion, each pair along its own axis.

A push is too smooth a field for a crease of two or three coarse triangles, and the patch that would
replace them takes the whole limb with it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dtrepair.intersect.topology.components import link_labels
from dtrepair.numerics.geometry import FloatArray, IntArray, cross, lengths, unit_vectors
from dtrepair.numerics.operators import WORK_A_ROW
from dtrepair.numerics.work import add_work
from dtrepair.repair.elastic.least_motion import LeastMotion
from dtrepair.repair.surface.defects import Defects, update_defects
from dtrepair.repair.surface.surface import Surface

# Corners of a triangle are as far along an axis up to this part of the longest side.
AS_FAR = 1e-6

Limited = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True)
class PartingOptions:
    """Numbers of the least motion that leads pairs apart.

    Args:
        most: More pairs than this are not led apart together: they are no crease.
        most_in_all: Where there are more pairs than this in all, no groups are tried.
        rounds: At most so many steps.
        rings: What moves reaches so many rings of edges beyond the pairs.
        beyond: How far apart a pair is led, mean edge lengths.
        largest: Motion of a vertex in a step, mean edge lengths.
    """

    most: int = 40
    most_in_all: int = 200
    rounds: int = 20
    rings: int = 2
    beyond: float = 0.02
    largest: float = 0.25


class Overlaps(NamedTuple):
    """Of pairs (K, 2) of triangles: the axis of the least overlap, and what it separates.

    axes: (K, 3), unit vectors; depths: (K,), how far the pairs overlap along them; ends: (K, 2, 3),
    weights of the corners of the first triangle that are farthest along the axis, all as far in
    equal parts, and of those of the second one that are farthest against it.
    """

    axes: FloatArray
    depths: FloatArray
    ends: FloatArray


def least_overlaps(points: FloatArray, faces: IntArray, pairs: IntArray) -> Overlaps:
    """Return along which axes pairs (K, 2) of triangles (F, 3) overlap least (separating axes)."""
    corners = points[faces[pairs]]
    sides = np.roll(corners, -1, axis=2) - corners
    normals = cross(sides[:, :, 0], sides[:, :, 1])
    across = cross(sides[:, 0, :, None], sides[:, 1, None]).reshape(len(pairs), 9, 3)
    axes = np.concatenate([normals, across], axis=1)
    axes = unit_vectors(axes.reshape(-1, 3)).reshape(axes.shape)
    axes = np.concatenate([axes, -axes], axis=1)
    first, second = (np.einsum("kaj,kcj->kac", axes, corners[:, side]) for side in (0, 1))
    depth = first.max(axis=2) - second.min(axis=2)
    # Parallel edges have no axis.
    depth[~axes.any(axis=2)] = np.inf
    rows, best = np.arange(len(pairs)), depth.argmin(axis=1)
    axis, most = axes[rows, best], AS_FAR * lengths(sides.reshape(-1, 3)).max()
    along = np.stack([first[rows, best], -second[rows, best]], axis=1)
    ends = (along >= along.max(axis=2, keepdims=True) - most).astype(np.float64)
    return Overlaps(axis, depth[rows, best], ends / ends.sum(axis=2, keepdims=True))


def parted(
    surface: Surface,
    points: FloatArray,
    known: Defects,
    *,
    some: bool = False,
    limited: Limited | None = None,
    options: PartingOptions = PartingOptions(),
) -> tuple[FloatArray, Defects] | None:
    """Return the pose (V, 3) with the crossings of `known` led apart, and its defects.

    None where they are too many, have no area at all, do not come apart, or others fold over.
    some: where not all come apart at once, those groups of them are led apart that do; None where
    none does. limited: the nearest pose that is allowed; no other is taken.
    """
    count, found = len(known.crossings), None
    if 0 < count <= options.most:
        found = _parted(surface, points, known, limited, options)
    if found is None and some and 0 < count <= options.most_in_all:
        return _some_parted(surface, points, known, limited, options)
    return found


def _parted(
    surface: Surface,
    points: FloatArray,
    known: Defects,
    limited: Limited | None,
    options: PartingOptions,
) -> tuple[FloatArray, Defects] | None:
    """Return the pose (V, 3) with all crossings of `known` led apart, and its defects."""
    start, folds, defects = points, len(known.folds), known
    for _ in range(options.rounds):
        pairs = defects.crossings
        if len(pairs) > options.most or surface.stiff[surface.vertices_of(pairs)].all():
            return None
        add_work(WORK_A_ROW * int(surface.vertices_of(pairs).sum()))
        region = LeastMotion(
            surface, surface.vertices_of(pairs), options.rings, largest=options.largest
        )
        overlaps = least_overlaps(points, surface.faces, pairs)
        if not np.isfinite(overlaps.depths).all():
            return None
        corners = surface.faces[pairs].reshape(-1, 6)
        ways = overlaps.ends * np.array([-1.0, 1.0])[:, None]
        gradients = ways.reshape(-1, 6, 1) * overlaps.axes[:, None]
        changes = overlaps.depths + options.beyond * surface.edge_length
        points = region.step(points, corners, gradients, changes)
        defects = update_defects(surface, known, points, (points != start).any(axis=1))
        if len(defects.crossings) == 0:
            allowed = limited is None or np.array_equal(limited(points), points)
            return (points, defects) if allowed and len(defects.folds) <= folds else None
    return None


def _some_parted(
    surface: Surface,
    points: FloatArray,
    known: Defects,
    limited: Limited | None,
    options: PartingOptions,
) -> tuple[FloatArray, Defects] | None:
    """Return the pose (V, 3) with groups of crossings led apart, each for itself."""
    left, groups = known, _groups(surface, known.crossings, options.rings)
    for group in groups if len(groups) > 1 else []:
        found = _parted(surface, points, left._replace(crossings=group), limited, options)
        if found is not None:
            moved = (found[0] != points).any(axis=1)
            points, left = found[0], update_defects(surface, left, found[0], moved)
    return None if left is known else (points, left)


def _groups(surface: Surface, pairs: IntArray, rings: int) -> list[IntArray]:
    """Split pairs (K, 2) of triangles where nothing within so many rings of edges connects them."""
    near = surface.dilate(surface.vertices_of(pairs), rings)
    links = np.concatenate([surface.edges_within(near), surface.faces[pairs, 0]])
    label = link_labels(links, surface.count)[surface.faces[pairs[:, 0], 0]]
    return [pairs[label == own] for own in np.unique(label)]
