"""Which side is out where one body covers another: a sleeve its arm, a cape its shirt.

Two solids in contact are each pushed along their own inward normals. That drives a thin layer the
wrong way where what it covers has come through: the far side of the layer would go deeper. The rest
pose tells which vertices cover what.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    dots,
    extent,
    extents,
    lengths,
    unit_vectors,
)
from dtrepair.numerics.worn.beside import in_front
from dtrepair.numerics.worn.covering import Covering


def covered_vertices(
    rest: FloatArray,
    normals: FloatArray,
    edges: IntArray,
    bodies: Sequence[slice],
    *,
    near: float,
) -> IntArray:
    """Return the vertex (V,) of another body that each vertex covers at rest, -1 where none.

    That is the nearest one, if it is near, behind the vertex as seen from its normal, and the
    vertex lies outside as seen from the other normal.

    Args:
        rest: Rest positions (V, 3).
        normals: Normals (V, 3) there, of any length.
        edges: Edges (E, 2).
        bodies: The vertices of each body.
        near: A vertex covers what is nearer than this fraction of the size of its body.
    """
    result = np.full(len(rest), -1, dtype=np.int32)
    spacing, normals = _spacing(rest, edges), unit_vectors(normals)
    for body in bodies if len(bodies) > 1 else ():
        own = np.arange(body.start, body.stop)
        reach = near * extent(rest[own])
        radius = reach + spacing.max()
        low, high = rest[own].min(axis=0) - radius, rest[own].max(axis=0) + radius
        others = np.flatnonzero(((rest >= low) & (rest <= high)).all(axis=1))
        others = others[(others < body.start) | (others >= body.stop)]
        if len(others) == 0:
            continue
        distance, place = cKDTree(rest[others]).query(rest[own])
        beneath = others[place]
        # Between the vertices of a coarse mesh the surface is nearer than any of them.
        close = distance <= reach + spacing[beneath]
        own, beneath = own[close], beneath[close]
        offset = rest[beneath] - rest[own]
        behind = np.einsum("ij,ij->i", normals[own], offset) < 0.0
        height = -np.einsum("ij,ij->i", normals[beneath], offset)
        outside = (height > 0.0) & (height < reach)
        result[own[behind & outside]] = beneath[behind & outside]
    return result


def without_crossing(
    cover: IntArray, body_of_vertex: NDArray[np.integer], crossing: NDArray[np.integer]
) -> IntArray:
    """Return what vertices cover (V,), less what is of two bodies that cross at rest.

    Of bodies that intersect each other at rest nobody knows which side is out: they cover nothing
    of each other. `crossing` (K, 2): bodies that do.
    """
    covers = np.flatnonzero(cover >= 0)
    found = body_of_vertex[np.stack([covers, cover[covers]], axis=1)]
    count = int(body_of_vertex.max(initial=0)) + 1
    unclear = np.isin(np.sort(found) @ [count, 1], np.sort(crossing) @ [count, 1])
    result = cover.copy()
    result[covers[unclear]] = -1
    return result


class Label(NamedTuple):
    """What vertices belong to, and how far from what they cover that is still covered.

    Args:
        of: The body, or the part, of each vertex (V,).
        reach: Length (V,), at rest, in which a vertex's layer may have slid over what it covers.
        beside: Keys (N,), label x V + vertex, ascending, of what lies outside of all sheets that
            have a label, at rest: a hand beside a skirt.
    """

    of: NDArray[np.signedinteger]
    reach: FloatArray
    beside: NDArray[np.int64]

    def has_beside(
        self, own: NDArray[np.signedinteger], vertices: IntArray, count: int
    ) -> NDArray[np.bool_]:
        """Return which vertices (K, 3) of `count` lie outside of what has the labels (K, 1)."""
        if len(self.beside) == 0:
            return np.zeros(vertices.shape, dtype=bool)
        keys = own * count + vertices
        place = np.minimum(np.searchsorted(self.beside, keys), len(self.beside) - 1)
        return np.asarray(self.beside[place] == keys)


def labels_of(
    rest: FloatArray,
    normals: FloatArray,
    edges: IntArray,
    sheet: NDArray[np.bool_],
    cover: IntArray,
    body_of_vertex: NDArray[np.signedinteger],
    covering: Covering | None,
    *,
    slide: float,
) -> list[Label]:
    """Return what vertices belong to: their bodies, and their parts where layers are known.

    Args:
        rest: Rest positions (V, 3).
        normals: Normals (V, 3) there, of any length.
        edges: Edges (E, 2).
        sheet: Which vertices (V,) are of open parts.
        cover: The vertex (V,) that each one covers, or -1.
        body_of_vertex: The body of each vertex (V,).
        covering: What open layers cover; None: nothing is known.
        slide: A layer slides by so much of the smaller extent of it and of what it covers.
    """
    owners: list[NDArray[np.signedinteger]] = [body_of_vertex]
    if covering is not None:
        # What is of no layer is alone: no two of such vertices are of one part.
        part = covering.part
        owners.append(np.where(part > 0, part, -2 - np.arange(len(part))))
    layer = _Layer(rest, unit_vectors(normals), _spacing(rest, edges), sheet, cover)
    return [_label(layer, owner, slide) for owner in owners]


class _Layer(NamedTuple):
    """The rest (V, 3), unit normals and spacing there, sheets, and what vertices cover or -1."""

    rest: FloatArray
    normals: FloatArray
    spacing: FloatArray
    sheet: NDArray[np.bool_]
    cover: IntArray


def _label(layer: _Layer, of: NDArray[np.signedinteger], slide: float) -> Label:
    """Return the label of what vertices (V,) belong to."""
    rest, cover = layer.rest, layer.cover
    owner = np.unique(of, return_inverse=True)[1].reshape(-1).astype(np.int64)
    sizes = extents(rest, owner)[owner]
    reach = np.zeros(len(rest))
    covers = np.flatnonzero(cover >= 0)
    beneath = cover[covers]
    reach[covers] = lengths(rest[covers] - rest[beneath])
    reach[covers] += slide * np.minimum(sizes[covers], sizes[beneath])
    several = (np.bincount(owner)[owner[covers]] > 1) & layer.sheet[covers]
    beside = [_beside(layer, owner, own) for own in np.unique(owner[covers[several]])]
    return Label(owner, reach, np.concatenate([np.zeros(0, np.int64), *beside]))


def _beside(layer: _Layer, owner: NDArray[np.int64], own: int) -> NDArray[np.int64]:
    """Return the keys (N,) of what lies outside of all that belongs to one owner (V,).

    Asked of what it covers somewhere only.
    """
    rest = layer.rest
    covers = np.flatnonzero((layer.cover >= 0) & layer.sheet & (owner == own))
    beneath = layer.cover[covers]
    asked = np.flatnonzero(np.isin(owner, owner[beneath]) & (owner != own))
    normals = layer.normals[covers]
    outward = np.where(dots(normals, rest[covers] - rest[beneath])[:, None] < 0, -normals, normals)
    found = in_front(rest[asked], rest[covers], outward, layer.spacing[covers])
    return own * len(rest) + asked[found]


def covering_sides(
    rest: FloatArray, cover: IntArray, faces: IntArray, labels: Sequence[Label], pairs: IntArray
) -> FloatArray | None:
    """Return -1 where a triangle of pairs (K, 2) covers what the other one belongs to, else 1.

    None where nothing covers anything. A triangle covers nothing of its own label, nor what lay
    out of reach of what it covers at rest (V, 3): a vest covers the chest of a shirt, and the arms
    of the shirt that lean on it are no more than beside it, as is a hand that hangs outside of a
    skirt. `cover` (V,): see `covered_vertices`.
    """
    if not (cover >= 0).any():
        return None
    sides = np.ones((len(pairs), 2))
    middles = rest[faces[pairs]].mean(axis=2)
    for label in labels:
        for mine, other in ((0, 1), (1, 0)):
            corners = faces[pairs[:, mine]]
            covered, own = cover[corners], label.of[corners[:, 0]]
            beneath = np.where(covered >= 0, label.of[covered], -1)
            others = faces[pairs[:, other]]
            of_other = label.of[others[:, 0]]
            outside = label.has_beside(own[:, None], others, len(rest)).any(axis=1)
            apart = np.linalg.norm(rest[covered] - middles[:, other, None], axis=2)
            near = (apart <= label.reach[corners]).any(axis=1)
            covers = (beneath == of_other[:, None]).all(axis=1) & (of_other != own) & near
            covers &= ~outside
            sides[covers, mine] = -1.0
    return sides


def pushed_off_covered(
    field: FloatArray, buried: FloatArray, cover: IntArray, normals: FloatArray
) -> FloatArray:
    """Return the overlap gradient (V, 3) with that of buried vertices that cover others turned.

    They leave along the normal of what they cover, which gives way as much. `buried`, `cover`
    (V,): how deep vertices are, and what they cover; `normals` (V, 3), of any length.
    """
    turned = np.flatnonzero((buried > 0) & (cover >= 0))
    if len(turned) == 0:
        return field
    beneath = cover[turned]
    force = np.linalg.norm(field[turned], axis=1, keepdims=True) * unit_vectors(normals)[beneath]
    result = field.copy()
    result[turned] = -force
    np.add.at(result, beneath, force)
    return result


def _spacing(rest: FloatArray, edges: IntArray) -> FloatArray:
    """Return the length of the longest edge at each vertex (V,) at rest."""
    result = np.zeros(len(rest))
    ends = rest[edges]
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    for side in (0, 1):
        np.maximum.at(result, edges[:, side], length)
    return result
