"""Many frames at once: displacements that are smooth in time by construction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtrepair.geometry import FloatArray, IntArray
from dtrepair.repair.contact import contact_scale
from dtrepair.repair.crew import Crew
from dtrepair.repair.surface import Surface
from dtrepair.repair.window_frames import Alone, Springs, WindowFrames

Levels = NDArray[np.float32]


class Snapshot(NamedTuple):
    """Everything that a sweep changes."""

    smooth: FloatArray
    extra: FloatArray
    fold_hits: Levels
    close_hits: Levels


class SpaceTime:
    """The frames of one window on their way to be clean.

    Unknowns Q (T, V, 3) with displacement D = K Q, K a Gaussian in time: `smooth` holds D. Each
    frame's pose is its input moved by D, softened around close contacts, softened around folds,
    plus `extra`, the corrections of single frames. Frames are worked on by a crew.
    """

    def __init__(
        self,
        surface: Surface,
        original: FloatArray,
        frames: FloatArray,
        crew: Crew,
        *,
        alone: Alone,
        farthest: float | None = None,
        clearance: float = 0.0,
    ) -> None:
        """Take poses (T, V, 3) in units of the surface's size at times `frames` (T,).

        alone: the solver of single frames; farthest: no vertex moves farther; clearance: closer
        pairs count, as long as it is set.
        """
        self.surface, self.original, self.frames, self.crew = surface, original, frames, crew
        self.work = WindowFrames(
            surface, original, frames, crew, alone=alone, farthest=farthest, clearance=clearance
        )
        # Frames that no solver could clean must not keep the others from being tightened.
        self.given_up: frozenset[int] = frozenset()
        self.springs: Springs = np.zeros(0, dtype=np.int64)
        crew.start(self.work)
        self.pairs: list[IntArray] = crew.map("pairs", self._every)
        self.scale = contact_scale(surface, np.concatenate(self.pairs))

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

    def forget_clearance(self) -> None:
        """From now on only intersecting pairs count."""
        if self.work.clearance > 0.0:
            self.crew.tell("forget_clearance")
            self.pairs = self.crew.map("pairs", self._every)

    def evaluate(self) -> None:
        """Poses from the unknowns, and their pairs."""
        self.pairs = self.crew.map("evaluated", self._every)

    def sweep(self, kernel: FloatArray, width: float, step: float) -> FloatArray:
        """Push and soften once; the displacement that the push added (T, V, 3), until the next."""
        self.work.added[:] = 0.0
        springs = [self.springs, *self.crew.map("pushed", self.dirty, self.scale * step)]
        wanted = np.unique(np.concatenate(springs))
        if len(wanted) > len(self.springs):
            self.springs = wanted
            self.crew.tell("couple", wanted)
        self.crew.map("smoothed", self._blocks, kernel)
        self._update(max(width, 2.0))
        return self.work.added

    def mend(self, chains: list[list[int]], kernel: FloatArray, step: float) -> None:
        """Solve chains of neighbouring frames one by one, and spread their corrections in time."""
        self.work.added[:] = 0.0
        self.crew.map("mended", chains, self.scale * step)
        self.crew.map("corrected", self._blocks, kernel)
        self.evaluate()

    def set(
        self, smooth: FloatArray, extra: FloatArray, hits: tuple[Levels, Levels], width: float
    ) -> None:
        """Go on from other unknowns and hits."""
        self.work.smooth[:], self.work.extra[:] = smooth, extra
        self.work.folds.hits[:], self.work.closes.hits[:] = hits
        self._update(width)

    def pairs_of(self, poses: FloatArray, frames: list[int]) -> list[IntArray]:
        """Intersecting pairs of some frames of other poses (T, V, 3)."""
        self.work.added[:] = poses
        return self.crew.map("pairs_of_added", frames)

    def snapshot(self) -> Snapshot:
        """The state now."""
        work, hits = self.work, (self.work.folds.hits.copy(), self.work.closes.hits.copy())
        return Snapshot(work.smooth.copy(), work.extra.copy(), *hits)

    def restore(self, state: Snapshot, width: float) -> None:
        """Go back to a state."""
        hits = state.fold_hits, state.close_hits
        self.set(state.smooth, state.extra, hits, max(width, 2.0))

    def _update(self, width: float) -> None:
        self.crew.map("leveled", self._blocks, width)
        self.evaluate()
