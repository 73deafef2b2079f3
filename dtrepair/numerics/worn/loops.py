"""Rings and the limbs that go through them: a belt, a strap, a sleeve, and whether it is still on.

What goes round something in the rest has a loop, the middle of it in each of several directions,
and what it goes round a core, its middle line. As long as the core passes through the loop, or one
somewhat wider, the ring is worn. Both are sums of vertices, so that any pose has them. A garment
has a ring at each of its hems: an arm may come out of a sleeve while the jacket stays on.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from dtrepair.numerics.enclosure import Dipoles
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    border_edges,
    components,
    lengths,
    triangle_areas,
    vertex_areas,
)
from dtrepair.numerics.recent import Recent
from dtrepair.numerics.worn.crossings import crossings
from dtrepair.numerics.worn.measure import WornOptions, surrounds, worn_measure
from dtrepair.numerics.worn.parts import Parts
from dtrepair.numerics.worn.sides import LayerOptions, may_go_round, solids

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
        through: A hem goes round only what reaches farther than so many radii out of it on one
            side: not round the ball of a joint that lies in it.
        near: Of both what is so many radii from the ring belongs to it.
        moved: A ring is looked at where a vertex moved by this fraction of its width.
        wider: It is on if its loop, scaled about its middle by any of these, is passed through as
            at rest: the middle line of a leg cuts the corner at a bent knee.
        worn, layers: From when on a part is worn, and surrounds what is beside it.
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


class Rings:
    """The rings of a mesh, found when they are asked for.

    Args:
        parts: The parts; the first of their poses is the rest.
        stiff: Which parts cannot give way: of two of which one is stiff neither is worn.
        options: What counts as a ring, and what stands for it.
    """

    def __init__(
        self, parts: Parts, stiff: Collection[int] = (), *, options: LoopOptions = LoopOptions()
    ) -> None:
        self.parts, self.stiff, self.options = parts, frozenset(stiff), options
        rest = parts.poses[0]
        areas = np.array([triangle_areas(rest, own).sum() for own in parts.triangles])
        self._large = np.argsort(-areas, kind="stable")[: options.parts]
        self._low = np.stack([rest[own].min(axis=0) for own in parts.vertices])
        self._high = np.stack([rest[own].max(axis=0) for own in parts.vertices])
        sheets = (may_go_round(parts, part, 0, options.layers) for part in range(len(areas)))
        self._sheets = np.fromiter(sheets, dtype=bool)
        self._known: dict[int, list[Ring]] = {}
        # Many corrections of one input are asked for.
        self._worn_before = Recent[_WornIn]()

    def taken_off(self, before: FloatArray, after: FloatArray) -> list[Ring]:
        """Return the rings that are on in one pose (V, 3), and off in another."""
        farthest = float(lengths(after - before).max()) / self.options.moved
        width = np.sort(self._high - self._low, axis=1)[:, 1]
        # A hem is narrower than its garment.
        narrow = (width < farthest) | self._sheets
        found = [ring for top in self._large[narrow[self._large]] for ring in self.of(int(top))]
        near = [ring for ring in found if ring.width < farthest]
        was_worn = self._worn_before(_WornIn, before)
        worn = partial(Ring.worn, pose=after, wider=self.options.wider)
        return [ring for ring in near if was_worn(ring) and not worn(ring)]

    def of(self, top: int) -> list[Ring]:
        """Return what a part goes round in the rest."""
        if top not in self._known:
            self._known.setdefault(top, self._found(top))
        return self._known[top]

    def _found(self, top: int) -> list[Ring]:
        parts, options, rest = self.parts, self.options, self.parts.poses[0]
        rings: list[Ring] = []
        if top in self.stiff:
            return rings
        for under in self._around(parts.vertices[top], top):
            both = solids(parts, top, under, 0)
            worn = worn_measure(*both, least=options.worn.worn, options=options.worn)
            if worn.share >= options.worn.worn:
                rings += _ring(parts, parts.vertices[top], (top, under), worn.axis, options)
        for hem in _hems(parts.triangles[top]):
            axis = np.linalg.svd(rest[hem] - rest[hem].mean(axis=0), full_matrices=False)[2][2]
            for under in self._around(hem, top):
                rings += _ring(parts, hem, (top, under), axis, options, through=options.through)
        known = {ring.under for ring in rings}
        beside = (under for under in self._beside(top) if under not in known)
        return rings + [ring for under in beside for ring in self._section(top, under)]

    def _beside(self, top: int) -> list[int]:
        """Return the parts with their middle in the box of one that may go round."""
        middle = 0.5 * (self._low + self._high)
        inside = ((self._low[top] < middle) & (middle < self._high[top])).all(axis=1)
        inside[[top, *self.stiff]] = False
        inside &= self._sheets[top]
        return np.flatnonzero(inside).tolist()

    def _section(self, top: int, under: int) -> list[Ring]:
        """Return as a ring what of a part is beside the middle of what it surrounds."""
        parts, options, rest = self.parts, self.options, self.parts.poses[0]
        both, least = solids(parts, top, under, 0), options.layers.around
        if (worn := surrounds(*both, least=least, options=options.worn)).share < least:
            return []
        ring, limb = (rest[parts.vertices[k]] @ worn.axis for k in (top, under))
        low, high = max(ring.min(), limb.min()), min(ring.max(), limb.max())
        own = parts.vertices[top][np.abs(ring - 0.5 * (low + high)) <= 0.25 * (high - low)]
        if len(own) < options.corners:
            return []
        return _ring(parts, own, (top, under), worn.axis, options)

    def _around(self, vertices: IntArray, top: int) -> list[int]:
        """Return the parts that have the middle of some vertices (N,) of another one inside."""
        rest = self.parts.poses[0]
        middle = 0.5 * (rest[vertices].min(axis=0) + rest[vertices].max(axis=0))
        holds = ((self._low < middle) & (self._high > middle)).all(axis=1)
        holds[[top, *self.stiff]] = False
        return [
            under
            for under in np.flatnonzero(holds).tolist()
            if self._goes_round(under, middle) >= self.options.enclosed
        ]

    def _goes_round(self, part: int, point: FloatArray) -> float:
        """Return how often a part goes round a point (3,) in the rest, whichever way it faces."""
        corners = self.parts.poses[0][self.parts.triangles[part]]
        # An arm is thinner than what of its body counts as one from afar.
        return abs(float(Dipoles(corners, self.options.cells).enclose_closely(point[None])[0]))


class _WornIn:
    """Which rings a pose (V, 3) has on; they are kept while it is asked."""

    def __init__(self, pose: FloatArray) -> None:
        self._pose, self._known = pose.copy(), dict[int, bool]()

    def __call__(self, ring: Ring) -> bool:
        """Return whether the pose has a ring on."""
        if id(ring) not in self._known:
            self._known[id(ring)] = ring.worn(self._pose)
        return self._known[id(ring)]


def _hems(faces: IntArray) -> list[IntArray]:
    """Return the vertices (N,) of each connected border of triangles (F, 3)."""
    lone = border_edges(faces, int(faces.max(initial=-1)) + 1)
    vertices, place = np.unique(faces.ravel()[lone], return_inverse=True)
    graph = sparse.coo_matrix(
        (np.ones(place.size // 2), place.reshape(-1, 2).T), shape=(len(vertices),) * 2
    )
    label = csgraph.connected_components(graph, directed=False)[1]
    hems = [vertices[label == index] for index in np.unique(label)]
    return [own for own in hems if len(own) > 2]


def _ring(
    parts: Parts,
    own: IntArray,
    both: tuple[int, int],
    axis: FloatArray,
    options: LoopOptions,
    *,
    through: float = 0.0,
) -> list[Ring]:
    """Return vertices (N,) of the first of two parts as a ring about an axis (3,).

    Nothing where the second one does not pass through it, by so many radii on one side.
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
    core = _core(limb[near], height[near] / radius, areas[near], len(rest), options)
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
    vertices: IntArray, height: FloatArray, areas: FloatArray, count: int, options: LoopOptions
) -> sparse.csr_matrix:
    """Return the matrix (M, V) that takes a pose to the middle line of some vertices (N,).

    height: where these are along the line (N,), in radii; areas: how much they count (N,).
    """
    low, high = float(height.min()), float(height.max())
    levels = np.linspace(low, high, 2 + int((high - low) * options.slices))
    rows = []
    for level in levels:
        own = np.flatnonzero(np.abs(height - level) < 1.0)
        weights = areas[own] * (1.0 - np.abs(height[own] - level))
        if weights.any():
            place = np.zeros(len(own), dtype=np.int32), own
            rows.append(sparse.csr_matrix((weights / weights.sum(), place), (1, len(height))))
    if len(rows) > 2:
        first = _ahead(rows[2], rows[0], height, low - options.ends)
        last = _ahead(rows[-3], rows[-1], height, high + options.ends)
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
