"""What open layers cover: which part lies over which, and what is beneath their vertices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import IntArray, triangle_areas
from dtrepair.numerics.worn.around import lies_inside
from dtrepair.numerics.worn.layers import Layers
from dtrepair.numerics.worn.parts import Parts
from dtrepair.numerics.worn.sides import LayerOptions, WornLayer

# Shirt, jacket and coat: beneath more layers nothing moves less.
DEEPEST = 3


class Covering(NamedTuple):
    """The open layers of a mesh.

    Args:
        part: Number (V,) of the part of each vertex; 0 where no open layer is concerned.
        over: Whether a part lies over another one as an open layer, (P, P) [upper, lower].
        beneath: The vertex (V,) of what it lies over that each vertex covers, or -1: in the first
            of the poses that tell the layers, mostly the rest.
    """

    part: IntArray
    over: NDArray[np.bool_]
    beneath: IntArray

    def of_vertices(self, kept: NDArray[np.integer], place: NDArray[np.integer]) -> Covering:
        """Return the same of a mesh of the vertices that are kept; each is at its place there."""
        beneath = self.beneath[kept]
        there = np.where(beneath >= 0, place[beneath], -1).astype(np.int32)
        return Covering(self.part[kept], self.over, there)

    @property
    def depth(self) -> IntArray:
        """How many layers lie over the part of each vertex (V,), at most `DEEPEST`."""
        depth = np.zeros(len(self.over), dtype=np.int32)
        for _ in range(DEEPEST):  # circles end there
            above = np.where(self.over, depth[:, None] + 1, 0)
            depth = np.minimum(above.max(axis=0), DEEPEST).astype(np.int32)
        return np.asarray(depth[self.part])


def open_layers(layers: Layers) -> Covering | None:
    """Return what the open parts cover; None where none is a layer over anything."""
    parts, known = layers.parts, _over_something(layers)
    if not known:
        return None
    concerned = np.unique([(layer.top, layer.under) for layer in known])
    number = np.zeros(len(parts.closed) + 1, dtype=np.int32)  # the last one: of no part
    number[concerned] = np.arange(1, len(concerned) + 1)
    over = np.zeros((len(concerned) + 1,) * 2, dtype=bool)
    beneath = np.full(len(parts.part), -1, dtype=np.int32)
    nearest = np.full(len(parts.part), np.inf)
    for layer in known:
        over[number[layer.top], number[layer.under]] = True
        vertices, below, distance = _beneath(layers, layer)
        closer = distance < nearest[vertices]
        beneath[vertices[closer]], nearest[vertices[closer]] = below[closer], distance[closer]
    return Covering(number[parts.part], over, beneath)


def learnt_layers(layers: Layers) -> list[WornLayer]:
    """Return which open parts the poses have over others, the largest first.

    Not what the user told, nor a sleeve that lies in its jacket, in front of the lining.
    """
    parts, rest = layers.parts, layers.parts.poses[0]
    known = [
        own
        for own in _over_something(layers)
        if not layers.is_told(own.top, own.under)
        and not lies_inside(parts, own.top, own.under, 0, options=layers.options)
    ]
    tops = {own.top for own in known}
    areas = {top: float(triangle_areas(rest, parts.triangles[top]).sum()) for top in tops}
    return sorted(known, key=lambda layer: (-areas[layer.top], layer.top, layer.under))


def _over_something(layers: Layers) -> list[WornLayer]:
    """Return which open parts lie over which others; a head is no garment of its eyes."""
    near = near_sheets(layers.parts, layers.options, ~layers.parts.closed)
    found = (layers.between(*both) for both in near)
    known = [own for own in found if own is not None and not own.around]
    return [own for own in known if not layers.parts.closed[own.top]]


def near_sheets(
    parts: Parts, options: LayerOptions, sheets: NDArray[np.bool_]
) -> list[tuple[int, int]]:
    """Return pairs of parts, one of them a sheet (P,), whose boxes meet at rest.

    The largest of them: cards of hair are many, and no garment.
    """
    rest = parts.poses[0]
    areas = np.array([triangle_areas(rest, own).sum() for own in parts.triangles])
    by_size = np.argsort(-areas, kind="stable")
    low = np.stack([rest[own].min(axis=0) for own in parts.vertices])
    high = np.stack([rest[own].max(axis=0) for own in parts.vertices])
    pairs: set[tuple[int, int]] = set()
    for part in by_size[sheets[by_size]][: options.garments].tolist():
        meets = ((low[part] <= high) & (high[part] >= low)).all(axis=1)
        meets[part] = False
        others = by_size[meets[by_size]][: options.beneath].tolist()
        pairs |= {(min(part, other), max(part, other)) for other in others}
    return sorted(pairs)


def _beneath(layers: Layers, layer: WornLayer) -> tuple[IntArray, IntArray, NDArray[np.float64]]:
    """Return vertices (N,) that face away from what is near below, what (N,), and how far (N,)."""
    parts = layers.parts
    rest, own = parts.poses[0], parts.vertices[layer.under]
    covers = (layer.sides > 0) & np.isfinite(layer.heights)
    vertices = layer.vertices[covers]
    if layer.covered is not None:
        own = layer.covered
    distance, place = cKDTree(rest[own]).query(rest[vertices])
    return vertices, own[place], distance
