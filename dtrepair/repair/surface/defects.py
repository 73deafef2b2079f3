"""What a set of intersecting pairs means: contact regions, near and far contacts, defects."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dtrepair.intersect.topology.components import link_labels
from dtrepair.intersect.topology.ring_distances import MOST_RINGS
from dtrepair.numerics.geometry import FloatArray, IntArray, extent
from dtrepair.repair.surface.surface import BoolArray, Surface


class Defects(NamedTuple):
    """Pairs that must go: `crossings` share no vertex, `folds` share one and cross beyond it."""

    crossings: IntArray
    folds: IntArray

    @property
    def triangles(self) -> IntArray:
        """The triangles of all pairs, each once."""
        return np.unique(np.concatenate([self.crossings, self.folds]))

    @property
    def rank(self) -> tuple[int, int]:
        """Crossings first, then all pairs: smaller is better."""
        return len(self.crossings), len(self.crossings) + len(self.folds)


def find_defects(surface: Surface, points: FloatArray) -> Defects:
    """Return all intersecting pairs and folds of a pose (V, 3) in units of the surface's size."""
    return Defects(surface.contacts.pairs(points), surface.contacts.folds(points))


def update_defects(
    surface: Surface, known: Defects, points: FloatArray, moved: BoolArray
) -> Defects:
    """Return the defects of a pose that differs from one with `known` ones where `moved` (V,)."""
    if moved.all():
        return find_defects(surface, points)
    active = surface.triangles_at(moved)
    crossings = update_pairs(surface, known.crossings, points, active)
    # A fold changes where one of its two triangles moved; both are around the shared vertex.
    around = surface.vertices_of(np.flatnonzero(active))
    folds = [known.folds[~active[known.folds].any(axis=1)]]
    found = surface.contacts.folds(points, active=around)
    folds.append(found[active[found].any(axis=1)])
    return Defects(crossings, np.concatenate(folds))


def update_pairs(
    surface: Surface, known: IntArray, points: FloatArray, active: BoolArray
) -> IntArray:
    """Return the pairs (K, 2) of a pose that differs from one with `known` at `active` (F,)."""
    kept = known[~active[known].any(axis=1)]
    return np.concatenate([kept, surface.contacts.pairs(points, active=active)])


def near_contacts(surface: Surface, pairs: IntArray, near: int) -> BoolArray:
    """Return which pairs (K,) are the sides of a crease: at most `near` usual rings apart.

    So are an arm and the sleeve that it is tied to where the arm has a crease with itself, or the
    sleeve. ValueError where so many rings are not searched.
    """
    if near > MOST_RINGS:
        raise ValueError(f"near should be at most {MOST_RINGS}, got {near}: no more are searched")
    near = surface.rings(near)
    near_by: BoolArray = surface.body_of[pairs[:, 0]] == surface.body_of[pairs[:, 1]]
    near_by[near_by] = surface.contacts.ring_distance(pairs[near_by]) <= near
    if surface.ties is not None and near > 0:
        # What is stiff no fill replaces.
        soft = ~surface.stiff[surface.faces[pairs]].any(axis=(1, 2))
        for one, other in (pairs.T, pairs.T[::-1]):
            partner = surface.ties.partners.of(one, other)
            own = np.flatnonzero(soft & ~near_by & (partner >= 0))
            sides = np.stack([partner[own], other[own]], axis=1)
            near_by[own] = surface.contacts.ring_distance(sides) <= near
    return near_by


def contact_regions(surface: Surface, pairs: IntArray, buried: BoolArray) -> tuple[int, IntArray]:
    """Return the contact regions: their number and the region of each vertex (V,), -1 outside.

    A region is connected through pairs and through edges between touched or buried vertices.
    """
    touched = buried | surface.vertices_of(pairs)
    edges = surface.edges_within(touched)
    across = np.stack([surface.faces[pairs[:, 0], 0], surface.faces[pairs[:, 1], 0]], axis=1)
    links = np.concatenate([edges, across])
    labels = link_labels(links, surface.count, device=surface.device)
    names, regions = np.unique(labels[touched], return_inverse=True)
    result = np.full(surface.count, -1, dtype=np.int32)
    result[touched] = regions
    return len(names), result


def contact_scale(surface: Surface, pairs: IntArray) -> float:
    """Return the size of the smallest body in contact, units of the surface's: steps relate to it.

    A step that suits a character throws a bracelet off its wrist.
    """
    touching = np.unique(surface.body_of[pairs])
    if surface.ties is not None:
        # What is tied together is one thing, whose size counts.
        touching = np.unique(surface.cluster_of_body[touching])
        tied = surface.cluster_of_body[surface.body_of_vertex]
        return min([1.0, *(extent(surface.rest[tied == cluster]) for cluster in touching)])
    if len(surface.bodies) == 1 or len(touching) == 0:
        return 1.0
    bodies = [surface.bodies[index] for index in touching]
    return min(1.0, *(extent(surface.rest[body.start : body.stop]) for body in bodies))
