"""Thin shells that go round something, as a skirt with a thickness: their outer and inner sides.

A limb that comes through such a garment goes through both sides of it. Each of them alone would be
an open sheet, which is led back over what it covers; the two together hold each other there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse

from dtrepair.numerics.closest_point import NearestTriangles, barycentric
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    dots,
    extent,
    lengths,
    triangle_areas,
    unique_edges,
)
from dtrepair.numerics.operators import Factor
from dtrepair.numerics.worn.around import solids
from dtrepair.numerics.worn.covering import near_sheets
from dtrepair.numerics.worn.layers import Layers
from dtrepair.numerics.worn.measure import worn_measure
from dtrepair.numerics.worn.parts import Parts, vertex_normals

_LEAST = float(np.finfo(float).tiny)


@dataclass(frozen=True, kw_only=True)
class ShellOptions:
    """What counts as a shell with two sides.

    Args:
        even: Either side has at least this share of the area.
        apart: So many per cent of the inner side ...
        thick: ... are no farther from the outer one than so many times the mean thickness.
        across: Weight of edges round a rim, next to those along a side.
        room: What follows one side keeps so much more of its distance where that moves: of two
            sides that are bent the triangles cross where these are near each other.
    """

    even: float = 0.25
    apart: float = 90.0
    thick: float = 3.0
    across: float = 1e-4
    room: float = 0.5


class Shell(NamedTuple):
    """A thin closed part that goes round others, its outer and inner vertices."""

    part: int
    outer: IntArray
    inner: IntArray


def thin_shells(layers: Layers, *, options: ShellOptions = ShellOptions()) -> list[Shell]:
    """Return the thin closed parts that go round others, each with its two sides."""
    parts, numbers = layers.parts, layers.options
    thin = parts.closed.copy()
    for part in np.flatnonzero(thin).tolist():
        thin[part] = parts.thickness(part, 0) <= numbers.thin
    if not thin.any():
        return []
    scores = dict[int, FloatArray]()
    for both in near_sheets(parts, numbers, thin):
        layer = layers.between(*both)
        if layer is None or layer.around or not thin[layer.top]:
            continue
        solid = solids(parts, layer.top, layer.under, parts.poses[0])
        if worn_measure(*solid, least=numbers.worn).share < numbers.worn:
            continue
        score = scores.setdefault(layer.top, np.zeros(len(parts.vertices[layer.top])))
        score[np.searchsorted(parts.vertices[layer.top], layer.vertices)] += layer.sides
    found = (_shell(parts, part, score, options) for part, score in scores.items())
    return [shell for shell in found if shell is not None]


def _shell(parts: Parts, part: int, score: FloatArray, options: ShellOptions) -> Shell | None:
    """Return the two sides of a part whose vertices (n,) are known to face out by their score."""
    own, triangles, rest = parts.vertices[part], parts.triangles[part], parts.poses[0]
    local = np.searchsorted(own, triangles).astype(np.int32)
    edges, normals = unique_edges(local), parts.normals(part, 0)
    along = np.maximum(dots(normals[edges[:, 0]], normals[edges[:, 1]]), 0.0) ** 2
    weight = np.maximum(along, options.across)
    half = sparse.coo_matrix((weight, edges.T), shape=(len(own), len(own)))
    links = (half + half.T).tocsr()
    known = (score != 0.0).astype(float)
    system = sparse.diags(np.asarray(links.sum(axis=1)).ravel() + known + options.across) - links
    outwards = Factor(system.tocsr())((known * np.sign(score))[:, None])[:, 0] >= 0.0
    areas = triangle_areas(rest, triangles)
    sides = [float(areas[(outwards == side)[local].all(axis=1)].sum()) for side in (True, False)]
    if min(sides) < options.even * float(areas.sum()):
        return None
    shell = Shell(part, own[outwards], own[~outwards])
    outer = triangles[outwards[local].all(axis=1)]
    away = lengths(rest[shell.inner] - NearestTriangles(rest[outer]).nearest(rest[shell.inner])[1])
    mean = parts.thickness(part, 0) * extent(rest[own])
    return shell if np.percentile(away, options.apart) <= options.thick * mean else None


class Backing:
    """What follows one side of a shell: the other side, at the distance that it has at rest.

    Args:
        rest: A pose (V, 3) in which the sides do not meet.
        faces: The triangles (F, 3) of the side that leads.
        vertices: The vertices (N,) that follow.
        options: Numbers of shells.
    """

    def __init__(
        self,
        rest: FloatArray,
        faces: IntArray,
        vertices: IntArray,
        *,
        options: ShellOptions = ShellOptions(),
    ) -> None:
        self.vertices, self._faces, self._room = vertices, faces, options.room
        self._own, place = np.unique(faces, return_inverse=True)
        local = place.reshape(faces.shape)
        triangles, places = NearestTriangles(rest[faces]).nearest(rest[vertices])
        self._weights = barycentric(places, rest[faces[triangles]])
        self._local = local[triangles]
        self._height = dots(rest[vertices] - places, self._normals(rest))

    def followed(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return displacements (N, 3) where the leading side went from one pose to another.

        Where that moves by its thickness or more, they end as far from it as they are at rest, and
        `room` of that besides: a fold of both sides is gone with that of the one.
        """
        there = self._places(before)
        part = lengths(self._places(after) - there) / np.maximum(np.abs(self._height), _LEAST)
        part = np.minimum(part, 1.0)[:, None]
        moved = self._places(after, 1.0 + self._room * part)
        return np.asarray(moved - there + part * (there - before[self.vertices]))

    def _places(self, points: FloatArray, share: FloatArray | float = 1.0) -> FloatArray:
        places = np.einsum("nk,nkj->nj", self._weights, points[self._own[self._local]])
        return np.asarray(places + share * self._height[:, None] * self._normals(points))

    def _normals(self, points: FloatArray) -> FloatArray:
        """Return the unit normals (N, 3) of the leading side where the vertices lie on it."""
        every = vertex_normals(points, self._faces, self._own)
        normals = np.einsum("nk,nkj->nj", self._weights, every[self._local])
        return np.asarray(normals / np.maximum(lengths(normals), _LEAST)[:, None])
