"""A ring about a limb: its loop and the limb's middle line, sums of vertices that any pose has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    border_edges,
    components,
    vertex_areas,
)
from dtrepair.numerics.worn.crossings import crossings
from dtrepair.numerics.worn.measure import WornOptions
from dtrepair.numerics.worn.parts import Parts
from dtrepair.numerics.worn.sides import LayerOptions

BoolArray = NDArray[np.bool_]
# So many times its last two steps a middle line goes on at most: those may be very short.
FARTHEST = 4.0


@dataclass(frozen=True, kw_only=True)
class LoopOptions:
    """How rings are found, and what stands for them.

    Args:
        parts: So many parts, the largest, may be rings.
        cells: Along a part, of which each is one dipole seen from afar.
        enclosed: Least winding number about the middle of the ring of what it goes round.
        directions: In which a ring's vertices are told apart.
        corners: Fewer directions with vertices are no ring.
        around: The core is of what is nearer to the axis than the farthest of the ring, times this.
        beyond: The core goes on so many radii beyond the ring.
        slices: Points of the core, to a radius: each is the mean of what is within a radius, by
            areas, and less the farther it is.
        ends: Beyond the ends of a limb the core goes on so many radii: a strap that tilts there is
            still on.
        short: The same of what a robe surrounds, which is much wider than that is long.
        beside: So many parts, the largest, may be surrounded by another one.
        through: A hem goes round only what reaches farther than so many radii out of it on one
            side: not round the ball of a joint that lies in it.
        near: Of both what is so many radii from the ring belongs to it.
        moved: A ring is looked at where a vertex moved by this fraction of its width.
        wider: It is on if its loop, scaled about its middle by any of these, is passed through as
            at rest: the middle line of a leg cuts the corner at a bent knee.
        worn, layers: From when on a part is worn, or surrounds another one.
    """

    parts: int = 64
    cells: int = 64
    enclosed: float = 0.25
    directions: int = 24
    corners: int = 6
    around: float = 1.2
    beyond: float = 4.0
    slices: int = 2
    ends: float = 0.5
    short: float = 1.0
    beside: int = 24
    through: float = 3.0
    near: float = 2.0
    moved: float = 0.25
    wider: tuple[float, ...] = (1.0, 1.3)
    worn: WornOptions = field(default_factory=WornOptions)
    layers: LayerOptions = field(default_factory=LayerOptions)


class Ring(NamedTuple):
    """A part, or a hem of it, that goes round another part in the rest.

    Args:
        top: The part that is worn.
        under: What it goes round.
        loop, core: Matrices (K, V) and (M, V) that take a pose to the points that stand for both.
        passes: How often, by sign, the core passes through the loop in the rest.
        concerned: Vertices (N,) of both parts that are near.
        width: Of the ring, length units.
    """

    top: int
    under: int
    loop: sparse.csr_matrix
    core: sparse.csr_matrix
    passes: int
    concerned: IntArray
    width: float

    def worn(self, pose: FloatArray, wider: Sequence[float] = (1.0,)) -> bool:
        """Return whether a pose (V, 3) has it on as the rest, or were it so many times as wide."""
        loop, core = self.loop @ pose, self.core @ pose
        middle = loop.mean(axis=0)
        grown = (middle + times * (loop - middle) for times in wider)
        return any(crossings(own, core) == self.passes for own in grown)


def hems_of(faces: IntArray) -> list[IntArray]:
    """Return the vertices (N,) of each connected border of triangles (F, 3)."""
    lone = border_edges(faces, int(faces.max(initial=-1)) + 1)
    vertices, place = np.unique(faces.ravel()[lone], return_inverse=True)
    graph = sparse.coo_matrix(
        (np.ones(place.size // 2), place.reshape(-1, 2).T), shape=(len(vertices),) * 2
    )
    label = csgraph.connected_components(graph, directed=False)[1]
    hems = [vertices[label == index] for index in np.unique(label)]
    return [own for own in hems if len(own) > 2]


def ring_about(
    parts: Parts,
    own: IntArray,
    both: tuple[int, int],
    axis: FloatArray,
    options: LoopOptions,
    *,
    through: float = 0.0,
    wide: bool = False,
) -> list[Ring]:
    """Return vertices (N,) of the first of two parts as a ring about an axis (3,).

    Nothing where the second one does not pass through it, by so many radii on one side.
    wide: whether it is a section of what only surrounds the second part.
    """
    rest = parts.poses[0]
    middle = 0.5 * (rest[own].min(axis=0) + rest[own].max(axis=0))
    across = np.linalg.svd(axis[None])[2][1:]
    flat = (rest[own] - middle) @ across.T
    turn = np.arctan2(flat[:, 1], flat[:, 0]) / (2.0 * np.pi) + 0.5
    loop = _means(own, np.floor(turn * options.directions), len(rest))
    radius = max(float(np.linalg.norm(flat, axis=1).max()), np.finfo(float).tiny)
    half = float(np.abs((rest[own] - middle) @ axis).max())

    def within(part: int, beyond: float) -> tuple[FloatArray, BoolArray]:
        """Heights (n,) of a part's vertices, and which are so many radii from the ring."""
        away = rest[parts.vertices[part]] - middle
        height = away @ axis
        near = np.linalg.norm(away @ across.T, axis=1) <= options.around * radius
        return height, near & (np.abs(height) <= half + beyond * radius)

    limb = parts.vertices[both[1]]
    height, near = within(both[1], options.beyond)
    if np.abs(height).max(initial=0.0) < through * radius:
        return []
    start = near & (np.abs(height) <= max(half, radius / options.slices))
    local = np.searchsorted(limb, parts.triangles[both[1]]).astype(np.int32)
    near = _reached(local, near, start)
    if not near.any() or loop.shape[0] < options.corners:
        return []
    areas = vertex_areas(rest[limb], local)
    unit, ends = radius, options.ends
    if wide:
        unit = min(radius, 0.5 * max(float(np.ptp(height[near])), np.finfo(float).tiny))
        ends = options.short * radius / unit
    core = _core(limb[near], height[near] / unit, areas[near], len(rest), options.slices, ends)
    passes = crossings(loop @ rest, core @ rest)
    if abs(passes) != 1:
        return []
    concerned = [parts.vertices[part][within(part, options.near)[1]] for part in both]
    return [Ring(*both, loop, core, passes, np.concatenate([own, *concerned]), 2.0 * radius)]


def _reached(faces: IntArray, near: BoolArray, start: BoolArray) -> BoolArray:
    """Return which vertices (n,) triangles (F, 3) of those near by connect to a start."""
    label = components(faces[near[faces].all(axis=1)], len(near))
    return np.asarray(near & np.isin(label, label[start]))


def _core(
    vertices: IntArray, height: FloatArray, areas: FloatArray, count: int, slices: int, ends: float
) -> sparse.csr_matrix:
    """Return the matrix (M, V) that takes a pose to the middle line of some vertices (N,).

    height: where these are along the line (N,), in radii, or half lengths of a short limb; areas:
    how much they count (N,).
    """
    low, high = float(height.min()), float(height.max())
    levels = np.linspace(low, high, 2 + int((high - low) * slices))
    rows = []
    for level in levels:
        own = np.flatnonzero(np.abs(height - level) < 1.0)
        weights = areas[own] * (1.0 - np.abs(height[own] - level))
        if weights.any():
            place = np.zeros(len(own), dtype=np.int32), own
            rows.append(sparse.csr_matrix((weights / weights.sum(), place), (1, len(height))))
    if len(rows) > 2:
        first = _ahead(rows[2], rows[0], height, low - ends)
        last = _ahead(rows[-3], rows[-1], height, high + ends)
        rows = [first, *rows, last]
    matrix = sparse.vstack(rows).tocoo()
    column = vertices[matrix.col]
    return sparse.csr_matrix((matrix.data, (matrix.row, column)), shape=(len(rows), count))


def _ahead(
    start: sparse.csr_matrix, end: sparse.csr_matrix, height: FloatArray, to: float
) -> sparse.csr_matrix:
    """Return the weights (1, N) of the point straight on from two others (1, N) `to` a height."""
    at, before = float((end @ height)[0]), float((start @ height)[0])
    share = (to - at) / (at - before) if at != before else 0.0
    return end + float(np.clip(share, 0.0, FARTHEST)) * (end - start)


def _means(vertices: IntArray, group: FloatArray, count: int) -> sparse.csr_matrix:
    """Return the matrix (M, V) that takes a pose to the means of groups (N,) of vertices (N,)."""
    _, own, sizes = np.unique(group, return_inverse=True, return_counts=True)
    own = own.reshape(-1)
    return sparse.csr_matrix((1.0 / sizes[own], (own, vertices)), shape=(len(sizes), count))
