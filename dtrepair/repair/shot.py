"""The stages of a window of frames: space-time push, mending, tightening, easing out."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np

from dtrepair.geometry import FloatArray
from dtrepair.repair.crew import Crew
from dtrepair.repair.mend import mend
from dtrepair.repair.regional import Diffuse, Diffusion
from dtrepair.repair.spacetime import SpaceTime
from dtrepair.repair.surface import Surface
from dtrepair.repair.timeline import apply_in_time, gaussian_kernel, undamped

# Width of the kernel of the displacement, in frames.
WIDTH = 3.5
# Sweeps are judged in blocks of this many; after so many blocks without progress a phase ends.
BLOCK, PATIENCE = 2, 3
# Widths in frames over which the corrections of single frames are spread, pass by pass.
MENDING = (2.0, 2.0, 1.5, 1.5, 1.2, 1.0, 0.8, 0.0)
# Part of the neighbouring frame's correction that a frame starts from.
WARM = 0.9
# Tightening: part of the displacement that is taken back, its decay on failure, the push's step.
PULL_BACK, PULL_DECAY, PULL_STEP, PULL_SWEEPS = 0.2, 0.6, 0.003, 5
# Displacements below this (units of the size) are left out; up to twice this they fade in.
STILL = 2e-5


class Phase(NamedTuple):
    """Sweeps with a diffusion strength (times lambda), a step in units of the size, and a width.

    width: standard deviation in frames of what is added.
    """

    strength: float
    step: float
    sweeps: int
    width: float = WIDTH


PHASES = (Phase(1.0, 0.01, 20), Phase(1.0, 0.006, 8, 1.75))


class ShotMethod:
    """Repairs windows of frames of one surface; factors are made once and kept."""

    def __init__(
        self,
        surface: Surface,
        alone: Callable[[Surface, FloatArray], FloatArray],
        *,
        tighten: int = 3,
    ) -> None:
        """Use `alone` (surface, pose) for frames that stay dirty; `tighten` cycles at most."""
        self.surface, self.alone, self.tighten = surface, alone, tighten

    @cached_property
    def diffusions(self) -> list[Diffuse]:
        """One for each phase; the first is the surface's own."""
        stronger = {p.strength: Diffusion(self.surface, p.strength) for p in PHASES if p.strength > 1}
        return [stronger.get(phase.strength, self.surface.diffuse) for phase in PHASES]

    def __call__(self, original: FloatArray, frames: FloatArray, crew: Crew) -> FloatArray:
        """Repaired poses (T, V, 3) of poses in units of the size, at times in frame units."""
        run = _Run(self, original, frames, crew)
        if not run.state.dirty:
            return original
        run.push()
        run.mend()
        if not run.state.dirty:
            run.tightened(self.tighten)
        return run.eased()


class _Run:
    """One window on its way."""

    def __init__(
        self, method: ShotMethod, original: FloatArray, frames: FloatArray, crew: Crew
    ) -> None:
        self.method, self.crew, self.frames = method, crew, frames
        self.state = SpaceTime(method.surface, original, frames, crew)
        self.kernel = gaussian_kernel(frames, WIDTH)

    def push(self) -> None:
        """Sweeps in phases; the state with the fewest pairs is kept."""
        state = self.state
        best = (state.remaining, state.snapshot())
        for phase, diffuse in zip(PHASES, self.method.diffusions, strict=True):
            stalled = 0
            kernel = gaussian_kernel(self.frames, phase.width)
            for index in range(phase.sweeps):
                if not state.dirty:
                    return
                state.sweep(kernel, phase.width, diffuse, phase.step)
                if index % BLOCK != BLOCK - 1:
                    continue
                stalled += 1
                if state.remaining < best[0]:
                    best, stalled = (state.remaining, state.snapshot()), 0
                if stalled == PATIENCE:
                    break
            if state.remaining > best[0]:
                state.restore(best[1], WIDTH)

    def mend(self, widths: tuple[float, ...] = MENDING, step: float = 0.004) -> None:
        """Frames still dirty: the solver of single frames from this state, spread in time."""
        state = self.state
        for index, width in enumerate(widths):
            dirty = state.dirty
            if not dirty:
                return
            forwards = index % 2 == 0
            corrections = np.zeros_like(state.original)
            chains = _chains(dirty if forwards else dirty[::-1])
            for chain, moved in zip(
                chains, self.crew.map(self._mended(step), chains), strict=True
            ):
                for frame, correction in zip(chain, moved, strict=True):
                    corrections[frame] = correction
            if width > 0:
                corrections = undamped(gaussian_kernel(self.frames, width), corrections)
            state.extra = state.extra + corrections
            state.evaluate()

    def _mended(self, step: float) -> Callable[[Surface, list[int]], list[FloatArray]]:
        def run(surface: Surface, chain: list[int]) -> list[FloatArray]:
            state, moved = self.state, []
            for frame in chain:
                warm = WARM * moved[-1] if moved else None
                pose = mend(
                    surface,
                    state.original[frame],
                    state.poses[frame],
                    warm=warm,
                    step=step,
                    alone=self.method.alone,
                )
                moved.append(pose - state.poses[frame])
            return moved

        return run

    def tightened(self, cycles: int) -> None:
        """Take back displacement where the last cycle did not have to push; keep what is better."""
        state, diffuse = self.state, self.method.diffusions[0]
        best, value = state.snapshot(), self._cost()
        needed = np.zeros(state.original.shape[:2])
        fraction = PULL_BACK
        for _ in range(cycles):
            kept = 1.0 - fraction * (1.0 - 0.85 * needed)[:, :, None]
            taken = np.linalg.norm(best.smooth * (1.0 - kept), axis=2)
            state.smooth, state.extra = best.smooth * kept, best.extra * kept
            lowered = np.maximum(best.fold_hits - 0.8 * fraction / PULL_BACK, 0.0)
            state.folds.hits = lowered.astype(np.float32)
            state.folds.update(WIDTH)
            state.evaluate()
            added = np.zeros_like(state.original)
            for _ in range(PULL_SWEEPS):
                if not state.dirty:
                    break
                added += state.sweep(self.kernel, WIDTH, diffuse, PULL_STEP)
            if 0 < len(state.dirty) <= max(2, len(state.original) // 5):
                self.mend(widths=(1.0, 0.7, 0.0), step=0.002)
            pushed = np.linalg.norm(added, axis=2)
            floor = 1e-3 * taken.max(initial=0.0) + 1e-30
            needed_now = apply_in_time(
                self.kernel, np.clip(pushed / np.maximum(taken, floor), 0.0, 1.0)
            )
            cost = self._cost()
            if not state.dirty and cost < 0.995 * value:
                best, value = state.snapshot(), cost
                needed = np.maximum(0.7 * needed, needed_now)
            else:
                fraction *= PULL_DECAY
                needed = np.maximum(needed, needed_now)
                state.closes.hits = best.close_hits.copy()
        state.restore(best, WIDTH)

    def _cost(self) -> float:
        """What tightening lowers: mean displacement and its unsteadiness, each by its weight."""
        moved = self.state.poses - self.state.original
        second = np.diff(moved, 2, axis=0)
        jitter = float(np.sqrt((second**2).sum(axis=2).mean())) if len(second) else 0.0
        return float(np.linalg.norm(moved, axis=2).mean()) / 0.009 + jitter / 1.5e-3

    def eased(self) -> FloatArray:
        """Poses with the faintest displacements taken out, where they stay as clean."""
        state = self.state
        moved = state.poses - state.original
        length = np.linalg.norm(moved, axis=2)
        kept = np.clip(length / STILL - 1.0, 0.0, 1.0)[:, :, None]
        eased = np.where(kept > 0, state.original + kept * moved, state.original)
        changed = np.flatnonzero((kept < 1).any(axis=(1, 2)))
        found = self.crew.map(lambda surface, frame: surface.pairs(eased[frame]), changed)
        for frame, pairs in zip(changed, found, strict=True):
            if len(pairs) > len(state.pairs[frame]):
                eased[frame] = state.poses[frame]
        return eased


def _chains(frames: list[int]) -> list[list[int]]:
    """Frames split where they are not neighbours: each chain is mended one after the other."""
    chains: list[list[int]] = []
    for frame in frames:
        if chains and abs(frame - chains[-1][-1]) == 1:
            chains[-1].append(frame)
        else:
            chains.append([frame])
    return chains


