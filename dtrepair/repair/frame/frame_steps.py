"""What each frame of a window knows, and the work on one frame at a time."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray, lengths
from dtrepair.numerics.temporal import apply_in_time, undamped
from dtrepair.repair.elastic.edge_lengths import EdgeLengths
from dtrepair.repair.frame.adaptive_fairing import AdaptiveFairing
from dtrepair.repair.frame.frame_options import (
    Alone,
    Chain,
    FrameOptions,
    Levels,
    Springs,
    spring_matrix,
    springs_between,
)
from dtrepair.repair.frame.lending import Loan, borrowed, carried, cost, relaxed
from dtrepair.repair.frame.regional_push import regional_push
from dtrepair.repair.full.cure import cure
from dtrepair.repair.full.mend import mend
from dtrepair.repair.full.relax import Relaxation
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.surface.rigid_bodies import allowed
from dtrepair.repair.surface.surface import BoolArray, Surface


class WindowFrames:
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
        clearance: float,
        options: FrameOptions = FrameOptions(),
    ) -> None:
        """Take poses (T, V, 3) in units of the surface's size at times `frames` (T,)."""
        self.surface, self.original, self.options = surface, original, options
        self.alone, self.farthest, self.clearance = alone, farthest, clearance
        self.squared = (surface.uniform.T @ surface.uniform).tocsr()
        self.folds = AdaptiveFairing(surface, self.squared, frames, pool, options=options.folds)
        self.closes = AdaptiveFairing(surface, self.squared, frames, pool, options=options.closes)
        self.smooth, self.extra, self.poses, self.added = (
            pool.array(original.shape) for _ in range(4)
        )
        self.poses[:] = original
        # Poses of frames that were solved alone, where frames begin so.
        self.cold = pool.array(original.shape if surface.ties is not None else (0,))
        self._detected: dict[int, FloatArray] = {}
        self._pairs: dict[int, IntArray] = {}
        self._relaxations: dict[int, Relaxation] = {}
        self._farthest_pull: dict[int, FloatArray] = {}
        self._in_fold: dict[int, BoolArray] = {}

    def pairs(self, surface: Surface, frame: int) -> IntArray:
        """Return the pairs of a frame, found again if it moved since they were."""
        pose, before = self.poses[frame], self._detected.get(frame)
        if before is None or not np.abs(pose - before).max(initial=0.0) <= self.options.stale:
            close = self.clearance > 0.0
            found = (
                surface.contacts.close_pairs(pose, self.clearance)
                if close
                else surface.contacts.pairs(pose)
            )
            self._pairs[frame], self._detected[frame] = found, pose.copy()
        if frame not in self._in_fold:
            self._in_fold[frame] = self._around_folds(surface, self._pairs[frame])
        return self._pairs[frame]

    def forget_clearance(self) -> None:
        """Count only intersecting pairs from now on."""
        self.clearance = 0.0
        self._detected.clear()

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

    def solved(self, surface: Surface, frame: int) -> None:
        """Solve a frame alone, from its input; what it has to move by is in `added`."""
        self.cold[frame] = self.alone(surface, self.original[frame])
        self.added[frame] = self.cold[frame] - self.poses[frame]

    def left(self, surface: Surface, pose: FloatArray) -> int:
        """Return how many pairs of a pose (V, 3) count: intersecting, or closer than asked for."""
        if self.clearance > 0.0:
            return len(surface.contacts.close_pairs(pose, self.clearance))
        return len(surface.contacts.pairs(pose))

    def borrowed(self, surface: Surface, frame: int, step: float) -> None:
        """Take a neighbour's displacement instead, mended, where that moves the frame much less.

        Two frames that are nearly alike may be solved in unlike ways.
        """
        before, share = self.original[frame], self.options.borrow
        pairs, length = self.left(surface, self.cold[frame]), self._moved(frame)
        for other in (frame - 1, frame + 1):
            if not 0 <= other < len(self.cold) or self._moved(other) >= share * length:
                continue
            start = surface.rigid.fitted(before, before + self.cold[other] - self.original[other])
            pose = mend(surface, before, [start], step=step, options=self.options.mend)
            found, moved = self.left(surface, pose), float(lengths(pose - before).mean())
            if moved < share * length and found <= pairs:
                self.cold[frame], length, pairs = pose, moved, found
        self.added[frame] = self.cold[frame] - self.poses[frame]

    def _moved(self, frame: int) -> float:
        """Return how far a frame moved where it was solved alone, in the mean over the vertices."""
        return float(lengths(self.cold[frame] - self.original[frame]).mean())

    def returned(self, surface: Surface, frame: int, step: float) -> None:
        """Clean a frame near its place among its neighbours, or go back to where it was alone.

        As far back as there are as few pairs; what it has to move by is in `added`.
        """
        cold, now, before = self.cold[frame], self.poses[frame], self.original[frame]
        least = self.left(surface, cold)
        mended = mend(surface, before, [now], step=step, options=self.options.mend)
        near = np.linalg.norm(mended - now) < np.linalg.norm(cold - now)
        if near and self.left(surface, mended) <= least:
            self.added[frame] = mended - now
            return
        pose = cold
        for way in self.options.alone_shares:
            trial = surface.rigid.fitted(before, cold + way * (now - cold))
            if self.left(surface, trial) <= least:
                pose = trial
                break
        self.added[frame] = pose - now

    def mended(self, surface: Surface, chain: Chain, step: float, last: bool) -> None:
        """Solve neighbouring frames one by one; what they have to move by is in `added`.

        Each starts from where it is, then from the last one's correction, then from the
        displacements of the clean frames around the chain; `last`: then from its input.
        """
        options = self.options
        warm: FloatArray | None = None
        for frame in chain.frames:
            before, now = self.original[frame], self.poses[frame]
            starts = [now] if warm is None else [now, now + options.warm * warm]
            starts += [before + self.poses[k] - self.original[k] for k in chain.lenders]
            alone = self.alone if last else None
            mended = mend(surface, before, starts, step=step, alone=alone, options=options.mend)
            warm = mended - now
            self.added[frame] = warm

    def relaxed_alone(self, surface: Surface, frame: int) -> float:
        """Relax a clean frame by itself; its motion is in `added`. Return what it costs."""
        before, now = self.original[frame], self.poses[frame]
        pose = relaxed(surface, before, now, self.options.lending)
        self.added[frame] = pose - now
        return cost(surface, before, pose)

    def borrowed_from(self, surface: Surface, loan: Loan, scale: float) -> float:
        """Solve a frame from another's displacement; in `added` if it costs less. Return its cost.

        What lends to itself starts from its input.
        """
        frame, lender = loan.frame, loan.lender
        before, now = self.original[frame], self.poses[frame]
        start = before
        if lender != frame:
            moved = self.poses[lender] - self.original[lender]
            start = carried(surface, self.original[lender], before, moved)
        # A frame that has a pose is only asked whether another way out distorts it less.
        alone, options = None if np.isfinite(loan.cost) else self.alone, self.options.lending
        pose, value = borrowed(surface, before, start, scale=scale, alone=alone, options=options)
        if value < loan.cost:
            self.added[frame] = pose - now
        return min(value, loan.cost)

    def steadied(self, surface: Surface, frame: int, weights: FloatArray, step: float) -> bool:
        """Move a frame towards where its neighbours ask it to be, if a clean pose is there.

        weights: see `steady_weights`; the motion is in `added`. Returns whether it moves.
        """
        original, now, row = self.original, self.poses[frame], weights[frame]
        options = self.options
        used = np.flatnonzero(row)
        steady = original[frame] + sum(row[k] * (self.poses[k] - original[k]) for k in used)
        rough = np.linalg.norm(steady - now)
        for fraction in options.steady_fractions:
            start = surface.rigid.fitted(original[frame], now + fraction * (steady - now))
            pose = mend(surface, original[frame], [start], step=step, options=options.mend)
            pose = allowed(surface.rigid, original[frame], pose, self.farthest)
            better = np.linalg.norm(steady - pose) < options.steadier * rough
            if better and len(surface.contacts.pairs(pose)) == 0:
                self.added[frame] = pose - now
                return True
        return False

    def relaxing(
        self, surface: Surface, frame: int, reach: Levels, farthest: Levels, scale: float
    ) -> None:
        """Begin to relax a clean frame; `reach` (T, V) scales the motion of each vertex.

        farthest (T, V): how far it may be pulled from its input.
        """
        self._farthest_pull[frame] = farthest[frame].astype(np.float64)
        pose = self.poses[frame].copy()
        folds = len(surface.contacts.folds(pose))
        self._relaxations[frame] = Relaxation(
            surface,
            self.original[frame],
            pose,
            folds,
            reach[frame].astype(np.float64),
            scale,
            self.options.relax,
        )

    def relaxed(self, surface: Surface, frame: int, weight: float) -> float:
        """Relax a frame by a cycle, pulled to the displacement in `added`; it has its own after.

        weight: of that pull, next to the edges. The largest motion of a vertex is returned.
        """
        relaxation, before = self._relaxations[frame], self.original[frame]
        length, most = lengths(self.added[frame]), self._farthest_pull[frame]
        share = np.minimum(1.0, most / np.maximum(length, 1e-300))
        relaxation.system.hold(before + share[:, None] * self.added[frame], weight)
        points = relaxation.points
        relaxation.cycle()
        self.added[frame] = relaxation.points - before
        return float(lengths(relaxation.points - points).max(initial=0.0))

    def evened(self, surface: Surface, block: int, kernel: FloatArray) -> None:
        """Smooth `added` in time for a block of vertices."""
        own = self._vertices(block)
        self.added[:, own] = apply_in_time(kernel, self.added[:, own])

    def relaxation(self, surface: Surface, frame: int) -> None:
        """Put into `added` what relaxing moved a frame by, and forget how it got there."""
        self.added[frame] = self._relaxations.pop(frame).points - self.poses[frame]
        del self._farthest_pull[frame]

    def cured(self, surface: Surface, frame: int) -> None:
        """Bring edges of a clean frame back that are crushed or drawn out, into `added`."""
        before, pose = self.original[frame], self.poses[frame]
        lengths = EdgeLengths(surface, before, options=self.options.edges)
        folds = len(surface.contacts.folds(pose))
        points, _ = cure(lengths, before, pose, folds=folds, options=self.options.cure)
        self.added[frame] = allowed(surface.rigid, before, points, self.farthest) - pose

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
