"""What each frame of a window knows: how its pose is made, its pairs, and its push."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray, differing
from dtrepair.numerics.temporal import apply_in_time, undamped
from dtrepair.repair.frame.adaptive_fairing import AdaptiveFairing
from dtrepair.repair.frame.frame_options import (
    Alone,
    FrameOptions,
    Springs,
    spring_matrix,
    springs_between,
)
from dtrepair.repair.frame.regional_push import regional_push
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.surface.defects import update_pairs
from dtrepair.repair.surface.rigid_bodies import allowed
from dtrepair.repair.surface.surface import BoolArray, Surface


class FramePoses:
    """The frames of one window; a pool calls the methods that take a surface and a frame.

    Arrays that all workers see: `original`, `smooth`, `extra` (T, V, 3) make the poses (see
    `WindowState`), `poses` are those, `added` takes what a call has to give for each frame.
    """

    def __init__(
        self,
        surface: Surface,
        original: FloatArray,
        frames: FloatArray,
        pool: WorkerPool,
        *,
        alone: Alone,
        farthest: float | None,
        options: FrameOptions = FrameOptions(),
    ) -> None:
        """Take poses (T, V, 3) in units of the surface's size at times `frames` (T,)."""
        self.surface, self.options = surface, options
        self.alone, self.farthest = alone, farthest
        self.squared = (surface.uniform.T @ surface.uniform).tocsr()
        self.folds = AdaptiveFairing(surface, self.squared, frames, pool, options=options.folds)
        self.closes = AdaptiveFairing(surface, self.squared, frames, pool, options=options.closes)
        self.original, self.smooth, self.extra, self.poses, self.added = (
            pool.array(original.shape) for _ in range(5)
        )
        self.original[:] = self.poses[:] = original
        # Poses of frames that were solved alone, where frames begin so.
        self.cold = pool.array(original.shape if surface.ties is not None else (0,))
        self._detected: dict[int, FloatArray] = {}
        self._pairs: dict[int, IntArray] = {}
        self._in_fold: dict[int, BoolArray] = {}

    def pairs(self, surface: Surface, frame: int) -> IntArray:
        """Return the pairs of a frame, found again if it moved since they were."""
        pose, before = self.poses[frame], self._detected.get(frame)
        if before is None or not np.abs(pose - before).max(initial=0.0) <= self.options.stale:
            self._pairs[frame] = self._found(surface, frame, before)
            self._detected[frame] = pose.copy()
        if frame not in self._in_fold:
            self._in_fold[frame] = self._around_folds(surface, self._pairs[frame])
        return self._pairs[frame]

    def _found(self, surface: Surface, frame: int, before: FloatArray | None) -> IntArray:
        """Return the pairs of a frame, sorted; before: the pose (V, 3) whose pairs are known."""
        pose = self.poses[frame]
        if before is None:
            return surface.contacts.pairs(pose)
        active = surface.triangles_at(differing(pose, before))
        found = update_pairs(surface, self._pairs[frame], pose, active)
        return found[np.lexsort((found[:, 1], found[:, 0]))]

    def evaluated(self, surface: Surface, frame: int) -> IntArray:
        """Make the pose of a frame from the unknowns; its pairs."""
        self.closes.settle(frame)
        self.folds.settle(frame)
        moved = self.closes(frame, self.smooth[frame])
        shape = self.folds(frame, self.original[frame] + moved) + self.extra[frame]
        self.poses[frame] = allowed(surface.rigid, self.original[frame], shape, self.farthest)
        return self.pairs(surface, frame)

    def pushed(self, surface: Surface, frame: int, step: float) -> Springs:
        """Push a frame into `added`; raise the levels of near contacts; the springs they ask for.

        Springs are numbers i x V + j of two vertices.
        """
        pairs = self._pairs[frame]
        far, springs = self._classified(surface, frame, pairs)
        if far.any():
            self.added[frame] = regional_push(
                surface, self.poses[frame], pairs, far, step=step, options=self.options.push
            )
        return springs

    def evened(self, surface: Surface, block: int, kernel: FloatArray) -> None:
        """Smooth `added` in time for a block of vertices."""
        own = self._vertices(block)
        self.added[:, own] = apply_in_time(kernel, self.added[:, own])

    def smoothed(self, surface: Surface, block: int, kernel: FloatArray) -> None:
        """Smooth `added` in time for a block of vertices, and add it to `smooth`."""
        own = self._vertices(block)
        self.added[:, own] = undamped(kernel, self.added[:, own])
        self.smooth[:, own] += self.added[:, own]

    def corrected(self, surface: Surface, block: int, kernel: FloatArray) -> None:
        """Smooth `added` in time for a block of vertices, and add it to `extra`."""
        own = self._vertices(block)
        self.extra[:, own] += undamped(kernel, self.added[:, own])

    def leveled(self, surface: Surface, block: int) -> None:
        """Set the levels of fairing of a block of vertices."""
        own = self._vertices(block)
        self.folds.update(self.options.fade, own)
        self.closes.update(self.options.fade, own)

    @property
    def blocks(self) -> int:
        """How many blocks of vertices there are: what is done in time is done by them."""
        return -(-self.surface.count // self.options.block)

    def _vertices(self, block: int) -> slice:
        size = self.options.block
        return slice(block * size, min((block + 1) * size, self.surface.count))

    def pairs_of_added(self, surface: Surface, frame: int) -> IntArray:
        """Return the intersecting pairs of the pose in `added`."""
        return surface.contacts.pairs(self.added[frame])

    def couple(self, springs: Springs) -> None:
        """Fair close contacts with these springs between vertices from now on."""
        matrix = spring_matrix(springs, self.surface.count)
        self.closes.replace_matrix(self.squared + self.options.spring * matrix)

    def _around_folds(self, surface: Surface, pairs: IntArray) -> BoolArray:
        """Return the triangles (F,) within a ring of the input's own folds."""
        near = surface.contacts.ring_distance(pairs) <= self.options.fold_rings
        return surface.triangles_at(surface.vertices_of(pairs[near]))

    def _classified(
        self, surface: Surface, frame: int, pairs: IntArray
    ) -> tuple[BoolArray, Springs]:
        """Raise the levels of near contacts; which pairs (K,) are to be pushed, and springs."""
        near = surface.contacts.ring_distance(pairs) <= self.options.fold_rings
        own_fold = self._in_fold[frame][pairs].any(axis=1)
        # Two bodies that are always close, as a sleeve and its arm, are pushed like any others.
        owner = surface.body_of[pairs]
        close = self._always_close(pairs) & ~own_fold & (owner[:, 0] == owner[:, 1])
        fold = near & own_fold
        corners = surface.faces[pairs].reshape(-1, 6)
        hard_fold = (
            self.folds.levels(frame)[corners].max(axis=1, initial=0.0) >= self.options.fold_pushed
        )
        hard_close = (
            self.closes.levels(frame)[corners].max(axis=1, initial=0.0) >= self.options.close_pushed
        )
        springs: Springs = np.zeros(0, dtype=np.int64)
        if fold.any():
            self.folds.hit(frame, surface.vertices_of(pairs[fold]))
        if close.any():
            springs = springs_between(surface, self.original[frame], pairs[close])
            touched = surface.vertices_of(pairs[close])
            self.closes.hit(frame, touched)
            stubborn = touched & (self.closes.hits[frame] > self.options.stubborn)
            if stubborn.any():
                self.folds.hit(frame, stubborn)
        return ~(close | fold) | (fold & hard_fold) | (close & hard_close), springs

    def _always_close(self, pairs: IntArray) -> BoolArray:
        """Return which pairs (K,) are close in the rest pose and in samples of the input."""
        samples = np.linspace(0, len(self.original) - 1, self.options.samples).astype(int)
        close = np.ones(len(pairs), dtype=bool)
        for points in (self.surface.rest, *self.original[np.unique(samples)]):
            first, second = (points[self.surface.faces[pairs[:, k]]].mean(axis=1) for k in (0, 1))
            close &= np.linalg.norm(first - second, axis=1) < self.options.close
        return close
