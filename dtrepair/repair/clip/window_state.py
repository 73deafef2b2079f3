"""Many frames at once: displacements that are smooth in time by construction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.temporal import easing_weights, spread_in_time
from dtrepair.repair.frame.frame_options import Alone, Chain, FrameOptions, Springs
from dtrepair.repair.frame.frame_steps import WindowFrames
from dtrepair.repair.frame.lending import Loan
from dtrepair.repair.full.settle import leaning
from dtrepair.repair.parallel.worker_pool import Told, WorkerPool
from dtrepair.repair.surface.defects import contact_scale
from dtrepair.repair.surface.surface import Surface

Levels = NDArray[np.float32]


class Snapshot(NamedTuple):
    """Everything that a sweep changes."""

    smooth: FloatArray
    extra: FloatArray
    fold_hits: Levels
    close_hits: Levels
    springs: Springs


class WindowState:
    """The frames of one window on their way to be clean.

    Unknowns Q (T, V, 3) with displacement D = K Q, K a Gaussian in time: `smooth` holds D. Each
    frame's pose is its input moved by D, faired around close contacts, faired around folds,
    plus `extra`, the corrections of single frames. Frames are worked on by a pool.
    """

    def __init__(
        self,
        surface: Surface,
        original: FloatArray,
        frames: FloatArray,
        pool: WorkerPool,
        *,
        alone: Alone,
        farthest: float | None = None,
        options: FrameOptions = FrameOptions(),
    ) -> None:
        """Take poses (T, V, 3) in units of the surface's size at times `frames` (T,).

        alone: the solver of single frames; farthest: no vertex moves farther.
        """
        self.surface, self.frames, self.pool = surface, frames, pool
        self.work = WindowFrames(
            surface,
            original,
            frames,
            pool,
            alone=alone,
            farthest=farthest,
            options=options,
        )
        # Frames that no solver could clean must not keep the others from being tightened.
        self.given_up: frozenset[int] = frozenset()
        self.springs: Springs = np.zeros(0, dtype=np.int64)
        pool.start(self.work)
        self.pairs: list[IntArray] = pool.map("pairs", self._every)
        # Those of what displacements are counted from.
        self.found = self.pairs
        self.scale = contact_scale(surface, np.concatenate(self.pairs))

    @property
    def original(self) -> FloatArray:
        """The poses (T, V, 3) that displacements are counted from."""
        return self.work.original

    @property
    def leaning(self) -> bool:
        """Whether bodies that move freely meet in what displacements are counted from.

        Or may, where nothing meets there: what was lifted lay over what it was lifted off.
        """
        if self.surface.clusters == 1:
            return False
        met = [leaning(self.surface, pairs) for pairs in self.found if len(pairs)]
        return not met or any(met)

    @property
    def _every(self) -> range:
        return range(len(self.original))

    @property
    def _blocks(self) -> range:
        return range(self.work.blocks)

    @property
    def poses(self) -> FloatArray:
        """The poses (T, V, 3) now."""
        return self.work.poses

    @property
    def dirty(self) -> list[int]:
        """Frames with pairs left, but for those given up."""
        found = (frame for frame, pairs in enumerate(self.pairs) if len(pairs))
        return [frame for frame in found if frame not in self.given_up]

    @property
    def remaining(self) -> int:
        """Pairs left in the dirty frames."""
        return sum(len(self.pairs[frame]) for frame in self.dirty)

    def tell_progress(self, fraction: float) -> None:
        """Tell who wants to know that this fraction of the work on the window is done."""
        if self.pool.progress is not None:
            self.pool.progress(min(fraction, 1.0) * len(self.original))

    def _between(self, start: float, end: float) -> Told:
        """Return what tells how far the work on the window is, by shares of a stretch of it."""
        return lambda share: self.tell_progress(start + (end - start) * share)

    def place(self, poses: FloatArray) -> None:
        """Start from poses (T, V, 3), before anything else was done."""
        self.work.extra[:] = poses - self.original
        self.evaluate()

    def count_from(self, original: FloatArray) -> None:
        """Count displacements from other poses (T, V, 3) from now on; those that are found stay."""
        self.found = self.pairs_of(original, list(self._every))
        # Longer steps than contacts of the inputs allow would lead through what is thin.
        self.scale = min(self.scale, contact_scale(self.surface, np.concatenate(self.found)))
        self.work.extra[:] = self.poses - original
        self.work.smooth[:], self.work.original[:] = 0.0, original
        self.work.folds.hits[:] = self.work.closes.hits[:] = 0
        self._update()

    def evaluate(self) -> None:
        """Make the poses from the unknowns, and find their pairs."""
        self.pairs = self.pool.map("evaluated", self._every)

    def sweep(self, kernel: FloatArray, step: float) -> FloatArray:
        """Push and fair once; the displacement that the push added (T, V, 3), until the next."""
        self.work.added[:] = 0.0
        springs = [self.springs, *self.pool.map("pushed", self.dirty, self.scale * step)]
        wanted = np.unique(np.concatenate(springs))
        if len(wanted) > len(self.springs):
            self._couple(wanted)
        self.pool.map("smoothed", self._blocks, kernel)
        self._update()
        return self.work.added

    def solve_alone(self, kernel: FloatArray, step: float, *, work: float = 1.0) -> None:
        """Solve the dirty frames each for itself, and smooth that in time as far as it is clean.

        step: largest motion in an iteration where they are cleaned again, units of the size; work:
        fraction of the usual work on a window that this is, for the progress that is told.
        """
        self.work.added[:], self.work.cold[:] = 0.0, self.original
        dirty, step = self.dirty, self.scale * step
        solved, borrowed = 0.7 * work, 0.85 * work
        self.pool.map("solved", dirty, told=self._between(0.0, solved))
        # Neighbours in turn, so that none looks at a frame that is being changed.
        for parity in (0, 1):
            half = [frame for frame in dirty if frame % 2 == parity]
            start, end = np.linspace(solved, borrowed, 3)[parity : parity + 2].tolist()
            self.pool.map("borrowed", half, step, told=self._between(start, end))
        self.pool.map("evened", self._blocks, kernel)
        self.work.extra += self.work.added
        self.evaluate()
        self.work.added[:] = 0.0
        self.pool.map("returned", self.dirty, step, told=self._between(borrowed, work))
        self.work.extra += self.work.added
        self.evaluate()
        self.tell_progress(work)

    def relax_alone(self) -> FloatArray:
        """Relax the clean frames each for itself; what they cost (T,), not a number for others."""
        self.work.added[:] = 0.0
        clean = [frame for frame, pairs in enumerate(self.pairs) if len(pairs) == 0]
        costs = np.full(len(self.original), np.nan)
        costs[clean] = self.pool.map("relaxed_alone", clean)
        self.work.extra += self.work.added
        self.evaluate()
        return costs

    def lend(self, loans: list[Loan], costs: FloatArray) -> None:
        """Solve frames from the displacements of others, where that costs less; change `costs`."""
        self.work.added[:] = 0.0
        found = self.pool.map("borrowed_from", loans, self.scale)
        for loan, value in zip(loans, found, strict=True):
            costs[loan.frame] = value
        self.work.extra += self.work.added
        self.evaluate()

    def mend(
        self, chains: list[Chain], kernel: FloatArray, step: float, *, last: bool = False
    ) -> float:
        """Solve chains of neighbouring frames one by one, and spread their corrections in time.

        last: frames that stay dirty are solved alone, from the input's pose. Return the work done
        on the frames, see `numerics.work`.
        """
        self.work.added[:] = 0.0
        done = self.pool.map("mended", chains, self.scale * step, last)
        self.pool.map("corrected", self._blocks, kernel)
        self.evaluate()
        return float(sum(done))

    def steady(self, frames: list[int], weights: FloatArray, step: float) -> int:
        """Steady some frames, none within two of another; how many moved.

        weights (T, T): see `steady_weights`.
        """
        self.work.added[:] = 0.0
        moved = self.pool.map("steadied", frames, weights, self.scale * step)
        self.work.extra += self.work.added
        self.evaluate()
        return sum(moved)

    def relax(
        self,
        frames: list[int],
        reach: NDArray[np.float32],
        agreement: Sequence[float],
        *,
        still: float,
        spread: float,
        work: tuple[float, float] | None = None,
    ) -> None:
        """Relax clean frames in step, until no vertex moves farther than `still` in a cycle.

        reach (T, V): what takes part; agreement: for each cycle, the weight by which frames are
        pulled to where the others ask them to be (see `easing_weights`), but no farther than what
        is displaced now, fading as a bell of `spread` frames: else displacements would creep into
        frames that need none. work: fractions of the usual work on a window that are done before
        and after, for the progress that is told; None: nothing is told.
        """
        moved, others = self.work.added, np.setdiff1d(self._every, frames)
        moved[:] = self.poses - self.original
        # Halfway between where a frame is and where it should be: all of them move at a time.
        needless = np.array([len(pairs) == 0 for pairs in self.found])
        # Attached parts swing far beyond what others of a frame need that is faulty itself.
        level = self.surface.ties is not None
        asked = easing_weights(self.frames, needless, level=level)
        halfway = 0.5 * (np.eye(len(self.frames)) + asked)
        if len(self.frames) < 3:
            halfway = np.eye(len(self.frames))
        length = np.linalg.norm(moved, axis=2).astype(np.float32)
        farthest = spread_in_time(self.frames, length, spread)
        self.pool.map("relaxing", frames, reach, farthest, self.scale)
        for cycle, weight in enumerate(agreement):
            self.pool.map("evened", self._blocks, halfway)
            told = None
            if work is not None:
                start, end = np.linspace(*work, len(agreement) + 1)[cycle : cycle + 2].tolist()
                told = self._between(start, end)
            largest = self.pool.map("relaxed", frames, weight, told=told)
            moved[others] = self.poses[others] - self.original[others]
            if max(largest, default=0.0) < still:
                break
        moved[:] = 0.0
        self.pool.map("relaxation", frames)
        self.work.extra += moved
        self.evaluate()

    def cure(self, frames: list[int], kernel: FloatArray) -> None:
        """Cure crushed edges of frames; what that moves is smoothed in time where it can be.

        Where that gives a frame pairs which it did not have, it moves by itself.
        """
        self.work.added[:], pairs = 0.0, self.pairs
        self.pool.map("cured", frames)
        own, before = self.work.added.copy(), self.work.extra.copy()
        self.pool.map("corrected", self._blocks, kernel)
        self.evaluate()
        if failed := [frame for frame in self.dirty if len(self.pairs[frame]) > len(pairs[frame])]:
            self.work.extra[failed] = before[failed] + own[failed]
            self.evaluate()

    def restore(self, state: Snapshot) -> None:
        """Go on from another state."""
        self.work.smooth[:], self.work.extra[:] = state.smooth, state.extra
        self.work.folds.hits[:], self.work.closes.hits[:] = state.fold_hits, state.close_hits
        if len(state.springs) != len(self.springs):
            self._couple(state.springs)
        self._update()

    def pairs_of(self, poses: FloatArray, frames: list[int]) -> list[IntArray]:
        """Return the intersecting pairs of some frames of other poses (T, V, 3)."""
        self.work.added[:] = poses
        return self.pool.map("pairs_of_added", frames)

    def snapshot(self) -> Snapshot:
        """Return the state now."""
        work, hits = self.work, (self.work.folds.hits.copy(), self.work.closes.hits.copy())
        return Snapshot(work.smooth.copy(), work.extra.copy(), *hits, self.springs)

    def _couple(self, springs: Springs) -> None:
        self.springs = springs
        self.pool.tell("couple", springs)

    def _update(self) -> None:
        self.pool.map("leveled", self._blocks)
        self.evaluate()
