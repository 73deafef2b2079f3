"""Fairing of creases with a strength per vertex: smooth in time where the strength is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.temporal import apply_in_time, gaussian_kernel, spread_in_time
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.surface.surface import BoolArray, Surface

Levels = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True)
class FairingOptions:
    """Levels of fairing: a level of e holds a vertex in its place with the weight 10 ** (hold - e).

    Args:
        first: Level of a vertex that is hit for the first time; each other hit raises it by 1.
        highest: Highest level that acts; beyond it nothing holds a vertex.
        memory: Hits are counted up to so far beyond the highest, so that they take as long to fall.
        hold: Level at which that weight is 1, which about balances place and smoothness.
        faint: Levels below this leave a vertex alone.
        slight: A frame without a level above this is not faired at all, which saves its solve.
        width: Of the smoothing in time of levels after they were spread, frames.
        unchanged: Changes of a level below this keep the patch of the frame.
    """

    first: float
    highest: float
    memory: float = 2.0
    hold: float = 4.0
    faint: float = 0.05
    slight: float = 0.3
    width: float = 1.5
    unchanged: float = 0.02


class Patch(NamedTuple):
    """Vertices that are faired, their system and the operator's rows."""

    vertices: IntArray
    system: sparse.csc_matrix
    rows: sparse.csr_matrix


def _solve(matrix: sparse.csc_matrix, right_hand_side: FloatArray) -> FloatArray:
    # The factor, which would be used about twice, is not kept: SuperLU holds many times the memory
    # that it needs. cholespy loses some with every factor that has solved.
    factor = linalg.splu(
        matrix,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    solution: FloatArray = factor.solve(np.ascontiguousarray(right_hand_side))
    return solution


class AdaptiveFairing:
    """Levels (T, V) at which each frame's surroundings of a crease are faired.

    A hit raises the level; levels fade over time as bells and over the mesh by one a ring, so the
    result changes smoothly from frame to frame: nothing switches. What frames share is in arrays of
    the pool; patches and settled levels are known to the worker that has the frame.
    """

    def __init__(
        self,
        surface: Surface,
        matrix: sparse.csr_matrix,
        frames: FloatArray,
        pool: WorkerPool,
        *,
        options: FairingOptions,
    ) -> None:
        """Fair with a squared operator (V, V) over times `frames` (T,) in frame units."""
        self.surface, self.matrix, self.frames = surface, matrix, frames
        self.options = options
        shape = (len(frames), surface.count)
        self.hits: Levels = pool.array(shape, np.float32)
        self._wanted: Levels = pool.array(shape, np.float32)
        self._levels: dict[int, Levels] = {}
        self._patches: dict[int, Patch | None] = {}
        self._settled: dict[int, Levels] = {}
        self._solved: dict[int, tuple[Patch, FloatArray, FloatArray]] = {}

    def __call__(self, frame: int, field: FloatArray) -> FloatArray:
        """Return the field (V, 3) faired in a frame: least sum |L z|^2 + weight |z - field|^2.

        Frames whose patch and surroundings are as they were keep their last solution.
        """
        patch = self.patch(frame)
        if patch is None:
            return field
        right = patch.rows @ field
        known = self._solved.get(frame)
        if known is None or known[0] is not patch or not np.array_equal(known[1], right):
            known = patch, right, _solve(patch.system, right)
            self._solved[frame] = known
        result = field.copy()
        result[patch.vertices] -= known[2]
        return result

    def hit(self, frame: int, vertices: BoolArray) -> None:
        """Raise the level of vertices (V,) of a frame."""
        hits, options = self.hits[frame], self.options
        hits[vertices] = np.where(hits[vertices] == 0, options.first, hits[vertices] + 1.0)
        np.minimum(hits, options.highest + options.memory, out=hits)

    def replace_matrix(self, matrix: sparse.csr_matrix) -> None:
        """Fair with another operator from now on."""
        self.matrix = matrix
        self._patches.clear()

    def update(self, width: float, vertices: slice) -> None:
        """Set the levels of a range of vertices from their hits, over a `width` in frames."""
        touched = vertices.start + np.flatnonzero(self.hits[:, vertices].max(axis=0) > 0)
        self._wanted[:, vertices] = 0.0
        if len(touched):
            spread = spread_in_time(self.frames, self.hits[:, touched], width)
            kernel = gaussian_kernel(self.frames, self.options.width).astype(np.float32)
            self._wanted[:, touched] = apply_in_time(kernel, spread)

    def settle(self, frame: int) -> None:
        """Spread the new levels of a frame over the mesh; a change asks for a new patch."""
        if np.array_equal(self._settled.get(frame, ()), self._wanted[frame]):
            return
        wanted = self._wanted[frame].copy()
        self._settled[frame] = self._wanted[frame].copy()
        if wanted.max() > 0:
            wanted = np.minimum(spread_rings(self.surface, wanted), self.options.highest)
            wanted[self.surface.stiff] = 0.0
        if np.abs(wanted - self.levels(frame)).max() > self.options.unchanged:
            self._patches.pop(frame, None)
            self._levels[frame] = wanted

    def levels(self, frame: int) -> Levels:
        """Return the levels (V,) of a frame."""
        if frame not in self._levels:
            self._levels[frame] = np.zeros(self.surface.count, dtype=np.float32)
        return self._levels[frame]

    def patch(self, frame: int) -> Patch | None:
        """Return what a frame has to solve; None where nothing is faired."""
        if frame not in self._patches:
            self._patches[frame] = self._factored(self.levels(frame))
        return self._patches[frame]

    def _factored(self, level: NDArray[np.float32]) -> Patch | None:
        options = self.options
        if level.max(initial=0.0) <= options.slight:
            return None
        inner = np.flatnonzero(level > options.faint).astype(np.int32)
        rows = self.matrix[inner]
        hold = sparse.diags(10.0 ** (options.hold - level[inner].astype(np.float64)))
        if self.surface.offsets is not None:
            hold = hold + self.surface.offsets[inner][:, inner]
        return Patch(inner, sparse.csc_matrix(rows[:, inner] + hold), rows)


def spread_rings(surface: Surface, level: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the levels (V,) spread over the mesh, one less for each ring."""
    level = level.copy()
    front = np.flatnonzero(level > 1.0)
    while len(front):
        starts, counts = surface.indptr[front], np.diff(surface.indptr)[front]
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        around = surface.indices[np.repeat(starts, counts) + within]
        offered = np.repeat(level[front] - 1.0, counts)
        higher = offered > level[around]
        around, offered = around[higher], offered[higher]
        np.maximum.at(level, around, offered)
        raised = np.unique(around)
        front = raised[level[raised] > 1.0]
    return level
