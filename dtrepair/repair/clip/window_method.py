"""The stages of a window of frames: push, mend, tighten, steady, ease out."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.temporal import (
    apply_in_time,
    gaussian_kernel,
    second_differences,
    steady_weights,
)
from dtrepair.repair.clip.frame_steps import Alone
from dtrepair.repair.clip.mend_frames import mend_frames
from dtrepair.repair.clip.restore_shape import stiffen_frames
from dtrepair.repair.clip.tighten_frames import WIDTH, tighten_frames
from dtrepair.repair.clip.window_state import SpaceTime
from dtrepair.repair.parallel.worker_pool import Crew
from dtrepair.repair.surface.surface import Surface

# Sweeps are judged in blocks of this many; after so many blocks without progress a phase ends.
BLOCK, PATIENCE = 2, 3
# Frames with a larger root mean square second difference (units of the size) are steadied.
ROUGH, STEADY_ROUNDS, STEADY_STEP = 1.5e-3, 6, 0.002
# As long as a round lowers their roughness to this part.
STEADY_GAIN = 0.97
# Part of the usual work on a window that pushing is.
PUSHED = 0.4
# Displacements below this (units of the size) are left out; up to twice this they fade in. Around
# what that would close they come back, fading out over these rings, try by try.
STILL, EASE_RINGS = 1e-4, (3, 6)


class Phase(NamedTuple):
    """Sweeps: the step in units of the size, how many, and the width in frames of what is added."""

    step: float
    sweeps: int
    width: float


# Frames that stay dirty in the wide kernel get a narrower one: their neighbours stay clean.
PHASES = (Phase(0.01, 20, WIDTH), Phase(0.006, 8, 0.5 * WIDTH))
SWEEPS = sum(phase.sweeps for phase in PHASES)


class ShotMethod:
    """Repairs windows of frames of one surface, in units of its size."""

    def __init__(
        self,
        surface: Surface,
        alone: Alone,
        *,
        tighten: int = 3,
        farthest: float | None = None,
        clearance: float = 0.0,
    ) -> None:
        """Use `alone` (surface, pose) for frames that stay dirty; `tighten` cycles at most.

        farthest: no vertex moves farther; clearance: what contacts keep where they can.
        """
        self.surface, self.alone, self.tighten = surface, alone, tighten
        self.farthest, self.clearance = farthest, clearance

    def __call__(
        self,
        original: FloatArray,
        frames: FloatArray,
        crew: Crew,
        *,
        unless: Callable[[list[IntArray]], bool] | None = None,
    ) -> FloatArray | None:
        """Repaired poses (T, V, 3) of poses at times in frame units; dirty where none was found.

        unless: asked with the pairs that pushing leaves; None is returned if it says so.
        """
        state = SpaceTime(
            self.surface,
            original,
            frames,
            crew,
            alone=self.alone,
            farthest=self.farthest,
            clearance=self.clearance,
        )
        if not state.dirty:
            return original
        push(state)
        if state.dirty and unless is not None and unless(state.pairs):
            return None
        state.forget_clearance()
        mend_frames(state)
        state.given_up = frozenset(state.dirty)
        # Tightening would close a clearance again.
        if self.clearance == 0.0:
            tighten_frames(state, self.tighten)
        steady_frames(state)
        if self.clearance == 0.0:
            stiffen_frames(state)
        return eased(state)


def push(state: SpaceTime) -> None:
    """Sweeps in phases until all frames are clean; the state with the fewest pairs is kept.

    A phase goes on as long as any frame gets better, whatever the others do.
    """
    best = (state.remaining, state.snapshot())
    fewest = np.array([len(pairs) for pairs in state.pairs])
    swept = 0
    for phase in PHASES:
        stalled = 0
        kernel = gaussian_kernel(state.frames, phase.width)
        for index in range(phase.sweeps):
            if not state.dirty:
                return
            state.sweep(kernel, phase.step)
            swept += 1
            state.tell_progress(PUSHED * swept / SWEEPS)
            if index % BLOCK != BLOCK - 1:
                continue
            counts = np.array([len(pairs) for pairs in state.pairs])
            stalled = 0 if (counts < fewest).any() else stalled + 1
            fewest = np.minimum(fewest, counts)
            if state.remaining < best[0]:
                best = (state.remaining, state.snapshot())
            if stalled == PATIENCE:
                break
        if state.remaining > best[0]:
            state.restore(best[1])


def steady_frames(state: SpaceTime) -> None:
    """Frames that stand out from their neighbours go where these ask them to be, if still clean."""
    if len(state.frames) < 3:
        return
    weights, differences = steady_weights(state.frames), second_differences(state.frames)

    def roughness() -> FloatArray:
        second = apply_in_time(differences, state.poses - state.original)
        of_frames: FloatArray = np.sqrt((second**2).sum(axis=2).mean(axis=1))
        return of_frames

    now = roughness()
    for _ in range(STEADY_ROUNDS):
        before = np.linalg.norm(now)
        for colour in range(3):
            rough = np.zeros(len(state.frames), dtype=bool)
            rough[1:-1] = now > ROUGH
            rough[:-1] |= rough[1:]
            rough[1:] |= rough[:-1]
            frames = np.flatnonzero(rough)
            frames = frames[frames % 3 == colour]
            if len(frames) and state.steady(frames.tolist(), weights, STEADY_STEP):
                now = roughness()
        if np.linalg.norm(now) > STEADY_GAIN * before:
            break


def eased(state: SpaceTime) -> FloatArray:
    """Poses with the faintest displacements taken out, except around what that would close.

    What is far from all contacts keeps every bit; displacements fade in over the surface and time.
    """
    moved = state.poses - state.original
    length = np.linalg.norm(moved, axis=2)
    for body in state.surface.rigid.slices:
        length[:, body] = length[:, body].max(axis=1, keepdims=True)
    kept = np.clip(length / STILL - 1.0, 0.0, 1.0)
    asked = np.flatnonzero((kept < np.minimum(length, 1.0)).any(axis=1)).tolist()
    for rings in (*EASE_RINGS, None):
        part = kept[:, :, None]
        result = np.where(part > 0, state.original + part * moved, state.original)
        result = np.where(part < 1, result, state.poses)
        found = dict(zip(asked, state.pairs_of(result, asked), strict=True))
        asked = [f for f, pairs in found.items() if len(pairs) > len(state.pairs[f])]
        if not asked or rings is None:
            break
        for frame in asked:
            closed = state.surface.vertices_of(found[frame])
            away = state.surface.rings_from(closed, 2 * rings) / rings - 1.0
            kept[frame] = np.where(length[frame] > 0, np.maximum(kept[frame], 1.0 - away), 0.0)
            kept[frame] = np.minimum(kept[frame], 1.0)
            for body in state.surface.rigid.slices:
                kept[frame, body] = kept[frame, body].max()
    result[asked] = state.poses[asked]
    return result
