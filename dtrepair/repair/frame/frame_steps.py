"""The work on one frame of a window at a time, after the push."""

from __future__ import annotations

from typing import Any

import numpy as np

from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.numerics.work import work_done
from dtrepair.repair.elastic.edge_lengths import EdgeLengths
from dtrepair.repair.frame.frame_options import Chain, Levels
from dtrepair.repair.frame.frame_poses import FramePoses
from dtrepair.repair.frame.lending import Loan, carried, cost, relaxed, solved_from
from dtrepair.repair.full.cure import cure
from dtrepair.repair.full.mend import mend
from dtrepair.repair.full.relax import Relaxation
from dtrepair.repair.full.steering import Steering
from dtrepair.repair.surface.rigid_bodies import allowed
from dtrepair.repair.surface.surface import Surface


class WindowFrames(FramePoses):
    """What solves, relaxes, steadies and cures single frames of a window."""

    def __init__(self, *given: Any, **named: Any) -> None:
        """Take what `FramePoses` takes."""
        super().__init__(*given, **named)
        phases = self.options.lending.phases
        self._steering = Steering(self.surface, options=phases.steering)
        self._relaxations: dict[int, Relaxation] = {}
        self._farthest_pull: dict[int, FloatArray] = {}

    def solved(self, surface: Surface, frame: int) -> None:
        """Solve a frame alone, from its input; what it has to move by is in `added`."""
        self.cold[frame] = self.alone(surface, self.original[frame])
        self.added[frame] = self.cold[frame] - self.poses[frame]

    def left(self, surface: Surface, pose: FloatArray) -> int:
        """Return how many pairs of a pose (V, 3) count."""
        return len(surface.contacts.pairs(pose))

    def borrowed(self, surface: Surface, frame: int, step: float) -> None:
        """Take a neighbour's displacement instead, mended, where that moves the frame much less.

        Or where it leaves less: two frames that are nearly alike may be solved in unlike ways.
        """
        before, share = self.original[frame], self.options.borrow
        pairs, length = self._cold_pairs(surface, frame), self._moved(frame)
        for other in (frame - 1, frame + 1):
            if not 0 <= other < len(self.cold):
                continue
            if self._moved(other) >= share * length:
                if not pairs or self._cold_pairs(surface, other) >= pairs:
                    continue
            start = surface.rigid.fitted(before, before + self.cold[other] - self.original[other])
            pose = mend(surface, before, [start], step=step, most=pairs, options=self.options.mend)
            pose = allowed(surface.rigid, before, pose, self.farthest)
            found, moved = self.left(surface, pose), float(lengths(pose - before).mean())
            if found < pairs or (moved < share * length and found == pairs):
                self.cold[frame], length, pairs = pose, moved, found
        self.added[frame] = self.cold[frame] - self.poses[frame]

    def _cold_pairs(self, surface: Surface, frame: int) -> int:
        """Return how many pairs a frame has that was solved alone."""
        return self.left(surface, self.cold[frame])

    def _moved(self, frame: int) -> float:
        """Return how far a frame moved where it was solved alone, in the mean over the vertices."""
        return float(lengths(self.cold[frame] - self.original[frame]).mean())

    def returned(self, surface: Surface, frame: int, step: float) -> None:
        """Clean a frame near its place among its neighbours, or go back to where it was alone.

        As far back as there are as few pairs; what it has to move by is in `added`.
        """
        cold, now, before = self.cold[frame], self.poses[frame], self.original[frame]
        least = self.left(surface, cold)
        mended = mend(surface, before, [now], step=step, most=least, options=self.options.mend)
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

    def mended(self, surface: Surface, chain: Chain, step: float, last: bool) -> float:
        """Solve neighbouring frames one by one; what they have to move by is in `added`.

        Each starts from where it is, then from the last one's correction, then from the
        displacements of the clean frames around the chain; `last`: then from its input. Return
        the work done.
        """
        before_work = work_done()
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
        return work_done() - before_work

    def relaxed_alone(self, surface: Surface, frame: int) -> float:
        """Relax a clean frame by itself; its motion is in `added`. Return what it costs."""
        before, now = self.original[frame], self.poses[frame]
        pose = relaxed(surface, before, now, self._steering, self.options.lending)
        self.added[frame] = pose - now
        return cost(surface, before, pose, self._steering)

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
        pose, value = solved_from(
            surface,
            before,
            start,
            scale=scale,
            alone=alone,
            steering=self._steering,
            options=options,
        )
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
        """Begin to relax a frame, which keeps its pairs if it has any.

        reach (T, V): scales the motion of each vertex; farthest (T, V): how far it may be pulled
        from its input.
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
            self._steering,
            crossings=len(surface.contacts.pairs(pose)),
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

    def relaxation(self, surface: Surface, frame: int) -> None:
        """Put into `added` what relaxing moved a frame by, and forget how it got there."""
        self.added[frame] = self._relaxations.pop(frame).points - self.poses[frame]
        del self._farthest_pull[frame]

    def cured(self, surface: Surface, frame: int) -> None:
        """Bring edges of a frame back that are crushed or drawn out, into `added`."""
        before, pose = self.original[frame], self.poses[frame]
        lengths = EdgeLengths(surface, before, options=self.options.edges)
        folds = len(surface.contacts.folds(pose))
        left, options = len(surface.contacts.pairs(pose)), self.options.cure
        points, _ = cure(lengths, before, pose, folds=folds, crossings=left, options=options)
        self.added[frame] = allowed(surface.rigid, before, points, self.farthest) - pose
